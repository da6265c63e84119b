"""The next trial of one vehicle: of some families, amplitudes and periods the one that is worth most; and any other search of a trial."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Integral
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

import jax
import numpy as np
from jaxtyping import Array

from seatrial.compiled.batching import on_accelerator
from seatrial.compiled.engine import check_precision
from seatrial.compiled.programs import program
from seatrial.core.argument_checks import (
    check_array,
    check_choice,
    check_each_of,
    check_kind,
    check_number,
    check_numbers,
)
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.result_table import table_html, table_text
from seatrial.core.signals import signal_unit
from seatrial.design.cost import expected_joules, gain_per_cost
from seatrial.design.design_problem import HALF, UTILITY_DRAWS, DesignProblem, Utility, covariance
from seatrial.design.fisher_utilities import CRITERIA, find_criterion
from seatrial.design.limit_conflicts import check_some_allowed, remedy_of_any
from seatrial.design.loop_stability import check_autopilot
from seatrial.design.motion_limits import MotionLimit, check_motion_limits
from seatrial.design.prior_belief import Belief, normal_belief
from seatrial.design.results import BestDesign, edge_words
from seatrial.design.safety import judge_safety
from seatrial.design.stopping import best_stops
from seatrial.design.sweep import LANES, Sweep, in_blocks, sweep_family
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.posterior.posterior import as_key, check_priors
from seatrial.estimation.posterior.simulated_record import checked_rates
from seatrial.estimation.priors import Prior
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import Schedule
from seatrial.sampling.run import Draws
from seatrial.vehicles.model import VehicleModel

if TYPE_CHECKING:
    from pandas import DataFrame

# Arrays that a sweep has of every design
ARRAYS = ("gain", "peak_speed", "final_sd", "utility", "length")
FoundT = TypeVar("FoundT", covariant=True)


@dataclass(frozen=True, eq=False)
class TrialDesign:
    """Every design of some families, and the best of them.

    Attributes:
        sweeps: one for each family that has a design inside the limits, the best first; standard deviations in SI.
        refused: reasons of families without one, by their kind.
        sd_before: standard deviation of each coefficient before the trial, SI, by name.
        units: SI unit of each, by name.
        unit: of the criterion of the best design.
        safety: probability that the best design keeps each limit of the motion.
        prediction: precision of the stated prediction before and after it.
        basis: the belief behind the designs, in words.
    """

    sweeps: tuple[Sweep, ...]
    refused: Mapping[str, str]
    sd_before: Mapping[str, float]
    units: Mapping[str, str]
    unit: str = "nat"
    safety: tuple[str, ...] = ()
    prediction: tuple[str, ...] = ()
    basis: str = ""

    @property
    def best(self) -> Sweep:
        """Sweep of the family with the best design; its duration is that of the design if it ends early."""
        return self.sweeps[0].as_run()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return tuple(self.sd_before)

    @property
    def sd_after(self) -> dict[str, float]:
        """Standard deviation that is predicted of each coefficient after the best trial, SI, by name."""
        return self.design(self.sweeps[0]).sd_after

    @property
    def gain(self) -> float:
        """Entropy reduction that the best trial promises, nats."""
        best = self.sweeps[0]
        return float(best.gain[best.best])

    @property
    def schedule(self) -> Schedule:
        """Controls of the best trial, SI."""
        best = self.best
        row, column = best.best
        held = {name: value for name, value in best.trim if name != best.family.control}
        return best.family.schedule(float(best.amplitude[row]), float(best.period[column]), **held)

    def design(self, sweep: Sweep, at: tuple[int, int] | None = None) -> BestDesign:
        """Return a design of a sweep by its place on the grid, the best if none is given."""
        row, column = at or sweep.best
        return BestDesign(
            family=sweep.family.kind,
            control=sweep.family.control,
            unit=signal_unit(sweep.family.control),
            trim=sweep.family.trim,
            amplitude=float(sweep.amplitude[row]),
            period=float(sweep.period[column]),
            gain_nat=float(sweep.gain[row, column]),
            worth=float(sweep.worth[row, column]),
            sd_before=dict(self.sd_before),
            sd_after=dict(zip(self.sd_before, map(float, sweep.final_sd[row, column]), strict=True)),
        )

    @property
    def at_edge(self) -> str:
        """Edge of the grid with the best design, and the key to widen it; empty if the best design is inside."""
        return edge_words(self.best.amplitude.size, self.best.period.size, self.best.best)

    def summary(self) -> "DataFrame":
        """Return a table with a row for each coefficient: its SI unit, its standard deviation before and after the best trial, and the
        share of it that is left."""
        from pandas import DataFrame

        before, after = list(self.sd_before.values()), list(self.sd_after.values())
        return DataFrame(
            {
                "unit": [self.units[name] for name in self.sd_before],
                "sd_before": before,
                "sd_after": after,
                "left": np.divide(after, before),
            },
            index=list(self.sd_before),
        )

    def lines(self) -> list[str]:
        """The best of each family, and the families that have none."""
        lines = [f"{_words(sweep)}: {sweep.gain[sweep.best]:.2f} nat{self._worth(sweep)}" for sweep in self.sweeps]
        return lines + self._remarks

    def diverging(self) -> list[str]:
        """The families of which some designs are left out, because their motion diverges for vehicles of the priors."""
        counts = {sweep.family.kind: int(np.isposinf(sweep.peak_speed).sum()) for sweep in self.sweeps}
        return [
            f"{kind}: {count} of {self.best.gain.size} designs left out, because their motion diverges for vehicles of the priors"
            for kind, count in counts.items()
            if count
        ]

    def _worth(self, sweep: Sweep) -> str:
        worth, gain = sweep.worth[sweep.best], sweep.gain[sweep.best]
        return "" if worth == gain else f"; utility {worth:.3g} {self.unit}".rstrip()

    @property
    def _heading(self) -> str:
        return self.lines()[0]

    @property
    def _remarks(self) -> list[str]:
        return [f"{kind}: no design, {why}" for kind, why in self.refused.items()] + self.diverging()

    __repr__ = table_text
    _repr_html_ = table_html


Beside = Callable[[], TrialDesign]
"""Designs of the families, the best of which the result of another search is compared with; swept or read when they are needed."""


class Search(Protocol[FoundT]):
    """A way to find a trial; implementations are frozen dataclasses of what is asked for."""

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> FoundT:
        """Return what was found.

        Args:
            problem: what is to be designed.
            beside: see `Beside`.
            reporter: receives the progress.

        Raises:
            InputError: a problem that the search does not do for, or no design inside the limits.
            NumericalError: the motion diverges at a draw of what is believed.
        """
        ...


class GridRows(NamedTuple):
    """Some rows of one family's grid: their amplitudes from `first` to before `last`."""

    family: int
    first: int
    last: int


