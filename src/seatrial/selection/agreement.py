"""One evidence from several methods that share no code, with agreement or alarm in words.

Adaptive importance sampling about the mode is the most precise where the posterior has one mode and few parameters; tempered
SMC starts from the prior and knows of no mode. Each is blind where the other sees, so that their difference in units of their
joint error is a test of both. A last search, colder than the posterior, looks for a higher peak that both passed by.

What agreement cannot show: a mode that no method met. Two methods can miss the same narrow peak and agree.
"""

from collections.abc import Sequence
from math import log
from typing import Any
from zlib import crc32

import jax
import numpy as np

from seatrial.core.errors import InputError, NumericalError, nearest
from seatrial.sampling.target import Progress, no_progress
from seatrial.selection.evidence import Evidence
from seatrial.selection.lookout import HIGHER, highest_found
from seatrial.selection.methods import KIN, RUN, AgreementSettings, Found, Method

SMALL = 20
"""Parameters up to which importance sampling gives the value."""
ALARM, FLOOR = 3.0, 0.1
"""Difference that alarms: in joint errors, and in nats at least."""
BLUNT = log(2.0) / ALARM
"""Joint error, nats, above which a second peak as large as the first, log 2, would not alarm."""
_USUAL = AgreementSettings()


def agreed_evidence(
    posterior: Any,
    key: jax.Array,
    methods: Sequence[Method] | None = None,
    settings: AgreementSettings = _USUAL,
    progress: Progress = no_progress,
) -> Evidence:
    """Evidence of the first method that does not complain, with the others' values and the alarms.

    Args:
        posterior: density to integrate: a Posterior; a plain Target for the methods smc, stepping-stone, thermodynamic, nested
            and bridge.
        key: random key.
        methods: at least two that share no code, the preferred first; None for importance sampling and tempered SMC in up to 20
            parameters, tempered SMC and stepping-stone in more and for a plain Target.
        settings: sizes of the runs.
        progress: called with the work done and the work in all.

    Returns:
        The chosen evidence. Its diagnostics hold `methods`: value, error, status, difference from the chosen and that in joint
        errors for each; its status is empty only if all are healthy and agree.

    Raises:
        InputError: an unknown method, or none that checks another.
        NumericalError: every method failed.
    """
    chosen = tuple(methods) if methods is not None else _default(posterior)
    _check(chosen)
    steps = len(chosen) + settings.lookout

    def share(index: int) -> Progress:
        return lambda done, total: progress(round(1000 * (index + done / total)), 1000 * steps)

    found: dict[str, Found] = {}
    failed: dict[str, str] = {}
    for index, name in enumerate(chosen):
        try:
            found[name] = RUN[name](posterior, jax.random.fold_in(key, crc32(name.encode())), settings, share(index))
        except NumericalError as error:
            failed[name] = str(error)
        share(index)(1, 1)
    if not found:
        raise NumericalError("no method gave an evidence: " + "; ".join(f"{k}: {v}" for k, v in failed.items()))
    alarms = []
    if settings.lookout:
        alarms = _look(posterior, key, settings, max(one.peak for one in found.values()), share(len(chosen)))
    return judge({name: one.evidence for name, one in found.items()}, failed, alarms)


def judge(
    evidences: dict[str, Evidence], failed: dict[str, str], alarms: Sequence[str] = (), blunt: float = BLUNT
) -> Evidence:
    """Choose the first healthy evidence, or the first if none is, and say what speaks against it.

    Args:
        evidences: by method, the preferred first.
        failed: why other methods gave none.
        alarms: what else is known against the result.
        blunt: joint error, nats, above which a check is too blunt.
    """
    value = next((name for name, one in evidences.items() if not one.status), next(iter(evidences)))
    chosen, said, checks, table = evidences[value], list(alarms), 0, {}
    for name, one in evidences.items():
        difference = one.log_value - chosen.log_value
        joint = float(np.hypot(np.nan_to_num(one.std_error), np.nan_to_num(chosen.std_error)))
        table[name] = {
            "log_value": one.log_value,
            "std_error": one.std_error,
            "status": one.status,
            "difference": difference,
            "joint_errors": difference / joint if joint > 0 else 0.0,
        }
        if one.status:
            said.append(f"{one.method} complains: {one.status}")
        if name == value:
            continue
        if not abs(difference) <= max(ALARM * joint, FLOOR):
            said.append(
                f"{one.method} finds {difference:+.2f} nats against {chosen.method}, {abs(difference) / max(joint, 1e-12):.0f} "
                "joint errors: one of them misses part of the posterior; trust neither before a third method has been run"
            )
        elif not one.status and not _kin(name, value):
            checks += 1
            if joint > blunt:
                said.append(f"{one.method} checks to {joint:.2f} nats only: use more particles or draws")
    said += [f"{name} failed: {why}" for name, why in failed.items()]
    if value != next(iter(evidences)) or failed:
        said.append(f"the value is that of {chosen.method}")
    if not checks:
        said.append("no healthy independent method confirms the value")
    diagnostics = chosen.diagnostics | {"methods": table, "checks": checks}
    return Evidence(chosen.log_value, chosen.std_error, chosen.method, diagnostics, "; ".join(said))


def _default(posterior: Any) -> tuple[Method, ...]:
    if posterior.dim <= SMALL and hasattr(posterior, "constrain"):
        return "importance", "smc"
    return "smc", "stepping-stone"


def _kin(one: str, other: str) -> bool:
    return any(one in family and other in family for family in KIN)


def _check(methods: tuple[str, ...]) -> None:
    for name in methods:
        if name not in RUN:
            raise InputError(
                "agreed evidence, methods", found=name, expected="a method of evidence", remedy=nearest(name, RUN)
            )
    if all(_kin(name, methods[0]) or name == methods[0] for name in methods[1:]):
        raise InputError(
            "agreed evidence, methods",
            found=", ".join(methods) or "none",
            expected="at least two methods that share no code",
            remedy='for example "importance" and "smc"',
        )


def _look(posterior: Any, key: jax.Array, settings: AgreementSettings, known: float, progress: Progress) -> list[str]:
    """Whether a higher peak exists than the methods know, in words."""
    if not np.isfinite(known):
        return []
    highest = highest_found(posterior, jax.random.fold_in(key, crc32(b"lookout")), settings.smc.smc, progress)
    if highest <= known + HIGHER:
        return []
    return [
        f"a point {highest - known:.1f} nats above the highest peak the methods know exists: a narrow peak was passed by and may "
        "hold most of the evidence; narrow the prior about it, or integrate each peak by itself"
    ]
