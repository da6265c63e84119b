"""Agreement of the methods that compute one evidence: which value is taken, and the reasons against it.

Each method is blind where another sees, so that their difference in units of their joint error tests both, but not the likelihood and
the prior, which they share. Two methods can miss the same narrow peak and agree.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from seatrial.core.display_units import listed
from seatrial.core.findings import Finding
from seatrial.core.serialise import to_plain
from seatrial.selection.verdict import Evidence

Method = Literal["smc", "importance", "nested"]
# The value is that of the first of these that is healthy.
METHOD_ORDER: tuple[Method, ...] = ("importance", "smc", "nested")
METHOD_LABELS: Mapping[Method, str] = {
    "importance": "importance sampling",
    "smc": "tempered SMC",
    "nested": "nested sampling",
}
# Difference from which on there is an alarm: in joint errors, and in nats at least.
MAX_JOINT_ERRORS, MIN_DIFFERENCE = 3.0, 0.1
# Joint error, nats, of a check: it then still finds 1.5 nats, which move odds between structures by a factor of four.
MAX_CHECK_ERROR = 0.5


def judge(
    evidences: Mapping[Method, Evidence],
    failed: Mapping[Method, str],
    alarms: Sequence[str] = (),
    alone: bool = False,
    at_bounds: Sequence[Finding] = (),
) -> Evidence:
    """Choose the first healthy evidence, or the first if none is, with the reasons against it.

    A healthy method that agrees confirms it. What another then lacks, or says against itself, is a note; but one that finds more has met
    something that the two that agree have not.

    Args:
        evidences: by method, the preferred first.
        failed: why other methods gave none.
        alarms: what else is known against the result.
        alone: whether no other method was asked.
        at_bounds: findings about parameters whose mode lies at a bound of their prior.
    """
    value = value_of({name: {"status": evidence.status} for name, evidence in evidences.items()})
    chosen, table, checks, higher, against, resolved = evidences[value], {}, 0, [], [], []
    for name, evidence in evidences.items():
        difference = evidence.log_value - chosen.log_value
        joint = float(np.hypot(np.nan_to_num(evidence.std_error), np.nan_to_num(chosen.std_error)))
        table[name] = {
            "log_value": evidence.log_value,
            "std_error": evidence.std_error,
            "status": evidence.status,
            "difference": difference,
            "joint_errors": difference / joint if joint > 0 else 0.0,
        }
        if evidence.status:
            against.append(f"{evidence.method} complains: {evidence.status}")
        if name == value:
            continue
        if not abs(difference) <= max(MAX_JOINT_ERRORS * joint, MIN_DIFFERENCE):
            apart = f"{abs(difference) / max(joint, 1e-12):.0f} joint errors"
            (higher if difference > 0 else against).append(
                f"{evidence.method} finds {difference:+.2f} nats against {chosen.method}, {apart}: one of them misses part of the posterior"
            )
        elif not evidence.status and joint > MAX_CHECK_ERROR:
            against.append(f"{evidence.method} checks to {joint:.2f} nats only: use more particles or draws")
        elif not evidence.status:
            checks += 1
            resolved.append(max(MAX_JOINT_ERRORS * joint, MIN_DIFFERENCE))
    against += [f"{METHOD_LABELS[name]} failed: {why}" for name, why in failed.items()]
    if value != next(iter(evidences)) or failed:
        against.append(f"the value is that of {chosen.method}")
    messages = [*alarms, *higher, *([] if checks or alone else against)]
    if not checks and not alone:
        messages.append("no healthy independent method confirms the value")
    notes = [_note(name, table[name]) for name in table if name != value] if checks else []
    diagnostics = chosen.diagnostics | {
        "at_bounds": [to_plain(one) for one in at_bounds],
        "methods": table,
        "checks": checks,
        "resolution": min(resolved, default=None),
        "notes": list(filter(None, notes)),
    }
    return Evidence(chosen.log_value, chosen.std_error, chosen.method, diagnostics, "; ".join(messages))


def value_of(table: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the method whose value is taken, of a table as `judge` makes it: the first healthy one, or the first if none is."""
    return next((name for name, row in table.items() if not row["status"]), next(iter(table)))


def agrees(row: Mapping[str, Any]) -> bool:
    """Return whether a method's row of that table agrees with the value that is taken."""
    return abs(row["joint_errors"]) <= MAX_JOINT_ERRORS or abs(row["difference"]) <= MIN_DIFFERENCE


def _note(name: Method, row: Mapping[str, Any]) -> str:
    """Return why a method is not counted beside two that agree; nothing of one that agrees too."""
    apart = not agrees(row)
    reasons = [complaint.split(": ")[0] for complaint in row["status"].split("; ") if complaint]
    if apart:
        reasons.append(f"it is {abs(row['difference']):.2f} nats {'above' if row['difference'] > 0 else 'below'}")
    return f"{METHOD_LABELS[name]} is not counted ({listed(reasons)})" if reasons else ""
