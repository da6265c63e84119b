"""Several trials of one day: those of the campaign's designs that are worth most together."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.evaluate import check_whole_trials, plan_of, utility_unit
from seatrial.campaign.design.prior_state_space import prior_draws
from seatrial.campaign.design.sweep import design_first, write_design
from seatrial.campaign.design.utility import criterion_of, utility_draws
from seatrial.campaign.store.stored_result import Store
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.batch import Batch, plan_batch
from seatrial.design.robust import information_table
from seatrial.manoeuvres.family import design_words

DESIGNS_AT_ONCE = 64  # Designs whose information is computed between two reports of progress


@dataclass(frozen=True, eq=False)
class PlannedBatch:
    """Trials planned together.

    Attributes:
        words: each trial, in the order of what it adds.
        found: what they are worth.
        schedules: one for each.
        unit: of the utility.
    """

    words: tuple[str, ...]
    found: Batch
    schedules: tuple[Path, ...]
    unit: str


def plan_together(campaign: Campaign, trials: int, reporter: Reporter = SILENT) -> PlannedBatch:
    """Choose so many trials among all designs inside the limits, weighed as one alone is.

    Raises:
        InputError: no design inside the limits.
        NumericalError: the motion diverges at a draw of the priors.
    """
    check_whole_trials(campaign.design, campaign.where, "--trials")
    designs, model = design_first(campaign, reporter), campaign.model(campaign.full)
    plan = plan_of(campaign, model)
    draws = prior_draws(campaign, model)
    few = utility_draws(campaign.design, draws)
    places, controls = [], []
    for sweep in designs.sweeps:
        rows, columns, held = sweep.inside()
        places += [(sweep, int(i), int(j)) for i, j in zip(rows, columns, strict=True)]
        controls.append(held)
    every, information = np.concatenate(controls), []
    report = reporter.progress(f"information of {len(every)} design{'s' * (len(every) != 1)}")
    for start in range(0, len(every), DESIGNS_AT_ONCE):
        report(start, len(every))
        information.append(information_table(plan, every[start : start + DESIGNS_AT_ONCE], few))
    report(len(every), len(every))
    criterion = criterion_of(campaign, plan, draws)
    batch = plan_batch(np.concatenate(information), lambda one: np.asarray(criterion(one)), trials)
    words, schedules = [], []
    for number, index in enumerate(batch.designs, 1):
        sweep, i, j = places[index]
        amplitude, period = float(sweep.amplitude[i]), float(sweep.period[j])
        words.append(design_words(sweep.family, amplitude, period))
        path = Store(campaign.folder).batch_schedule(number)
        schedules.append(write_design(campaign, path, sweep.family.manoeuvre(amplitude, period)))
    return PlannedBatch(tuple(words), batch, tuple(schedules), utility_unit(campaign.design).split("/")[0])