RowsDone = tuple[GridRows, Sweep | InputError | NumericalError]
Runner = Callable[[Sequence[GridRows], Callable[[int, RowsDone], GridRows | None]], None]
"""Sweeps some rows by `sweep_rows`, and gives each to a function, which may ask for further ones."""


@dataclass(frozen=True)
class GridSearch:
    """Every amplitude and period of every family, predicted by a filter over the motion that is expected.

    Attributes:
        run: sweeps rows of the grid elsewhere, such as in other processes; None to sweep them here.
    """

    run: Runner | None = None

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> TrialDesign:
        """See `Search`."""
        check_autopilot(problem, reporter)
        families, scales = problem.families, np.asarray(problem.normal.sd)
        count = len(families) * problem.amplitudes.size * problem.periods.size
        report = reporter.progress(f"design: {count} trial{'s' * (count != 1)}")
        sweeps, errors = _sweep_all(problem, self.run or partial(_run_here, problem), report)
        if len(families) == 1 and errors:
            raise next(iter(errors.values()))
        refused = {
            kind: error.sentence(with_remedy=False) if isinstance(error, InputError) else str(error)
            for kind, error in errors.items()
        }
        if not sweeps:
            raise InputError(
                problem.place("design"),
                found="of all families none:" + "".join(f"\n    {kind}: {why}" for kind, why in refused.items()),
                expected="at least one design inside the limits",
                remedy=remedy_of_any(errors.values()),
            )
        best = max(sweeps, key=lambda sweep: np.nanmax(sweep.worth))
        plan, control = problem.plan(best.family), best.best_controls()
        samples = None if best.length is None else int(_samples(best, best.length[best.best]))
        return TrialDesign(
            tuple(
                replace(sweep, final_sd=sweep.final_sd * scales)
                for sweep in sorted(sweeps, key=lambda sweep: -sweep.worth[sweep.best])
            ),
            refused,
            dict(zip(problem.names, map(float, scales), strict=True)),
            {term.text: problem.model.unit_of(term) for term in problem.model.coefficients},
            problem.unit,
            problem.safety_lines(plan, control, problem.fresh, samples),
            problem.prediction_lines(plan_as_run(plan, best), control),
        )


