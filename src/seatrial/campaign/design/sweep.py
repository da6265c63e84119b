"""Design of the first trial from the priors, and of the next one from the posterior."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.check_autopilot import check_autopilot
from seatrial.campaign.design.evaluate import plan_as_run, plan_of, safety_lines, utility_unit, weigh
from seatrial.campaign.design.prior_state_space import HALF, belief_space, believed, prior_draws
from seatrial.campaign.design.residual_noise import with_residual_noise
from seatrial.campaign.design.schedule import commands_of, write_schedule
from seatrial.campaign.design.utility import design_filter, prediction_lines
from seatrial.campaign.store.designs import SweptDesigns, edge_words
from seatrial.campaign.store.estimates import Drawn, Estimate, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.campaign.store.structures import BestDesign
from seatrial.compiled.batching import on_accelerator
from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.core.result_table import text_html
from seatrial.core.signals import signal_unit
from seatrial.design.limit_conflicts import remedy_of_any
from seatrial.design.sweep import LANES, Sweep, sweep_family
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.family import Family, design_words
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre
from seatrial.numerics.gaussian import Gaussian
from seatrial.selection.structures import Structure

# Sweeps done in rows of the grid, each row's designs predicted and weighed wherever there is a worker, and put
# together again.

ARRAYS = ("gain", "peak_speed", "final_sd", "utility", "length")  # What a sweep has of every design


@dataclass(frozen=True, eq=False)
class Believed:
    """What designs are swept from.

    Attributes:
        structure: terms of the model.
        belief: coefficients, SI.
        draws: of them, SI, shape (S, k).
    """

    structure: Structure
    belief: Gaussian
    draws: np.ndarray


class _Rows(NamedTuple):
    """Some rows of one family's grid: their amplitudes from `first` to before `last`."""

    family: int
    first: int
    last: int


