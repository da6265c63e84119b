"""Identifiability in words: each parameter, several together, symmetries, and trials that separate parameters known together."""

from collections.abc import Sequence

import numpy as np

from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.display_units import listed, measured, percent
from seatrial.core.signals import RATES, SIGNALS, motion_name
from seatrial.estimation.diagnostics.combinations import Combination, Invisible
from seatrial.estimation.diagnostics.identifiability import Group, Identifiability
from seatrial.estimation.diagnostics.symmetry import Restriction, Symmetry

CONTRACTION = 0.9
"""Posterior divided by prior standard deviation above which the data have no information."""
VAGUE = 0.5
"""Relative standard deviation beyond which a coefficient is not known."""
NOISE = ("sigma_", "tau_", "dof_", "drift_", "process_")
"""First letters of parameters of noise; combinations of only these are not reported."""
SHARP = 0.01
"""Relative standard deviation below which a parameter is known by itself, however strongly it is correlated."""
WELL = 0.05
"""Relative standard deviation below which a parameter is of use by itself, although a combination is known much better."""
MAX_LISTED = 8
"""Restrictions that a sentence names."""
STRONG_EVIDENCE, LEAST_EVIDENCE = 3.0, -20.0
"""Nats above which the data decide (20 to 1), and below which a normal density is not accurate."""


def identifiability_cautions(result: Identifiability) -> list[str]:
    """Return cautions with remedies; empty if each parameter is known by itself."""
    together = [
        _together(result, group)
        for group in result.groups
        if not all(one.startswith(NOISE) for one in group.names) and not _are_within(result, group, SHARP)
    ]
    if np.isfinite(result.eigenvalues).all():
        return [*_structural(result), *_practical(result), *together]
    blind = "identifiability is not judged: the log-likelihood has no derivatives at the values used"
    return [blind] if result.stage == "before" else [blind, *_practical(result), *together]


def _structural(result: Identifiability) -> list[str]:
    if len(result.untouched) == len(result.names):
        return ["the data contain no information on any parameter: no channel was measured, or none depends on them"]
    lines = [f"{_untouched(name)} (structural); the stated value is the prior's" for name in result.untouched]
    return lines + [
        f"no amount of such data shows one combination (structural): {invisible_change(item)}; "
        f"{what_separates(item.names)}"
        for item in result.invisible
    ]


def _untouched(name: str) -> str:
    if name.startswith("sigma_"):
        return f"no measurement of {name.removeprefix('sigma_')} is left, so the data contain no information on {name}"
    moved = f"move {listed(sorted({*CoefficientName.parse(name).signals}))}, " if is_coefficient(name) else ""
    todo = f"{moved}fix it, or add a sensor that responds to it"
    return f"the trial contains no information on {name}: no measurement changes with it; {todo}"


def invisible_change(item: Invisible) -> str:
    """Return the words of a change of parameters that no measurement shows."""
    if item.is_scale and len(item.names) > 1:
        return f"{listed(item.names)} scale together: only their ratios are known"
    parts = [
        f"{name} by {step:+.3g} %" if share else f"{name} by {0.01 * step:+.3g} prior standard deviations"
        for name, step, share in zip(item.names, item.steps, item.relative, strict=True)
    ]
    return f"changing {listed(parts)} leaves every measurement as it is"


def _practical(result: Identifiability) -> list[str]:
    lines, verb = [], {"before": "would be", "after": "is"}[result.stage]
    for i, (name, value, sd, share) in enumerate(
        zip(result.names, result.values, result.sd, result.contraction, strict=True)
    ):
        if name in result.untouched:
            continue
        if share > CONTRACTION:
            lines.append(
                f"the data cannot determine {name}: its standard deviation {verb} {share:.0%} of the prior's. "
                "The stated value is the prior's; run a trial that excites it, or fix it"
            )
        elif is_coefficient(name) and sd > VAGUE * abs(value):
            lines.append(
                f"{name} {verb} {_measured(result, i)} (practical): the data narrow the prior, but determine "
                f"{'not even its sign' if 1.96 * sd > abs(value) else 'little more than its sign'}; "
                "run a trial that excites it more, or leave it out"
            )
    return lines


def _together(result: Identifiability, group: Group) -> str:
    at = [result.names.index(name) for name in group.names]
    each = [
        f"{name} to {percent(result.relative_sd[i])}"
        if result.relative_sd[i] < 1
        else f"{name} as {_measured(result, i)}"
        for i, name in zip(at, group.names, strict=True)
    ]
    sums = [f"{item.text}{f' ({item.meaning})' if item.meaning else ''} {precision(item)}" for item in group.headline]
    would_be = {"before": "would be ", "after": ""}[result.stage]
    much = "much better" if _are_within(result, group, WELL) else "only"
    return (
        f"{would_be}known {much} in combination: {listed(sums)}; separately {listed(each)}, correlation "
        f"{group.correlation:+.3f}. To separate them: {what_separates(group.names)}"
    )