def design_trial(
    problem: DesignProblem,
    search: Search[Any] = GridSearch(),
    beside: TrialDesign | Beside | None = None,
    reporter: Reporter = SILENT,
) -> Any:
    """Design a trial: predict the information of every design, or search one in another way.

    Args:
        problem: of `make_design_problem`.
        search: how; by default every design of the grid of the families, by a filter over the expected motion.
        beside: result of the default search, or what returns it, which that of another search is compared with; found here if not given.
        reporter: receives the progress.

    Returns:
        a `TrialDesign` with every design, its entropy reduction in nats, and the best; another search has another result.

    Raises:
        InputError: no design inside the limits, or a problem that the search does not do for.
        NumericalError: the expected motion diverges for a design inside the limits.
    """
    swept = partial(design_trial, problem, reporter=reporter) if beside is None else beside
    return search.find(problem, (lambda: swept) if isinstance(swept, TrialDesign) else swept, reporter)


def make_design_problem(
    model: VehicleModel,
    belief: Draws | Mapping[str, Prior],
    families: Family | Sequence[Family],
    amplitude: Sequence[float],
    period: Sequence[float],
    noise: Mapping[str, float],
    *,
    start: Mapping[str, float] | None = None,
    held: Mapping[str, float] | None = None,
    limits: Limits | Mapping[str, Limits] = Limits(),
    rates: Mapping[str, float] | None = None,
    motion: Sequence[MotionLimit] = (),
    probability: float = 0.95,
    utility: Utility | Callable[[Array], Array] = "entropy",
    key: Array | int = 0,
) -> DesignProblem:
    """State the trial to design, for `design_trial`.

    Args:
        model: vehicle; its free coefficients are to be determined.
        belief: draws of a posterior, or priors, of its coefficients by name, SI.
        families: shapes of the driven control, with its trim and timing.
        amplitude: changes from trim, SI.
        period: s.
        noise: standard deviation of each measured channel, SI.
        start: state at the first sample, signal name to SI value; 0 if not stated.
        held: constant value of every other control, SI.
        limits: bounds of the driven control, or of several by name.
        rates: samples a second of sensors that are slower than the families' sample time, 1/s.
        motion: limits of the motion.
        probability: required, that these are kept.
        utility: what is to be large: "entropy" of the filter; a criterion of Fisher information, such as "fisher-d"; or a function of your
            own, which takes information matrices of the k coefficients, SI, shape (..., k, k), and returns shape (...). It is averaged
            over draws of the belief, and an attribute `unit` of it is printed.
        key: random key of all draws, or a seed.

    Raises:
        InputError: something unknown of a coefficient or a control, an amplitude of 0, or a rate that no schedule of the families can have.
    """
    check_precision()
    check_kind(
        model, VehicleModel, "model", 'build it of a vehicle: load_vehicle("remus100_surge").build(free=["X_u"])'
    )
    shapes = [families] if isinstance(families, Family) else families
    chosen = tuple(check_each_of(shapes, Family, "families", "give one Family, or a list of them"))
    grid = check_array(amplitude, "amplitude"), check_array(period, "period")
    if still := [i for i, size in enumerate(grid[0]) if size == 0]:
        raise InputError(
            f"amplitude[{still[0]}]",
            found="0, which moves nothing",
            expected="a change from trim that is not 0",
            remedy="leave it out",
        )
    noise = check_numbers(noise, "noise", known=model.channel_units(), above=0.0)
    start = check_numbers(start, "start", known=model.states)
    held = check_numbers(held, "held", known=model.controls)
    for family in chosen:
        checked_rates(rates, noise, family.time())
    if not (noise and chosen):
        raise InputError(
            "families" if noise else "noise",
            found="none",
            expected="one family at least" if noise else "at least one measured channel",
            remedy="name the driven control" if noise else 'give its standard deviation, for example {"u": 0.02}',
        )
    for family in chosen:
        known = {**held, family.control: family.trim}
        if family.control not in model.controls or any(name not in known for name in model.controls):
            raise InputError(
                f"manoeuvre {family.kind}, controls",
                found=", ".join(known),
                expected="a value of " + ", ".join(model.controls),
                remedy="drive one of them, and give the others in `held`",
            )
    bounds = limits if isinstance(limits, Mapping) else dict.fromkeys((one.control for one in chosen), limits)
    for one in bounds.values():
        check_kind(one, Limits, "limits", "write for example Limits(upper=150.0)")
    if motion:
        check_motion_limits(model, motion)
    if isinstance(utility, str) or not callable(utility):
        check_choice(utility, ("entropy", *(name for name in CRITERIA if name != "fisher-c")), "utility")
    seed = int(key) if isinstance(key, Integral) else int(jax.random.bits(as_key(key)))
    believed, drawn = _belief(belief, tuple(term.text for term in model.coefficients), seed)
    return DesignProblem(
        model,
        believed,
        chosen,
        *grid,
        noise,
        tuple(start.get(name, 0.0) for name in model.states),
        {name: held.get(name, chosen[0].trim) for name in model.controls},
        rates=rates or {},
        limits=bounds,
        motion=tuple(motion),
        probability=check_number(probability, "probability", above=0.0, below=1.0),
        utility=utility,
        seed=seed,
        drawn=drawn,
    )


