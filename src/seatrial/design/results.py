"""Stored designs: sweeps, a schedule of one's own, the free-form trial, the self-oscillating test, the global search, measures."""

import json
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from jaxtyping import Float

from seatrial.core.dataset import Dataset
from seatrial.core.display_units import Shown, shown_unit
from seatrial.design.utility_agreement import EXPECTED, Agreement, compare_utilities


@dataclass(frozen=True, eq=False)
class SweptDesigns:
    """Every design of the families on one grid of amplitudes and periods, SI, NaN if a limit is broken.

    Attributes:
        families: kinds of the manoeuvres.
        control: channel that is driven.
        trim: every control with its trim value.
        amplitude: of the control about its trim.
        period: of the shape, s.
        gain: entropy reduction of the coefficients, nats.
        worth: what makes a design the best.
        peak_speed: largest magnitude of the first state in the expected motion.
        final_sd: predicted standard deviations after the trial.
        length: time at which the trial is ended, s.
        names: coefficients.
        sd_before: their standard deviations before the trial.
        basis: the belief behind the designs, in words.
        refused: families without a design inside the limits, and why.
        safety: probability that the best design keeps each limit of the motion.
        prediction: precision of the stated prediction before and after it.
        unit: of `worth`.
    """

    families: Annotated[tuple[str, ...], "family"]
    control: str
    trim: tuple[tuple[str, float], ...]
    amplitude: Float[np.ndarray, " amplitude"] = field(metadata={"units": "SI"})
    period: Float[np.ndarray, " period"] = field(metadata={"units": "s"})
    gain: Float[np.ndarray, "family amplitude period"] = field(
        metadata={"units": "nat", "long_name": "entropy reduction of the coefficients"}
    )
    worth: Float[np.ndarray, "family amplitude period"] = field(
        metadata={"long_name": "criterion of the best design, in `unit`"}
    )
    peak_speed: Float[np.ndarray, "family amplitude period"] = field(
        metadata={"long_name": "largest magnitude of the first state"}
    )
    final_sd: Float[np.ndarray, "family amplitude period coefficient"] = field(
        metadata={"units": "SI", "long_name": "predicted sd after the trial"}
    )
    length: Float[np.ndarray, "family amplitude period"] = field(
        metadata={"units": "s", "long_name": "time at which the trial is ended"}
    )
    names: Annotated[tuple[str, ...], "coefficient"]
    sd_before: Float[np.ndarray, " coefficient"] = field(metadata={"units": "SI", "long_name": "sd before the trial"})
    basis: str
    refused: dict[str, str]
    safety: tuple[str, ...]
    prediction: tuple[str, ...]
    unit: str

    @property
    def best(self) -> tuple[int, int, int]:
        """Family, row of the amplitude and column of the period of the best design."""
        family, row, column = np.unravel_index(np.nanargmax(self.worth), self.worth.shape)
        return int(family), int(row), int(column)

    @property
    def shown_amplitude(self) -> tuple[np.ndarray, str]:
        """Amplitudes in the unit in which the control is shown, and that unit."""
        factor, unit = shown_unit(self.control)
        return self.amplitude * factor, unit


@dataclass(frozen=True)
class BestDesign:
    """The best design of a family, SI, and its expected results.

    Attributes:
        family: kind of the manoeuvre.
        control: channel that is driven.
        unit: SI unit of the control.
        trim: value of the control about which it is driven.
        amplitude: of the control about its trim.
        period: of the shape, s.
        gain_nat: entropy reduction of the coefficients.
        worth: its value by the criterion of the best design.
        sd_before: standard deviation of each coefficient before the trial.
        sd_after: expected after it.
    """

    family: str
    control: str
    unit: str
    trim: float
    amplitude: float
    period: float
    gain_nat: float
    worth: float
    sd_before: dict[str, float]
    sd_after: dict[str, float]


POPULATION = 16  # Designs of one family that a global search evaluates at once


