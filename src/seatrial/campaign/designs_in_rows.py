"""Sweeps done in rows of the grid, each row's designs predicted and weighed wherever there is a worker, and put together again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from seatrial.campaign.belief import belief_space
from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.study import Study
from seatrial.campaign.config import Campaign
from seatrial.campaign.utilities import design_filter
from seatrial.campaign.watch import Watch
from seatrial.campaign.weighing import plan_of, weigh
from seatrial.core.errors import InputError
from seatrial.core.gaussian import Gaussian
from seatrial.core.lanes import on_accelerator
from seatrial.design.plan import TrialPlan
from seatrial.design.sweep import LANES, Sweep, sweep_family
from seatrial.manoeuvres.family import Family
from seatrial.sampling.target import Progress
from seatrial.selection.structures import Structure

ARRAYS = ("gain", "peak_speed", "final_sd", "utility", "length")
"""What a sweep has of every design."""


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
    campaign: Campaign, believed: Believed, report: Progress, watch: Watch
) -> tuple[list[Sweep], dict[str, InputError]]:
    """Sweep every family of a campaign and weigh its designs.

    Args:
        campaign: configuration.
        believed: what is known before the trial.
        report: receives the rows done.
        watch: receives what happens.

    Returns:
        Sweeps of the families that have a design inside the limits, in the campaign's order, and why the others have none.

    Raises:
        NumericalError: the expected motion diverges for a design that is inside the limits.
    """
    amplitude, period = campaign.grid()
    every = amplitude.size if on_accelerator() else max(1, -(-LANES // period.size))
    parts = [
        _Rows(family, first, min(first + every, amplitude.size))
        for family in range(len(campaign.families))
        for first in range(0, amplitude.size, every)
    ]
    found: dict[_Rows, Sweep] = {}
    refused: dict[_Rows, InputError] = {}

    def done(index: int, result: tuple[_Rows, Sweep | InputError]) -> _Rows | None:
        rows, outcome = result
        if isinstance(outcome, Sweep):
            found[rows] = outcome
        else:
            refused[rows] = outcome
        report(len(found) + len(refused), len(parts))
        of_family = [one for one in parts if one.family == rows.family]
        if len(of_family) > 1 and all(one in refused for one in of_family) and rows in of_family:
            return _Rows(rows.family, 0, amplitude.size)  # only the grid as a whole says what is the gentlest design
        return None

    report(0, len(parts))
    study = Study(campaign, extra=believed)
    workers_of(campaign, watch).run(_sweep_rows, study, parts, done)
    sweeps, reasons = [], {}
    for number, family in enumerate(campaign.families):
        rows = [one for one in parts if one.family == number]
        there = [found.get(one) for one in rows]
        if any(there):
            sweeps.append(_joined(rows, there, amplitude))
        else:
            reasons[family.kind] = refused[_Rows(number, 0, amplitude.size)]
    return sweeps, reasons


def _sweep_rows(study: Study, rows: _Rows, report: Progress) -> tuple[_Rows, Sweep | InputError]:
    """Predict and weigh the designs of some rows; an error where none is inside the limits."""
    campaign, believed = study.campaign, study.extra
    known = study.once("belief", lambda: _prepare(campaign, believed))
    amplitude, period = campaign.grid()
    try:
        sweep = known.predict(campaign.families[rows.family], amplitude[rows.first : rows.last], period)
        return rows, weigh(campaign, known.plan, sweep, believed.draws, known.scales)
    except InputError as error:
        return rows, error


class _Prepared(NamedTuple):
    """What all rows are predicted with."""

    plan: TrialPlan
    scales: np.ndarray
    predict: Callable[[Family, np.ndarray, np.ndarray], Sweep]


def _prepare(campaign: Campaign, believed: Believed) -> _Prepared:
    model = campaign.model(believed.structure)
    space, scales = belief_space(campaign, model, believed.belief)
    method, trim = design_filter(campaign, len(space.states)), campaign.control_trim(model)
    mask, limits = campaign.measured_mask(campaign.family.time()), campaign.limits()

    def predict(family: Family, amplitude: np.ndarray, period: np.ndarray) -> Sweep:
        return sweep_family(space, family, amplitude, period, limits, method, mask, trim=trim)

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