def _belief(belief: Draws | Mapping[str, Prior], names: tuple[str, ...], seed: int) -> tuple[Belief, np.ndarray | None]:
    """Return what is believed of the coefficients, SI, and draws of it if it is a posterior."""
    if isinstance(belief, Draws):
        draws = belief.array(names)
        return normal_belief(draws), draws[np.random.default_rng(seed).permutation(len(draws))[: 2 * HALF]]
    check_priors(belief, "belief")
    if missing := [name for name in names if name not in belief]:
        raise InputError(
            "belief",
            found="none of " + ", ".join(missing),
            expected="a prior of each of " + ", ".join(names),
            remedy="add them, or fix these coefficients in the vehicle",
        )
    return tuple(belief[name] for name in names), None


def sweep_rows(problem: DesignProblem, rows: GridRows) -> RowsDone:
    """Predict and weigh the designs of some rows; an error where none is inside the limits, or all diverge."""
    family = problem.families[rows.family]
    space, scales = problem.space(family)
    try:
        sweep = sweep_family(
            space,
            family,
            problem.amplitudes[rows.first : rows.last],
            problem.periods,
            problem.limits.get(family.control, Limits()),
            problem.filter_of(len(space.states)),
            problem.measured(family.time().size, family.sample_time),
            trim=problem.trim_of(family),
            others=problem.others(family),
            autopilot=problem.autopilot,
        )
        return rows, _weigh(problem, sweep, scales)
    except (InputError, NumericalError) as error:
        return rows, error