def sweep_all(
    campaign: Campaign, believed: Believed, report: Progress, reporter: Reporter
) -> tuple[list[Sweep], dict[str, InputError | NumericalError]]:
    """Sweep every family of a campaign and weigh its designs.

    Args:
        campaign: configuration.
        believed: what is known before the trial.
        report: receives the rows done.
        reporter: receives what happens.

    Returns:
        Sweeps of the families that have a design inside the limits, in the campaign's order, and why the others have none.
    """
    amplitude, period = campaign.design.grid()
    every = amplitude.size if on_accelerator() else max(1, -(-LANES // period.size))
    parts = [
        _Rows(family, first, min(first + every, amplitude.size))
        for family in range(len(campaign.families))
        for first in range(0, amplitude.size, every)
    ]
    swept: dict[_Rows, Sweep] = {}
    refused: dict[_Rows, InputError | NumericalError] = {}

    def done(index: int, result: tuple[_Rows, Sweep | InputError | NumericalError]) -> _Rows | None:
        rows, outcome = result
        if isinstance(outcome, Sweep):
            swept[rows] = outcome
        else:
            refused[rows] = outcome
        report(len(swept) + len(refused), len(parts))
        of_family = [one for one in parts if one.family == rows.family]
        if len(of_family) > 1 and all(one in refused for one in of_family) and rows in of_family:
            return _Rows(rows.family, 0, amplitude.size)  # only the grid as a whole says what is the gentlest design
        return None

    report(0, len(parts))
    study = Study(campaign, extra=believed)
    workers_of(campaign, reporter).run(_sweep_rows, study, parts, done)
    sweeps, reasons = [], {}
    for number, family in enumerate(campaign.families):
        rows = [one for one in parts if one.family == number]
        family_sweeps = [swept.get(one) for one in rows]
        if any(family_sweeps):
            sweeps.append(_joined(rows, family_sweeps, amplitude))
        else:
            reasons[family.kind] = refused[_Rows(number, 0, amplitude.size)]
    return sweeps, reasons


def _sweep_rows(study: Study, rows: _Rows, report: Progress) -> tuple[_Rows, Sweep | InputError | NumericalError]:
    """Predict and weigh the designs of some rows; an error where none is inside the limits, or all diverge."""
    campaign, believed = study.campaign, study.extra
    known = study.once("belief", lambda: _prepare(campaign, believed))
    amplitude, period = campaign.design.grid()
    try:
        sweep = known.predict(campaign.families[rows.family], amplitude[rows.first : rows.last], period)
        return rows, weigh(campaign, known.plan, sweep, believed.draws, known.scales)
    except (InputError, NumericalError) as error:
        return rows, error


class _Prepared(NamedTuple):
    """What all rows are predicted with."""

    plan: TrialPlan
    scales: np.ndarray
    predict: Callable[[Family, np.ndarray, np.ndarray], Sweep]


def _prepare(campaign: Campaign, believed: Believed) -> _Prepared:
    model = campaign.model(believed.structure)
    space, scales = belief_space(campaign, model, believed.belief)
    method = design_filter(campaign.design.filter, len(space.states), campaign.where("design.filter"))
    trim = campaign.control_trim(model)
    mask, limits = campaign.measured_mask(campaign.family.time()), campaign.limits

    def predict(family: Family, amplitude: np.ndarray, period: np.ndarray) -> Sweep:
        more = {
            "trim": trim,
            "others": _other_limits(campaign.control_limits, family.control),
            "autopilot": campaign.pilot(model.controls),
        }
        return sweep_family(space, family, amplitude, period, limits, method, mask, **more)

    return _Prepared(plan_of(campaign, model), scales, predict)


def _joined(parts: Sequence[_Rows], sweeps: Sequence[Sweep | None], amplitude: np.ndarray) -> Sweep:
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


def _other_limits(limits: Mapping[str, Limits], control: str) -> dict[str, Limits]:
    """Return the limits of other controls than the designed one, which schedules may move, SI."""
    return {name: bounds for name, bounds in limits.items() if name != control}


def design_key(campaign: Campaign) -> str:
    """Key of the first design."""
    return key_of(
        "design",
        *(campaign.vehicle, campaign.structure, campaign.design, campaign.power),
        *(campaign.priors, campaign.sensors, campaign.mounts, campaign.limits, campaign.motion_limits, campaign.seed),
        *(
            [_other_limits(campaign.control_limits, campaign.family.control)]
            if campaign.family.beside or campaign.autopilot.loops
            else []
        ),
        *([campaign.autopilot] if campaign.autopilot.loops else []),
        *([process] if (process := campaign.expected_process(campaign.model(campaign.full))) else []),
    )


@dataclass(frozen=True, eq=False)
class Designs:
    """What was swept: one sweep for each family that has a design inside the limits.

    Attributes:
        sweeps: that of the best design first.
        refused: families without a design inside the limits, and why.
        basis: what the designs were swept from, in words.
        names: coefficients.
        sd_before: their standard deviations before the trial, SI.
        unit: of what makes a design the best, where that is not the entropy reduction itself.
        safety: how surely the best design keeps each limit of the motion.
        prediction: how well the stated prediction is known before and after it.
    """

    sweeps: tuple[Sweep, ...]
    refused: dict[str, str]
    basis: str
    names: tuple[str, ...]
    sd_before: np.ndarray
    unit: str = "nat"
    safety: tuple[str, ...] = ()
    prediction: tuple[str, ...] = ()

    @property
    def best(self) -> Sweep:
        """Sweep of the family that holds the best design; its duration is that design's, where it is ended early."""
        return self.sweeps[0].as_run()

    def __repr__(self) -> str:
        """Print the lines."""
        return "\n".join(self.lines())

    _repr_html_ = text_html

    def lines(self) -> list[str]:
        """The best of each family, and the families that have none."""
        lines = [f"{_words(sweep)}: {sweep.gain[sweep.best]:.2f} nat{self._worth(sweep)}" for sweep in self.sweeps]
        return lines + [f"{kind}: no design, {why}" for kind, why in self.refused.items()] + self.diverging()

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
            sd_before=dict(zip(self.names, map(float, self.sd_before), strict=True)),
            sd_after=dict(zip(self.names, map(float, sweep.final_sd[row, column]), strict=True)),
        )

    @property
    def at_edge(self) -> str:
        """Where the best design is at an edge of the grid, so that one beyond may be better, and the key to widen; else empty."""
        return edge_words(self.best.amplitude.size, self.best.period.size, self.best.best)

    def diverging(self) -> list[str]:
        """The families of which some designs are left out, because their motion diverges for vehicles that the priors allow."""
        counts = {sweep.family.kind: int(np.isposinf(sweep.peak_speed).sum()) for sweep in self.sweeps}
        return [
            f"{kind}: {count} of {self.best.gain.size} designs left out, because their motion diverges for vehicles that the priors allow"
            for kind, count in counts.items()
            if count
        ]

    def _worth(self, sweep: Sweep) -> str:
        worth, gain = sweep.worth[sweep.best], sweep.gain[sweep.best]
        return "" if worth == gain else f"; utility {worth:.3g} {self.unit}".rstrip()


def stored_first(campaign: Campaign) -> StoredResult[SweptDesigns]:
    """Return where the first design is kept, and what it depends on."""
    return StoredResult(
        Store(campaign.folder).design, design_key(campaign), SweptDesigns, f"seatrial design {campaign.folder}"
    )


def stored_next(campaign: Campaign, estimate: OfStructure) -> StoredResult[SweptDesigns]:
    """Return where the design of the next trial is kept, and what it depends on."""
    key = key_of("next", design_key(campaign), estimate.key, estimate.structure.terms)
    return StoredResult(Store(campaign.folder).next_design, key, SweptDesigns, f"seatrial next {campaign.folder}")


def design_first(campaign: Campaign, reporter: Reporter = SILENT) -> Designs:
    """Sweep the design grid under the priors of the full structure, or read the sweep if it is current.

    Args:
        campaign: of `load_campaign`.
        reporter: told how far the sweep has come.

    Returns:
        every design with its utility, and the best; `.lines()` says it in words.

    Raises:
        InputError: no campaign, or no design inside its limits.
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")

    def sweep() -> SweptDesigns:
        model = campaign.model(campaign.full)
        belief, draws = believed(campaign.coefficient_priors(model)), prior_draws(campaign, model)
        return _sweep(campaign, campaign.full, belief, draws, "the priors", reporter)

    return _designs(campaign, stored_first(campaign), sweep)


def is_designed(campaign: Campaign) -> bool:
    """Whether there is a first design that belongs to the campaign as it is."""
    return stored_first(campaign).is_current()


def design_next(campaign: Campaign, estimate: Estimate, reporter: Reporter = SILENT) -> Designs:
    """Sweep the grid for a structure from what its posterior says of coefficients and noise so far; a current result is read."""

    basis = f"the posterior of {estimate.structure.label}"
    kept = stored_next(campaign, estimate)
    return _designs(campaign, kept, lambda: _sweep_after(campaign, estimate, basis, reporter))


def design_next_by_mode(campaign: Campaign, drawn: Drawn, reporter: Reporter = SILENT) -> Designs:
    """Likewise from draws about the posterior mode of a structure."""
    key = key_of("next by mode", design_key(campaign), drawn.structure.terms, drawn.draws().tolist())
    kept = StoredResult(Store(campaign.folder).mode_design, key, SweptDesigns)
    basis = f"the posterior mode of {drawn.structure.label}"
    return _designs(campaign, kept, lambda: _sweep_after(campaign, drawn, basis, reporter))


def coefficient_draws(drawn: Drawn, seed: int) -> Float[np.ndarray, "S k"]:
    """Return draws of a structure's coefficients, SI, as many as designs are chosen and judged by."""
    draws = drawn.draws([name for name in drawn.structure.terms if name in drawn.names])
    return draws[np.random.default_rng(seed).permutation(len(draws))[: 2 * HALF]]


def _designs(campaign: Campaign, kept: StoredResult[SweptDesigns], make: Callable[[], SweptDesigns]) -> Designs:
    """Read or make sweeps; the schedule of the best trial is written again where it is missing or not the same."""
    designs = designs_of(campaign, kept.read_or_make(make))
    write_design(campaign, Store(campaign.folder).schedule(kept.path), designs.best.best_manoeuvre())
    return designs


def write_design(campaign: Campaign, path: Path, manoeuvre: Manoeuvre, rule: str = "", **about: Any) -> Path:
    """Write the schedule of a design, with the key of the designs that it belongs to; arguments and result as `write_schedule`."""
    about = {**about, "design": design_key(campaign)}
    return write_schedule(path, manoeuvre, campaign.family.sample_time, rule, about, commands_of(campaign))


def designs_of(campaign: Campaign, stored: SweptDesigns) -> Designs:
    """Return stored sweeps with the families of the campaign."""
    families = {family.kind: family for family in campaign.families}
    sweeps = []
    for i, kind in enumerate(stored.families):
        ended = stored.length[i] if campaign.design.per == "second" else None
        arrays = stored.gain[i], stored.peak_speed[i], stored.final_sd[i], stored.trim, stored.worth[i], ended
        sweeps.append(Sweep(families[kind], stored.amplitude, stored.period, *arrays))
    return Designs(
        tuple(sorted(sweeps, key=lambda sweep: -sweep.worth[sweep.best])),
        stored.refused,
        stored.basis,
        stored.names,
        stored.sd_before,
        stored.unit,
        stored.safety,
        stored.prediction,
    )


def _sweep_after(campaign: Campaign, drawn: Drawn, basis: str, reporter: Reporter) -> SweptDesigns:
    structure = drawn.structure
    draws = drawn.draws([name for name in structure.terms if name in drawn.names])
    belief = Gaussian(draws.mean(0), np.linalg.cholesky(np.atleast_2d(np.cov(draws, rowvar=False))))
    few = coefficient_draws(drawn, campaign.seed)
    return _sweep(with_residual_noise(campaign, drawn), structure, belief, few, basis, reporter)


def _sweep(
    campaign: Campaign,
    structure: Structure,
    belief: Gaussian,
    draws: np.ndarray,
    basis: str,
    reporter: Reporter,
) -> SweptDesigns:
    model, families, (amplitude, period) = campaign.model(structure), campaign.families, campaign.design.grid()
    check_autopilot(campaign, model, draws, reporter)
    scales, plan, trim = (
        belief_space(campaign, model, belief)[1],
        plan_of(campaign, model),
        campaign.control_trim(model),
    )
    report = reporter.progress(
        f"design: {(count := len(families) * amplitude.size * period.size)} trial{'s' * (count != 1)}"
    )
    sweeps, errors = sweep_all(campaign, Believed(structure, belief, draws), report, reporter)
    if len(families) == 1 and errors:
        raise next(iter(errors.values()))
    refused = {
        kind: error.sentence(with_remedy=False) if isinstance(error, InputError) else str(error)
        for kind, error in errors.items()
    }
    if not sweeps:
        raise InputError(
            campaign.where("design"),
            found="of all families none:" + "".join(f"\n    {kind}: {why}" for kind, why in refused.items()),
            expected="one design at least that fits and is inside the limits",
            remedy=remedy_of_any(errors.values()),
        )
    best = max(sweeps, key=lambda sweep: np.nanmax(sweep.worth))
    safety = safety_lines(campaign.motion_limits, campaign.design.probability, plan, best, draws)
    stacked = {
        name: np.stack([_kept(sweep, name) for sweep in sweeps])
        for name in ("gain", "worth", "peak_speed", "final_sd", "length")
    }
    return SweptDesigns(
        families=tuple(sweep.family.kind for sweep in sweeps),
        control=campaign.family.control,
        trim=trim,
        amplitude=amplitude,
        period=period,
        **stacked | {"final_sd": stacked["final_sd"] * scales},
        names=tuple(term.text for term in model.coefficients),
        sd_before=scales,
        basis=basis,
        refused=refused,
        safety=tuple(safety),
        prediction=tuple(prediction_lines(campaign, plan_as_run(plan, best), best.best_controls(), draws)),
        unit=utility_unit(campaign.design),
    )


def _kept(sweep: Sweep, name: str) -> np.ndarray:
    return (
        np.full(sweep.gain.shape, sweep.family.duration)
        if name == "length" and sweep.length is None
        else getattr(sweep, name)
    )


def _words(sweep: Sweep) -> str:
    row, column = sweep.best
    words = design_words(sweep.family, float(sweep.amplitude[row]), float(sweep.period[column]))
    return words if sweep.length is None else f"{words}, ended after {sweep.length[row, column]:.3g} s"
