"""What would tell parameters apart that the data only show together, in words for whoever plans the next trial."""

from collections.abc import Sequence
from math import floor, log10

from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.signals import RATES, SIGNALS, motion_name


def what_separates(names: Sequence[str]) -> str:
    """Say what to do so that these parameters are known each."""
    axes = {name.split("_")[0] for name in names if is_coefficient(name)}
    terms = [CoefficientName.parse(name) for name in names if is_coefficient(name)]
    inertial = any(term.is_added_mass for term in terms) or "m" in names
    if any(name.split("[")[0] == "current" or name.startswith("bias_") for name in names):
        return (
            "measure the current by itself, run both ways along one line, or cover a wider range of speeds, "
            "a reverse or a coast-down included"
        )
    if "t_d" in names:
        return "only the product (1 - t_d) T acts on the hull: fix t_d, or measure the thrust at the shaft as well"
    if inertial and axes:
        return "fix the mass (weigh the vehicle), or fix the thrust by a bollard pull"
    if "T" in axes and len(axes) > 1:
        return "fix the thrust by a bollard pull, or add a coast-down with the propeller stopped"
    if any(name.startswith("tether_") for name in names):
        return "a trial that moves along and about several axes at once, or the same trial without the tether"
    if any(name.startswith("gain_") for name in names):
        return "fix the thrust by a bollard pull, or the other by a measurement of its own"
    if any(name.startswith("dead_") for name in names):
        return "use steps from small to large thrust"
    if any(name == "delay" or name.startswith("lag_") for name in names):
        return "use sharper steps, or measure the delay on the bench"
    if axes and len(terms) == len(names):
        signals = sorted({signal for term in terms for signal in term.signals})
        if signals == ["u"]:
            return "cover a wider range of speeds, by larger steps, longer periods, a reverse or a coast-down"
        return f"a trial with {listed([_moved(signal, 'faster', 'larger') for signal in signals])}, and one {_apart(signals)}"
    if all(name.startswith(("sigma_", "tau_", "dof_")) for name in names):
        return "a longer record"
    return "fix one of them, or measure another channel"


def _apart(signals: Sequence[str]) -> str:
    """Return what a second trial has that tells the terms of these signals apart: one of them at less, or each of several alone."""
    if len(signals) == 1:
        return f"with {_moved(signals[0], 'slower', 'smaller')}"
    if all(signal in RATES for signal in signals):
        return f"in which only {' or only '.join(map(motion_name, signals))} moves"
    return "in which they change one at a time"


def _moved(signal: str, faster: str, larger: str) -> str:
    """Return a motion or a control with what is said of it: `faster turns`, `faster sway`, `larger rudder angles`."""
    if signal in RATES:
        return f"{faster} {'turns' if signal == 'r' else motion_name(signal)}"
    return f"{larger} {SIGNALS[signal].meaning.partition(' of ')[0]}s"


def percent(share: float) -> str:
    """Return a share in percent, two digits: `63 %`, `0.31 %`."""
    return f"{100 * share:.0f} %" if abs(share) >= 0.1 else f"{100 * share:.2g} %"


def count_below(count: float, enough: float) -> str:
    """Return a count of effective samples; one that is too low, but rounds to what is enough, with a digit, cut and not rounded."""
    return f"{floor(10 * count) / 10:.1f}" if round(count) >= enough > count else f"{count:.0f}"


def listed(names: Sequence[str]) -> str:
    """Return the names as a sentence has them: `a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def with_advice(words: str, advice: str) -> str:
    """Return in one sentence what was found and what to do; the former alone where there is no advice."""
    return f"{words}; {advice}" if advice else words


def measured(value: float, sd: float, unit: str) -> str:
    """Return a value to two digits of its standard deviation, as in `-5.70 +- 0.04 kg/s`.

    Args:
        value: in `unit`.
        sd: its standard deviation, in `unit`.
        unit: as it is printed.
    """
    decimals = 1 - floor(log10(sd)) if sd > 0 else 4
    number = (
        f"{value:.{max(decimals, 0)}f} +- {sd:.{max(decimals, 0)}f}" if decimals < 5 else f"{value:.4g} +- {sd:.2g}"
    )
    return number if unit == "1" else f"{number} {unit}"