def _run_here(
    problem: DesignProblem, parts: Sequence[GridRows], done: Callable[[int, RowsDone], GridRows | None]
) -> None:
    waiting = list(enumerate(parts))
    while waiting:
        index, rows = waiting.pop(0)
        if (further := done(index, sweep_rows(problem, rows))) is not None:
            waiting.append((index, further))


def _sweep_all(
    problem: DesignProblem, run: Runner, report: Callable[[int, int], None]
) -> tuple[list[Sweep], dict[str, InputError | NumericalError]]:
    """Return the sweeps of the families that have a design inside the limits, in their order, and why the others have none."""
    amplitude, period = problem.amplitudes, problem.periods
    every = amplitude.size if on_accelerator() else max(1, -(-LANES // period.size))
    parts = [
        GridRows(family, first, min(first + every, amplitude.size))
        for family in range(len(problem.families))
        for first in range(0, amplitude.size, every)
    ]
    swept: dict[GridRows, Sweep] = {}
    refused: dict[GridRows, InputError | NumericalError] = {}

    def done(index: int, result: RowsDone) -> GridRows | None:
        rows, outcome = result
        if isinstance(outcome, Sweep):
            swept[rows] = outcome
        else:
            refused[rows] = outcome
        report(len(swept) + len(refused), len(parts))
        of_family = [one for one in parts if one.family == rows.family]
        if len(of_family) > 1 and all(one in refused for one in of_family) and rows in of_family:
            return GridRows(rows.family, 0, amplitude.size)  # only the grid as a whole says what is the gentlest design
        return None

    report(0, len(parts))
    run(parts, done)
    sweeps, reasons = [], {}
    for number, family in enumerate(problem.families):
        rows = [one for one in parts if one.family == number]
        family_sweeps = [swept.get(one) for one in rows]
        if any(family_sweeps):
            sweeps.append(_joined(rows, family_sweeps, amplitude))
        else:
            reasons[family.kind] = refused[GridRows(number, 0, amplitude.size)]
    return sweeps, reasons


def _joined(parts: Sequence[GridRows], sweeps: Sequence[Sweep | None], amplitude: np.ndarray) -> Sweep:
    """One sweep of all rows; those of refused ones are NaN."""
    known = next(sweep for sweep in sweeps if sweep is not None)

    def column(name: str) -> np.ndarray | None:
        one = getattr(known, name)
        if one is None:
            return None
        empty = [np.full((part.last - part.first, *one.shape[1:]), np.nan) for part in parts]
        return np.concatenate(
            [blank if sweep is None else getattr(sweep, name) for blank, sweep in zip(empty, sweeps, strict=True)]
        )

    return replace(known, amplitude=np.asarray(amplitude, float), **{name: column(name) for name in ARRAYS})


def _weigh(problem: DesignProblem, sweep: Sweep, scales: np.ndarray) -> Sweep:
    """Return a sweep without the designs that may leave the limits of the motion, and with what each of the others is worth.

    Where seconds are counted, all that is said of a design, its limits included, is of the trial as it is ended.
    """
    if not problem.motion and problem.utility == "entropy" and problem.per == "trial":
        return sweep
    plan, draws = problem.plan(sweep.family), problem.draws
    if problem.per == "second":
        sweep = _by_the_second(problem, plan, sweep, scales)
    rows, columns, controls = sweep.inside()
    if problem.motion:
        samples = None if sweep.length is None else _samples(sweep, sweep.length[rows, columns])
        chosen_by = draws[: len(draws) // 2]
        safety = judge_safety(plan, controls, chosen_by, problem.motion, problem.probability, samples=samples)
        places = zip(rows, columns, strict=True)
        words = tuple(sweep.words(row, column) for row, column in places)
        check_some_allowed(replace(safety, names=words))
        lost = rows[~safety.allowed], columns[~safety.allowed]
        kept = {
            name: np.array(getattr(sweep, name)) for name in ("gain", "utility") if getattr(sweep, name) is not None
        }
        for worth in kept.values():
            worth[lost] = np.nan
        sweep = replace(sweep, **kept)
        rows, columns, controls = sweep.inside()
    if problem.per == "second":
        return sweep
    utility = sweep.gain[rows, columns]
    if problem.utility != "entropy":
        utility = problem.utilities(plan, controls, draws)
    if problem.per == "joule":
        utility = _per_joule(problem, plan, controls, utility)
    values = np.full(sweep.gain.shape, np.nan)
    values[rows, columns] = utility
    return replace(sweep, utility=values)


def _per_joule(problem: DesignProblem, plan: TrialPlan, controls: np.ndarray, utility: np.ndarray) -> np.ndarray:
    if problem.power is None:
        raise InputError(
            problem.place("design.per"),
            found='"joule" without the power of the vehicle',
            expected="the power of the propulsion and of the hotel load",
            remedy='state them, or count by the "trial"',
        )
    draws = problem.draws
    if problem.utility != "entropy":
        # Utility without information: what is counted for a joule is the gain beyond it.
        few, k = problem.few(draws), draws.shape[1]
        nothing = problem.criterion(draws)(np.zeros((len(few), k, k)))
        utility = utility - float(np.mean(np.asarray(nothing)))
    return gain_per_cost(utility, expected_joules(plan, problem.power, controls, draws[:UTILITY_DRAWS]))


def _by_the_second(problem: DesignProblem, plan: TrialPlan, sweep: Sweep, scales: np.ndarray) -> Sweep:
    """Each design ended when that is worth most for the time it takes; its gain is the D criterion of what is measured by then."""
    rows, columns, controls = sweep.inside()
    draws = problem.draws
    few, cov = problem.few(draws), covariance(draws)
    stops = best_stops(plan, controls, few, problem.criterion(draws), problem.turnaround)
    left = np.linalg.inv(stops.information + np.linalg.inv(cov))
    utility, length, gain = (np.full(sweep.gain.shape, np.nan) for _ in range(3))
    peak = np.where(np.isposinf(sweep.peak_speed), np.inf, np.nan)
    final_sd = np.full_like(sweep.final_sd, np.nan)
    utility[rows, columns], length[rows, columns] = stops.rate, stops.length
    gain[rows, columns] = np.asarray(find_criterion("fisher-d", cov)(stops.information)).mean(-1)
    final_sd[rows, columns] = np.sqrt(np.diagonal(left, axis1=2, axis2=3).mean(1)) / scales
    (leading,) = in_blocks(partial(_leading, plan, draws.mean(0)), controls)
    taken = np.arange(leading.shape[1]) < stops.samples[:, None]
    peak[rows, columns] = np.where(taken, np.abs(leading), 0.0).max(1)
    return replace(sweep, gain=gain, final_sd=final_sd, peak_speed=peak, utility=utility, length=length)


@program
def _leading(plan: TrialPlan, values: Array, controls: Array) -> tuple[Array]:
    return (jax.vmap(lambda control: plan.motion(values, control)[:, 0])(controls),)


def plan_as_run(plan: TrialPlan, sweep: Sweep) -> TrialPlan:
    """The plan of a sweep's best design, ended when that is."""
    return plan if sweep.length is None else plan.until(int(_samples(sweep, sweep.length[sweep.best])))


def _samples(sweep: Sweep, length: np.ndarray) -> np.ndarray:
    return np.round(length / sweep.family.sample_time).astype(int)


def _words(sweep: Sweep) -> str:
    words = sweep.words(*sweep.best)
    return words if sweep.length is None else f"{words}, ended after {sweep.length[sweep.best]:.3g} s"
