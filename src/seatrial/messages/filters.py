"""Messages about the tuning of a filter: which of P, Q and R to change, and in which direction."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy, Template


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.filters import tuning

    return {name: value for name, value in vars(tuning).items() if isinstance(value, float)}


def _chased(values: Mapping[str, Any]) -> str:
    if "chased" not in values:
        return ""
    return ", and innovations of {chased} are correlated in time ({correlation:+.2f}): the filter chases the noise"


def _sds(verb: str) -> Template:
    def words(values: Mapping[str, Any]) -> str:
        pairs = zip(values["subject"], values["sds"], strict=True)
        return f"{verb} R of " + ", ".join(f"{name} to a standard deviation of {sd:.2g} or less" for name, sd in pairs)

    return words


def _entry(
    title: str, sentence: Template, meaning: str, decided: str, code: str, subject: tuple[str, ...], **values: Any
) -> Entry:
    """Return an entry with one remedy, of the same name as its code."""
    return Entry(title, sentence, meaning, decided, Finding(code, "caution", subject, values, (code,)))


_C, _S = ("X_uabsu", "T_nabsn"), ("u",)
_BAND = "Beyond the band of chance, whose false alarms have a probability of {LEVEL:g}"
ENTRIES = {
    "p-too-small": _entry(
        "P too small",
        "the constants moved {ratio:.0f} times as far from their first values as P_0 allows",
        "The filter trusts its first values too much, which hides other faults.",
        f"{_BAND}, of the normalised distance that the constants moved.",
        "p-too-small",
        _C,
        ratio=4.0,
    ),
    "p-too-large": _entry(
        "P too large",
        "P_0 expects the constants to move {ratio:.3g} times as far as they did, so that the first estimates jump about",
        "The first estimates follow the noise.",
        f"{_BAND}, of the normalised distance that the constants moved.",
        "p-too-large",
        _C,
        ratio=20.0,
    ),
    "estimate-erratic": _entry(
        "Erratic estimate",
        "the estimate of {subject[0]} is erratic: it travels {ratio:.1f} times as far as it should",
        "The filter forgets its data and follows the noise.",
        "A total variation of {ERRATIC:g} times that of a tuned filter in the second half.",
        "estimate-erratic",
        _C[:1],
        ratio=3.0,
    ),
    "sd-growing": _entry(
        "Growing uncertainty",
        "the standard deviation of {subject[0]} grew by {change:.0%} over the last quarter",
        "Process noise adds more uncertainty than the end of the trial takes away.",
        "The standard deviation at the end is {GROWING_RATIO:g} times that at three quarters of the record.",
        "sd-growing",
        _C[:1],
        change=0.2,
    ),
    "not-settled": _entry(
        "Not settled",
        "the standard deviation of {subject[0]} still fell by {change:.0%} over the last quarter: it has not settled",
        "A longer trial would still reduce the uncertainty considerably.",
        "Below {SHRINKING_RATIO:g} of its value at three quarters; 0.87 is usual.",
        "not-settled",
        _C[:1],
        change=0.4,
    ),
    "states-beyond-stated": _entry(
        "Errors larger than stated",
        "errors squared are {ratio:.1f} times the stated ones",
        "The model lacks an effect that Q does not cover.",
        f"{_BAND}, of the normalised error squared at the end of a simulated record.",
        "states-beyond-stated",
        (),
        ratio=6.0,
    ),
    "states-below-stated": _entry(
        "Errors smaller than stated",
        "errors squared are {ratio:.3g} times the stated ones",
        "The filter could be more precise.",
        f"{_BAND}, of the normalised error squared at the end of a simulated record.",
        "states-below-stated",
        (),
        ratio=0.05,
    ),
    "r-too-large": _entry(
        "R too large",
        "innovations are smaller than the filter expects (NIS {nis:.2g} for each measurement, expected 1), and smaller than R alone",
        "The sensor is better than stated.",
        f"{_BAND}, of the variance of the innovations over R, by {{RELEVANT:g}} at least.",
        "r-too-large",
        _S,
        nis=0.5,
        sds=(0.02,),
    ),
    "q-too-large": _entry(
        "Q too large",
        lambda values: (
            "innovations are smaller than the filter expects (NIS {nis:.2g} for each measurement, expected 1), though not smaller "
            f"than R{_chased(values)}"
        ),
        "The process noise Q exceeds the disturbances of the trial.",
        f"{_BAND}, of the mean NIS, by {{RELEVANT:g}} at least.",
        "q-too-large",
        _S,
        nis=0.6,
    ),
    "r-too-small": _entry(
        "R too small",
        lambda values: (
            f"innovations are larger than the filter expects (NIS {{nis:.3g}} for each measurement, expected 1){_chased(values)}"
        ),
        "The sensor is noisier than stated.",
        f"{_BAND}, of the mean NIS, by {{RELEVANT:g}} at least, without positive correlation.",
        "r-too-small",
        _S,
        nis=1.5,
        sds=(0.05,),
    ),
    "innovations-sluggish": _entry(
        "Filter too sluggish",
        "innovations of {channel} are correlated in time ({correlation:+.2f}): the filter trusts its model too much",
        "The estimates lag behind the measurements.",
        "A correlation of neighbours above {RELEVANT:g}, and a p-value of whiteness below {LEVEL:g}.",
        "innovations-sluggish",
        _S,
        channel="u",
        correlation=0.3,
    ),
    "innovations-chasing": _entry(
        "Filter chases the noise",
        "innovations of {channel} are correlated in time ({correlation:+.2f}): the filter chases the noise",
        "The filter follows each error of the sensor.",
        "A correlation of neighbours below minus {RELEVANT:g}, and a p-value of whiteness below {LEVEL:g}.",
        "innovations-chasing",
        _S,
        channel="u",
        correlation=-0.3,
    ),
}
REMEDIES = {
    "p-too-small": Remedy(command="raise P_0 of {subject:and}, then check again"),
    "p-too-large": Remedy(command="lower P_0 of {subject:and}"),
    "estimate-erratic": Remedy(command="lower Q of {subject[0]}"),
    "sd-growing": Remedy(command="lower Q of {subject[0]}, or end the trial before it goes quiet"),
    "not-settled": Remedy(command="run the trial longer"),
    "states-beyond-stated": Remedy(command="raise Q, or look for a missing term of the model"),
    "states-below-stated": Remedy(command="lower Q"),
    "r-too-large": Remedy(command=_sds("lower")),
    "q-too-large": Remedy(command="lower Q of {subject:and}"),
    "r-too-small": Remedy(command=_sds("raise")),
    "innovations-sluggish": Remedy(command="raise Q of {subject:and}"),
    "innovations-chasing": Remedy(command="lower Q of {subject:and}"),
}
