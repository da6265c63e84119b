"""A schedule of one's own, weighed beside the best of the families by the same measure, and judged against every limit."""

from pathlib import PurePath

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import OwnSchedule
from seatrial.campaign.design.evaluate import plan_as_run, plan_of, utility_unit
from seatrial.campaign.design.prior_state_space import HALF, prior_draws
from seatrial.campaign.design.residual_noise import with_residual_noise
from seatrial.campaign.design.schedule import write_own
from seatrial.campaign.design.sweep import Designs, coefficient_draws, design_first, design_key
from seatrial.campaign.design.utility import criterion_of, utility_draws
from seatrial.campaign.store.designs import OwnTrial
from seatrial.campaign.store.estimates import Drawn
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.trial_plan import TrialPlan, plan_trial
from seatrial.manoeuvres.family import design_words
from seatrial.vehicles.model import VehicleModel


def stored_own(campaign: Campaign, own: OwnSchedule) -> StoredResult[OwnTrial]:
    """Return where the judgement of a campaign's own schedule is kept, and what it depends on."""
    controls = {name: values.tolist() for name, values in own.schedule.controls.items()}
    key = key_of("own", design_key(campaign), own.schedule.time.tolist(), controls)
    return StoredResult(Store(campaign.folder).own_design, key, OwnTrial, f"seatrial design {campaign.folder}")


def evaluate_own_schedule(campaign: Campaign, reporter: Reporter = SILENT) -> OwnTrial | None:
    """Weigh the schedule that [design] names under the priors, and write it where designs are; None where it names none.

    Raises:
        NumericalError: the motion diverges at a draw of the priors.
    """
    own = campaign.design.own
    if own is None:
        return None
    kept, model = stored_own(campaign, own), campaign.model(campaign.full)
    write_own(Store(campaign.folder).schedule(kept.path), own.schedule, PurePath(own.source).name)

    def judge() -> OwnTrial:
        designs = design_first(campaign, reporter)
        return evaluate_schedule(campaign, own, model, prior_draws(campaign, model), designs)

    return kept.read_or_make(judge)


def evaluate_schedule(
    campaign: Campaign, own: OwnSchedule, model: VehicleModel, draws: Float[np.ndarray, "S k"], designs: Designs
) -> OwnTrial:
    """Weigh a schedule beside the best of some designs, under what is believed.

    Args:
        campaign: sensors, utility and limits.
        own: the schedule.
        model: vehicle.
        draws: its coefficients as they are believed, SI; the second half judges both.
        designs: the best of which stands beside it.

    Raises:
        NumericalError: the motion diverges at a draw.
    """
    best, fresh = designs.best, draws[len(draws) // 2 :]
    plan, beside = plan_own(campaign, own, model), plan_as_run(plan_of(campaign, model), designs.sweeps[0])
    controls = np.column_stack(list(own.schedule.columns(campaign.control_trim(model)).values()))
    pairs = ((plan, controls), (beside, designs.sweeps[0].best_controls()))
    few, is_worst = utility_draws(campaign.design, fresh), campaign.design.over == "worst"
    tables = [utility_table(one, held[None], few, criterion_of(campaign, one, draws)) for one, held in pairs]
    limits, probability = campaign.motion_limits, campaign.design.probability
    safety = judge_safety(plan, controls[None], fresh[:HALF], limits, probability) if limits else None
    utility, utility_beside = (float((table.worst() if is_worst else table.mean)[0]) for table in tables)
    row, column = best.best
    return OwnTrial(
        source=PurePath(own.source).name,
        duration=float(own.schedule.time[-1]),
        utility=utility,
        beside=utility_beside,
        best=design_words(best.family, float(best.amplitude[row]), float(best.period[column])),
        best_duration=float(best.family.end),
        unit=utility_unit(campaign.design).split("/")[0],
        names=plan.names,
        units=tuple(model.unit_of(term) for term in model.coefficients),
        sd=_sd_after(plan, controls, draws),
        sd_beside=_sd_after(*pairs[1], draws),
        safety=() if safety is None else safety.words(0),
        is_safe=safety is None or bool(safety.allowed[0]),
        probability=probability,
    )


def evaluate_schedule_after(campaign: Campaign, drawn: Drawn, designs: Designs) -> OwnTrial | None:
    """Weigh the schedule that [design] names beside the best of designs that were swept from draws; None where it names none."""
    own = campaign.design.own
    if own is None:
        return None
    known, model = with_residual_noise(campaign, drawn), campaign.model(drawn.structure)
    return evaluate_schedule(known, own, model, coefficient_draws(drawn, campaign.seed), designs)


def plan_own(campaign: Campaign, own: OwnSchedule, model: VehicleModel) -> TrialPlan:
    """Plan of the trial of a schedule: from trim, with the campaign's sensors, as long as it is."""
    time = own.schedule.time
    start, mask = campaign.state_trim(model), campaign.measured_mask(time)
    through = campaign.pilot(model.controls), campaign.expected_process(model)
    return plan_trial(model, start, campaign.noise, time.size, float(time[1]), mask, *through)


def _sd_after(plan: TrialPlan, controls: np.ndarray, draws: np.ndarray) -> tuple[float, ...]:
    """Standard deviations after a trial, SI, linearised at the mean of what is believed."""
    before = np.linalg.inv(np.atleast_2d(np.cov(draws, rowvar=False)))
    information = np.asarray(plan.information(draws.mean(0), controls))
    return tuple(map(float, np.sqrt(np.diag(np.linalg.inv(before + information)))))