@dataclass(frozen=True, eq=False)
class Measures:
    """Every measure of some designs, as stored: each by `design`, and `error`, the Monte Carlo error of the expected gain."""

    data: Dataset

    @property
    def agreements(self) -> tuple[Agreement, ...]:
        """Each cheap measure beside the expected gain."""
        cheap = {name: self.data[name].values for name in self.data.data_vars if name not in (EXPECTED, "error")}
        return compare_utilities(
            {str(name): x for name, x in cheap.items()}, self.data[EXPECTED].values, self.data["error"].values
        )

    def lines(self) -> list[str]:
        """The best design by the expected gain, and how each cheap measure ranks them."""
        gain, best = self.data[EXPECTED].values, int(np.argmax(self.data[EXPECTED].values))
        error = float(self.data["error"].values[best])
        return [
            f"of {gain.size} designs the {self.data['design'].values[best]} has the largest {EXPECTED}: {gain[best]:.2f} ± {error:.2g} "
            f"nat; the least has {gain.min():.2f}",
            *(agreement.words for agreement in self.agreements),
            *json.loads(self.data.attrs["refused"]),
        ]


@dataclass(frozen=True)
class FreeTrial:
    """The trial found, and its information next to that of the best family.

    Attributes:
        levels: of the control, SI, each held as long as the others.
        utility: mean of the D criterion over draws of the priors, nats, whatever the utility of the campaign.
        beside: the same of the best design of the families.
        family: name of that one.
        at_bounds: share of the levels at a bound.
        active: limits that hold it back.
        safety: how surely each limit of the motion is kept, on fresh draws.
        starts: name and utility in nats of each start, before and after.
        status: of the search.
    """

    levels: tuple[float, ...]
    utility: float
    beside: float
    family: str
    at_bounds: float
    active: tuple[str, ...]
    safety: tuple[str, ...]
    starts: tuple[tuple[str, float, float], ...]
    status: str

    def lines(self) -> list[str]:
        """In words."""
        held = f"; held back by {', '.join(self.active)}" if self.active else ""
        return [
            f"free-form design by the D criterion: {self.utility:.2f} nat, the best of the families ({self.family}) "
            f"{self.beside:.2f} nat by the same measure; {self.at_bounds:.0%} of {len(self.levels)} levels at a bound{held}",
            *(f"start {name}: {before:.2f} nat, then {after:.2f}" for name, before, after in self.starts),
            self.status,
            *self.safety,
        ]


@dataclass(frozen=True)
class OwnTrial:
    """A schedule of one's own, and what it is worth beside the best of the families.

    Attributes:
        source: name of its file.
        duration: s.
        utility: over draws of what is believed, by the campaign's criterion; the D criterion where that is the filter's entropy.
        beside: the same of the best design of the families.
        best: that one, in words.
        best_duration: s.
        unit: of the utility.
        names: coefficients.
        units: of them, SI.
        sd: their standard deviations after it, SI.
        sd_beside: the same after the best design.
        safety: how surely each limit of the motion is kept.
        is_safe: whether all are with the probability asked for.
        probability: that one.
    """

    source: str
    duration: float
    utility: float
    beside: float
    best: str
    best_duration: float
    unit: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    sd: tuple[float, ...]
    sd_beside: tuple[float, ...]
    safety: tuple[str, ...]
    is_safe: bool
    probability: float

    def lines(self, shown: Shown) -> list[str]:
        """In words, with coefficients in the units in which they are shown."""
        worth, beside = (f"{value:.2f} {self.unit}".rstrip() for value in (self.utility, self.beside))
        rows = zip(self.names, self.units, self.sd, self.sd_beside, strict=True)
        sds = (_both(shown(name, unit), name, own, best) for name, unit, own, best in rows)
        return [
            f"your schedule {self.source}, {self.duration:.4g} s: {worth}; the best of the families ({self.best}), "
            f"{self.best_duration:.4g} s: {beside} by the same measure",
            f"  expected after your schedule, in brackets after the best of the families: {', '.join(sds)}",
            *(f"  {line}" for line in self.safety),
        ]

    @property
    def alarms(self) -> list[str]:
        """That it may leave the limits of the motion."""
        sentence = f"{self.source} may leave the limits of the motion, which {self.probability:g} of the vehicles must keep: shorten it"
        return [] if self.is_safe else [f"{sentence}, lower its amplitude, or widen [limits]"]


def _both(shown: tuple[float, str], name: str, own: float, best: float) -> str:
    factor, unit = shown
    return f"{name} ± {own * factor:.2g} {unit} ({best * factor:.2g})"