def precision(item: Combination) -> str:
    """Return how well a combination is known: in percent if that is small, otherwise as a number."""
    size = measured(item.value, item.sd, item.unit)
    return f"to {percent(item.relative_sd)} ({size})" if item.relative_sd < 0.3 else f"as {size}"


def _measured(result: Identifiability, i: int) -> str:
    factor, unit = result.shown[i] if result.shown else (1.0, result.units[i])
    return measured(factor * result.values[i], factor * result.sd[i], unit)


def _are_within(result: Identifiability, group: Group, share: float) -> bool:
    return all(result.relative_sd[result.names.index(name)] < share for name in group.names)


def what_separates(names: Sequence[str]) -> str:
    """Return the trial, or the measurement, by which each of these parameters becomes known."""
    axes = {name.split("_")[0] for name in names if is_coefficient(name)}
    terms = [CoefficientName.parse(name) for name in names if is_coefficient(name)]
    inertial = any(term.is_added_mass for term in terms) or "m" in names
    if any(name.split("[")[0] == "current" or name.startswith("bias_") for name in names):
        return (
            "measure the current, run both ways along one line, or cover a wider range of speeds, including "
            "a reverse or a coast-down"
        )
    if "t_d" in names:
        return "only the product (1 - t_d) T acts on the hull: fix t_d, or measure the thrust at the shaft as well"
    if inertial and axes:
        return "fix the mass (weigh the vehicle), or fix the thrust by a bollard pull"
    if "T" in axes and len(axes) > 1:
        return "fix the thrust by a bollard pull, or add a coast-down with the propeller stopped"
    if any(name.startswith("tether_") for name in names):
        return "run a trial that moves along and about several axes at once, or the same trial without the tether"
    if any(name.startswith("gain_") for name in names):
        return "fix the thrust by a bollard pull, or measure the other parameter separately"
    if any(name.startswith("dead_") for name in names):
        return "use steps from small to large thrust"
    if any(name == "delay" or name.startswith("lag_") for name in names):
        return "use sharper steps, or measure the delay on the bench"
    if axes and len(terms) == len(names):
        signals = sorted({signal for term in terms for signal in term.signals})
        if signals == ["u"]:
            return "cover a wider range of speeds, by larger steps, longer periods, a reverse or a coast-down"
        return f"run a trial with {listed([_moved(signal, 'faster', 'larger') for signal in signals])}, and one {_apart(signals)}"
    if all(name.startswith(("sigma_", "tau_", "dof_")) for name in names):
        return "use a longer record"
    return "fix one of them, or measure another channel"


def _apart(signals: Sequence[str]) -> str:
    """Return the second trial that separates the terms of these signals: less of one of them, or only one of several at a time."""
    if len(signals) == 1:
        return f"with {_moved(signals[0], 'slower', 'smaller')}"
    if all(signal in RATES for signal in signals):
        return f"in which only {' or only '.join(map(motion_name, signals))} moves"
    return "in which they change one at a time"


def _moved(signal: str, faster: str, larger: str) -> str:
    """Return a motion or a control with its adjective: `faster turns`, `faster sway`, `larger rudder angles`."""
    if signal in RATES:
        return f"{faster} {'turns' if signal == 'r' else motion_name(signal)}"
    return f"{larger} {SIGNALS[signal].meaning.partition(' of ')[0]}s"


def symmetry_sentence(symmetry: Symmetry) -> str:
    """Return `port and starboard alike (Y_0 = 0): log evidence +4.2, supported by the data`."""
    value, more = symmetry.log_evidence, len(symmetry.restrictions) - MAX_LISTED
    named = ", ".join(map(restriction_text, symmetry.restrictions[:MAX_LISTED])) + (f" and {more} more" * (more > 0))
    number = f"{value:+.1f}" if value > LEAST_EVIDENCE else f"below {LEAST_EVIDENCE:.0f}"
    refuted = "refuted by the data" if value < -STRONG_EVIDENCE else "not decided"
    verdict = "supported by the data" if value > STRONG_EVIDENCE else refuted
    return f"{symmetry.sides} alike ({named}): log evidence {number}, {verdict}"


def restriction_text(one: Restriction) -> str:
    """Return `Y_0 = 0`, `M_w = -N_v`."""
    return f"{one.first} = {'-' if one.sign < 0 else ''}{one.second or 0}"
