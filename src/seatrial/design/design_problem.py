"""A trial to be designed: the vehicle and its sensors, what is believed of it, the designs to choose from, and what makes one the best."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.random_keys import random_key
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.design.cost import ElectricPower
from seatrial.design.fisher_utilities import Discrimination, find_criterion
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.prior_belief import Belief, coefficient_space, draw_values, normal_of
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.stated_prediction import Prediction
from seatrial.design.sweep import Trim
from seatrial.design.trial_plan import TrialPlan, plan_trial
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.square_root import MAX_UNROLLED_STATES, unscented_filter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.model import VehicleModel

Utility = Literal["entropy", "fisher-d", "fisher-a", "fisher-e", "fisher-me", "fisher-c", "discrimination"]
DesignFilter = Literal["square-root-unscented", "unscented", "extended"]
Over = Literal["mean", "local", "worst"]
Per = Literal["trial", "joule", "second"]
HALF = 400  # Draws of the priors behind each probability of staying inside the limits
UTILITY_DRAWS = 32  # Draws over which a utility is averaged, the same for all designs
# Of these a number has no unit
_WITHOUT_UNIT = ("fisher-a", "fisher-e")


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """What every search of a trial is given; k coefficients, S draws. Build it with `make_design_problem`.

    Attributes:
        model: vehicle; its k coefficients are what the trial is to tell.
        belief: of them, SI.
        families: shapes of the driven control, with its trim and timing.
        amplitudes: changes from trim, SI.
        periods: s.
        noise: standard deviation of each measured channel, SI.
        start: state at the first sample, SI.
        trim: value at which each command is held that is not driven, SI: controls, then set-points of the autopilot.
        rates: samples a second of sensors that are slower than the families' sample time, 1/s.
        limits: of commands, by name, SI.
        motion: limits of the motion.
        probability: with which these are kept.
        autopilot: through which designs act; None if they act on the controls.
        process: standard deviation that each state gains in one second, SI; None for none.
        utility: what is to be large; a function of one's own takes information matrices, SI, shape (..., k, k), and may have a `unit`.
        over: the mean of draws of what is believed, its mean alone, or the worst draw.
        per: what a utility is counted by.
        turnaround: time that a trial takes beside its own, s, counted by the second.
        power: what a trial draws, counted by the joule.
        filter: whose entropy reduction is predicted.
        prediction: what `fisher-c` makes precise.
        rivals: coefficients that each rival structure lacks, separated by `discrimination`.
        seed: of all draws.
        drawn: coefficients drawn from the belief, SI, shape (S, k); None to draw them here.
        place: names a setting such as `design.per`, for errors.
    """

    model: VehicleModel
    belief: Belief
    families: tuple[Family, ...]
    amplitudes: Float[np.ndarray, " A"]
    periods: Float[np.ndarray, " P"]
    noise: Mapping[str, float]
    start: tuple[float, ...]
    trim: Mapping[str, float]
    rates: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, Limits] = field(default_factory=dict)
    motion: tuple[MotionLimit, ...] = ()
    probability: float = 0.95
    autopilot: Autopilot | None = None
    process: tuple[float, ...] | None = None
    utility: Utility | Callable[[Array], Array] = "entropy"
    over: Over = "mean"
    per: Per = "trial"
    turnaround: float = 0.0
    power: ElectricPower | None = None
    filter: DesignFilter = "square-root-unscented"
    prediction: Prediction | None = None
    rivals: tuple[frozenset[str], ...] = ()
    seed: int = 0
    drawn: Float[np.ndarray, "S k"] | None = None
    place: Callable[[str], str] = str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return tuple(term.text for term in self.model.coefficients)

    @property
    def family(self) -> Family:
        """The first family: control, trim and timing of searches that are of no family."""
        return self.families[0]

    @property
    def driven(self) -> Limits:
        """Limits of the control that it drives, SI."""
        return self.limits.get(self.family.control, Limits())

    @cached_property
    def normal(self) -> Gaussian:
        """The belief as a joint normal, SI."""
        return normal_of(self.belief)

    @cached_property
    def draws(self) -> Float[np.ndarray, "S k"]:
        """Coefficients drawn from the belief, SI: the first half chooses designs, the second judges the one that is chosen."""
        return self.draws_for("draws of the design") if self.drawn is None else self.drawn

    @property
    def fresh(self) -> Float[np.ndarray, "S k"]:
        """The half of the draws that has no part in a choice."""
        return self.draws[len(self.draws) // 2 :]

    def draws_for(self, purpose: str) -> Float[np.ndarray, "S k"]:
        """Return draws of their own for one piece of work, SI, in the same two halves."""
        return draw_values(self.belief, random_key(self.seed, purpose), 2 * HALF)

    def trim_of(self, family: Family) -> Trim:
        """Every command with its trim value under designs of a family, SI."""
        return tuple((name, family.trim if name == family.control else value) for name, value in self.trim.items())

    def others(self, family: Family) -> dict[str, Limits]:
        """Return the limits of other commands than a family drives, which its designs may move, SI."""
        return {name: bounds for name, bounds in self.limits.items() if name != family.control}

    def measured(self, count: int, step: float) -> Float[np.ndarray, "n m"]:
        """Return 1 if each sensor gives a sample in a trial of so many samples, `step` s apart, 0 between."""
        steps = [max(1, round(1.0 / (self.rates[name] * step))) if name in self.rates else 1 for name in self.noise]
        return np.column_stack([(np.arange(count) % every == 0).astype(float) for every in steps])

    def plan(self, family: Family | None = None) -> TrialPlan:
        """Return the plan of trials of a family, of the first if none is given."""
        family = family or self.family
        return self.plan_of(family.time().size, family.sample_time)

    def plan_of(self, count: int, step: float, every_sample: bool = False) -> TrialPlan:
        """Return the plan of a trial of so many samples, `step` s apart; measured at `every_sample`, or as the sensors measure."""
        mask = None if every_sample else self.measured(count, step)
        return plan_trial(self.model, self.start, self.noise, count, step, mask, self.autopilot, self.process)

    def space(self, family: Family) -> tuple[StateSpace, Float[np.ndarray, " k"]]:
        """Return the state space of a trial of a family, and the standard deviations in whose units its coefficients are."""
        if (
            family.sample_time not in self._spaces
        ):  # one object for all rows of a grid, so that programs are compiled once
            process = np.array(self.process or np.zeros(len(self.model.states)))
            gained = process * np.sqrt(family.sample_time)
            made = coefficient_space(self.model, self.normal, self.start, self.noise, gained)
            self._spaces[family.sample_time] = made
        return self._spaces[family.sample_time]

    @cached_property
    def _spaces(self) -> dict[float, tuple[StateSpace, Float[np.ndarray, " k"]]]:
        return {}

    def filter_of(self, n_states: int) -> Filter:
        """Return the filter whose entropy reduction is predicted, for so many states.

        Raises:
            InputError: a filter that does not do for as many.
        """
        if self.filter == "square-root-unscented":
            return unscented_filter(n_states)
        if n_states > 2 * MAX_UNROLLED_STATES:
            raise InputError(
                self.place("design.filter"),
                found=f'"{self.filter}" for {n_states} states and coefficients',
                expected=f"at most {2 * MAX_UNROLLED_STATES}: it is compiled number by number",
                remedy='set filter = "square-root-unscented"',
            )
        return UnscentedKalmanFilter() if self.filter == "unscented" else ExtendedKalmanFilter()

    def few(self, draws: Float[np.ndarray, "S k"]) -> Float[np.ndarray, "s k"]:
        """Return the draws over which a utility is taken: their mean alone where it is local."""
        return draws.mean(0)[None] if self.over == "local" else draws[:UTILITY_DRAWS]

    def criterion(self, draws: Float[np.ndarray, "S k"]) -> Callable[[Array], Array]:
        """Return the criterion of the information about the coefficients, as they are believed by some draws of them, SI.

        Raises:
            InputError: `fisher-c` without a prediction.
        """
        if not isinstance(self.utility, str):
            return self.utility
        cov, name = covariance(draws), "fisher-d" if self.utility == "entropy" else self.utility
        if name == "discrimination":
            absent = [[name in lost for name in self.names] for lost in self.rivals]
            if absent:
                return Discrimination(self.few(draws), np.array(absent, bool), cov)
            name = (
                "fisher-d"  # the smallest structure was chosen: what settles it against others is searched beside this
            )
        if name != "fisher-c":
            return find_criterion(name, cov)
        if self.prediction is None:
            raise InputError(
                self.place("design.utility"),
                found='"fisher-c" without a prediction',
                expected="the prediction to improve",
                remedy="state it beside the utility",
            )
        return find_criterion(name, cov, self.prediction.at(draws.mean(0))[1])

    def utilities(
        self,
        plan: TrialPlan,
        controls: Float[np.ndarray, "D n c"],
        draws: Float[np.ndarray, "S k"],
        believed: Float[np.ndarray, "B k"] | None = None,
    ) -> Float[np.ndarray, " D"]:
        """Return what designs are worth over some draws by the criterion of what is `believed`, or of these draws.

        Raises:
            NumericalError: the motion diverges at a draw.
        """
        criterion = self.criterion(draws if believed is None else believed)
        table = utility_table(plan, controls, self.few(draws), criterion)
        return table.min(1) if self.over == "worst" else table.mean(1)

    @property
    def utility_unit(self) -> str:
        """Unit of the utility of one trial."""
        if not isinstance(self.utility, str):
            return getattr(self.utility, "unit", "")
        return "" if self.utility in _WITHOUT_UNIT else "nat"

    @property
    def unit(self) -> str:
        """Unit of what makes a design the best."""
        return self.utility_unit + {"joule": "/J", "second": "/s", "trial": ""}[self.per]

    def safety_lines(
        self,
        plan: TrialPlan,
        control: Float[np.ndarray, "n c"],
        draws: Float[np.ndarray, "S k"],
        samples: int | None = None,
    ) -> tuple[str, ...]:
        """Return how surely one design keeps each limit of the motion, on draws that had no part in choosing it; nothing without limits."""
        if not self.motion:
            return ()
        ends = None if samples is None else np.array([samples])
        return tuple(judge_safety(plan, control[None], draws, self.motion, self.probability, samples=ends).words(0))

    def prediction_lines(self, plan: TrialPlan, control: Float[np.ndarray, "n c"]) -> tuple[str, ...]:
        """Return how well the stated prediction is known now and after a design; nothing if there is none."""
        wanted, name = self.prediction, self.family.control
        if wanted is None:
            return ()
        mean, (drive, drive_unit) = self.draws.mean(0), shown_unit(name)
        value, gradient = wanted.at(mean)
        before = covariance(self.draws)
        after = np.linalg.inv(np.linalg.inv(before) + np.asarray(plan.information(mean, control)))
        factor, unit = shown_unit(wanted.of)
        now, then = (float(np.sqrt(gradient @ cov @ gradient)) * factor for cov in (before, after))
        stated = dict(zip(self.model.controls, wanted.control, strict=True)).get(name, self.family.trim)
        return (
            f"{wanted.of} {wanted.after:g} s after {name} is set to {stated * drive:.4g} {drive_unit}: "
            f"{value * factor:.4g} {unit}, "
            f"known to ± {now:.2g} {unit} now and ± {then:.2g} {unit} after it",
        )


def covariance(draws: Float[np.ndarray, "S k"]) -> Float[np.ndarray, "k k"]:
    """Return the covariance of draws of coefficients."""
    return np.atleast_2d(np.cov(draws, rowvar=False))


def check_whole_trials(per: Per, place: Callable[[str], str], search: str, joules: bool = False) -> None:
    """Check that designs are of full length, as a search takes them, and worth what one trial teaches.

    Args:
        per: what a utility is counted by.
        place: names a setting, for errors.
        search: in words.
        joules: whether it may stand beside designs that are counted per joule.

    Raises:
        InputError: seconds are counted, or joules where the search cannot.
    """
    if per == "second" or (per == "joule" and not joules):
        why = "knows trials of full length only" if per == "second" else "does not count joules"
        raise InputError(
            place("design.per"),
            found=f'"{per}" with {search}, which {why}',
            expected='"trial" or "joule"' if joules else '"trial"',
            remedy=f'set per = "trial", or leave out {search}',
        )