@dataclass(frozen=True)
class RelayTrial:
    """The test found, and its information next to that of the best open-loop family.

    Attributes:
        control: channel that is switched.
        output: channel that is fed back.
        amplitude: of the control about its trim, SI.
        threshold: of the output about its trim, SI.
        effect: +1 if more control raises the output, -1 if it lowers the output.
        gain: entropy reduction by the filter at the prior means, nats.
        utility: expected entropy reduction by Fisher information over draws of the priors, nats.
        beside: the same of the best design of the families.
        family: name of that one.
        oscillates: share of the vehicles in which the control is reversed twice at least.
        reversals: 5, 50 and 95 % quantiles of their number over the vehicles.
        period: likewise, s; of those that oscillate.
        first_overshoot: likewise, SI.
        second_overshoot: likewise, SI.
        passed_over: more informative designs that may not oscillate or may break a limit.
        safety: how surely each limit of the motion is kept, on draws that had no part in choosing it.
    """

    control: str
    output: str
    amplitude: float
    threshold: float
    effect: float
    gain: float
    utility: float
    beside: float
    family: str
    oscillates: float
    reversals: tuple[float, ...]
    period: tuple[float, ...]
    first_overshoot: tuple[float, ...]
    second_overshoot: tuple[float, ...]
    passed_over: int
    safety: tuple[str, ...]

    @property
    def rule(self) -> str:
        """What the operator or the autopilot does."""
        (c, c_unit), (y, y_unit) = shown_unit(self.control), shown_unit(self.output)
        first, second = ("+", "-") if self.effect > 0 else ("-", "+")
        return (
            f"begin with {self.control} {self.amplitude * c:.4g} {c_unit} above trim; below trim once {self.output} is "
            f"{first}{self.threshold * y:.4g} {y_unit} from its trim, above again once it is {second}{self.threshold * y:.4g} {y_unit}"
        )

    def lines(self) -> list[str]:
        """In words."""
        (c, c_unit), (y, y_unit) = shown_unit(self.control), shown_unit(self.output)
        low, middle, high = (value * y for value in self.first_overshoot)
        after = [value * y for value in self.second_overshoot]
        return [
            f"self-oscillation of ±{self.amplitude * c:.4g} {c_unit} in {self.control}, reversed at ±{self.threshold * y:.4g} {y_unit} "
            f"of {self.output}: {self.gain:.2f} nat",
            f"over the priors {self.utility:.2f} nat, the best of the families ({self.family}) {self.beside:.2f} nat by the same measure",
            f"{self.reversals[1]:g} reversals (90 % of vehicles {self.reversals[0]:g} to {self.reversals[2]:g}), period "
            f"{self.period[1]:.3g} s ({self.period[0]:.3g} to {self.period[2]:.3g}), first overshoot {middle:.3g} {y_unit} "
            f"({low:.3g} to {high:.3g}), second {after[1]:.3g} {y_unit} ({after[0]:.3g} to {after[2]:.3g})",
            f"it oscillates in {self.oscillates:.0%} of the vehicles that the priors allow",
            *(
                (
                    f"{self.passed_over} more informative design{'s' * (self.passed_over != 1)} may not oscillate, or break a limit",
                )
                if self.passed_over
                else ()
            ),
            *self.safety,
            self.rule,
        ]


@dataclass(frozen=True)
class Searched:
    """The design found.

    Attributes:
        kind: of its family.
        amplitude: SI.
        period: s.
        utility: on draws that had no part in the search.
        beside: the same of the best design of the grid.
        grid: that one, in words.
        evaluations: designs evaluated.
        settled: whether the search of its family had come to rest.
        safety: how surely each limit of the motion is kept, on fresh draws.
        refused: families without a design inside the limits.
        unit: of the utility.
        budget: designs asked for.
    """

    kind: str
    amplitude: float
    period: float
    utility: float
    beside: float
    grid: str
    evaluations: int
    settled: bool
    safety: tuple[str, ...]
    refused: tuple[str, ...]
    unit: str
    budget: int


def edge_words(amplitudes: int, periods: int, best: tuple[int, int]) -> str:
    """Report that the best of a grid of designs lies on its edge, and which key to widen; empty if it does not.

    Args:
        amplitudes: in the grid; of one alone nothing is said.
        periods: likewise.
        best: indices of the best amplitude and period.
    """
    sizes = zip(("amplitude", "period"), best, (amplitudes, periods), strict=True)
    edges = [name for name, at, size in sizes if size > 1 and at in (0, size - 1)]
    if not edges:
        return ""
    keys = " and ".join(f"design.{name}" for name in edges)
    lies = "lies" if len(edges) == 1 else "lie"
    return f"the best {' and '.join(edges)} {lies} on the edge of the grid: widen {keys} if the limits allow it"
