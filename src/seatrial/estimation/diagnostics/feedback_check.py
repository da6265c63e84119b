"""Is a control computed from a measured channel? Then its relation to the motion says nothing of signs and clocks.

A controller passes the noise of its sensor on to the command: with y_k the measured channels and c_k the command at its k-th change,

    c_k = a + sum_{i=1..2} g_i c_{k-i} + sum_{i=0..2} b_i y_{k-i},

which holds for P, PI and PID laws, filtered or not, and for references that seldom change. The residual then lacks the noise b_i sigma
that a measured channel would bring in if the command had been there first; and b_0 opposes the motion that the command causes, where a
response that is stamped too early would go with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from seatrial.core.findings import Finding
from seatrial.core.record import Record
from seatrial.core.signals import ANGLES, POSITIONS, QUATERNION, RATES

# Channels that no command changes at once, as it changes an acceleration or a force.
STATES = (*RATES, *POSITIONS, *ANGLES, *QUATERNION)
LAGS = 3  # Changes of the command, this one included, whose measurements may be in it: the terms of a PID law
DELAYS = range(6)  # Rows by which a command may follow the measurement that it is computed from
# Share of the changes that the law has to explain: at others the reference changes, or the command leaves its limit.
TYPICAL = 0.8
PASSED_ON = 0.3  # Residual over the noise that the law passes on, below which the noise is in the command
EXPLAINED = 0.3  # Residual over that of a law without measurements, likewise
# Changes of the command for each number of the law, at least, and changes that are looked at, at most.
MIN_CHANGES, MAX_CHANGES = 10, 2000
MIN_SHARE = 0.1  # Share of the noise in the command from which a channel is named
# Checks that compare the motion with the commands as if these had come first.
BLINDED = (
    "direction-reversed",
    "motion-unrelated",
    "clock-shift",
    "clock-not-judged",
    "axes-wrong",
    "thruster-reversed",
    "thruster-gain",
    "thruster-gain-unknown",
)
_TRIMS = 4


def find_feedback(
    record: Record, noise: Mapping[str, float], expected: Mapping[str, Float[np.ndarray, " n"]]
) -> dict[str, tuple[str, ...]]:
    """Return the controls that are functions of measured channels, and these channels.

    Args:
        record: SI; every channel of it is looked at, whether the campaign uses it or not.
        noise: standard deviation of the sensors that are known, SI; another is taken from the record.
        expected: motion by the commands of the record, of the channels for which it is known, SI.
    """
    columns: dict[str, Float[np.ndarray, " n"]] = {}
    for name in (one for one in record.measured if one in STATES):
        values = record.channel(name)
        known = np.flatnonzero(np.isfinite(values))
        if known.size > LAGS and np.ptp(values[known]) > 0:
            last = np.maximum(np.searchsorted(known, np.arange(values.size), side="right") - 1, 0)
            columns[name] = np.unwrap(values[known])[last] if name in ANGLES else values[known][last]
    if not columns:
        return {}
    y = np.column_stack([*columns.values()])
    sigma = np.array([min(noise.get(name, np.inf), _scatter(record.channel(name))) for name in columns])
    bend = [np.diff(expected[name], 2, append=expected[name][-1:]) if name in expected else None for name in columns]
    result = {}
    for control in record.controls:
        shares = _passed_on(record.channel(control), y, sigma, bend)
        if shares is not None:
            result[control] = tuple(name for name, share in zip(columns, shares, strict=True) if share > MIN_SHARE)
    return result


def closed_loop(feedback: Mapping[str, Sequence[str]]) -> list[Finding]:
    """Return the note about each control that is computed from measured channels."""
    return [
        Finding("closed-loop", "note", (control,), {"channels": tuple(channels)}, ("held-command",))
        for control, channels in feedback.items()
    ]


def not_judged_in_loop(findings: Sequence[Finding], feedback: Mapping[str, Sequence[str]]) -> list[Finding]:
    """Return findings in which signs, axes and clocks that look wrong are not judged if commands are computed from the motion.

    Args:
        findings: about the motion beside the expected one.
        feedback: controls that are functions of measured channels, and these channels.
    """
    if not feedback:
        return list(findings)
    return [
        replace(one, level="note", remedies=("open-loop-run",)).among(closed_loop=tuple(feedback))
        if one.code in BLINDED and one.level != "pass"
        else one
        for one in findings
    ]


def _scatter(values: Float[np.ndarray, " n"]) -> float:
    """Return the standard deviation of the white noise whose fourth differences are as large as most of the samples'."""
    rough = np.sort(np.diff(values[np.isfinite(values)], 4) ** 2) / 70.0
    return float(np.sqrt(np.mean(rough[: max(round(TYPICAL * rough.size), 1)])))


def _passed_on(
    control: Float[np.ndarray, " n"],
    y: Float[np.ndarray, "n m"],
    sigma: Float[np.ndarray, " m"],
    bend: Sequence[Float[np.ndarray, " n"] | None],
) -> Float[np.ndarray, " m"] | None:
    """Return the share of each channel in the noise that a control holds; None if it is no function of them."""
    changes = np.flatnonzero(np.diff(control)) + 1
    changes = changes[(changes >= DELAYS[-1]) & (changes < control.size - 1)]
    at = np.arange(LAGS - 1, changes.size)
    if at.size < MIN_CHANGES * LAGS * (1 + y.shape[1]):
        return None
    at = at[:: -(-at.size // MAX_CHANGES)]
    before = np.column_stack([np.ones(at.size), *(control[changes[at - lag]] for lag in range(1, LAGS))])
    now = control[changes[at]]
    least = 1e-9 * float(np.ptp(control))
    law, alone = _fit(before, now)
    news = now - before @ law
    for delay in DELAYS:
        shown = np.hstack([y[changes[at - lag] - delay] for lag in range(LAGS)])
        law, residual = _fit(np.hstack([before, shown]), now)
        gains = law[LAGS:].reshape(LAGS, -1)
        passed = np.sum((gains * sigma) ** 2, axis=0)
        if residual > max(PASSED_ON * np.sqrt(passed.sum()), least) or not residual <= EXPLAINED * alone > least:
            continue
        main = int(np.argmax(passed))
        caused = bend[main]
        if caused is None or gains[0, main] * float(caused[changes[at] - 1] @ news) <= 0:
            return passed / passed.sum()
    return None


def _fit(columns: Float[np.ndarray, "k j"], values: Float[np.ndarray, " k"]) -> tuple[np.ndarray, float]:
    """Return least squares without the largest residuals, and the root mean square of those that are left."""
    mean, scale = columns.mean(axis=0), np.maximum(columns.std(axis=0), 1e-300)
    mean[0], scale[0] = 0.0, 1.0
    scaled, kept = (columns - mean) / scale, np.ones(values.size, bool)
    law, size = np.zeros(columns.shape[1]), np.zeros(values.size)
    for _ in range(_TRIMS):
        law = np.linalg.lstsq(scaled[kept], values[kept], rcond=1e-12)[0]
        size = np.abs(values - scaled @ law)
        kept = size <= np.quantile(size, TYPICAL)
    return law / scale, float(np.sqrt(np.mean(size[kept] ** 2)))
