"""A campaign's trials as problems of design: from its priors, or from what an estimate has taught."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.store.estimates import Drawn
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import random_key
from seatrial.design.cost import ElectricPower
from seatrial.design.design_problem import HALF, DesignProblem, covariance
from seatrial.design.prior_belief import draw_values
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan, plan_trial
from seatrial.numerics.gaussian import Gaussian
from seatrial.selection.structures import Structure
from seatrial.vehicles.model import VehicleModel


@dataclass(frozen=True, eq=False)
class Believed:
    """What an estimate leaves to designs.

    Attributes:
        structure: terms of the model.
        belief: coefficients, SI.
        draws: of them, SI, shape (S, k).
    """

    structure: Structure
    belief: Gaussian
    draws: np.ndarray


def believed_after(campaign: Campaign, drawn: Drawn) -> Believed:
    """Return what draws of a posterior, or about its mode, say of the coefficients of their structure."""
    names = [campaign.in_next_trial(term) for term in drawn.structure.terms]
    draws = drawn.draws([name for name in names if name in drawn.names])
    belief = Gaussian(draws.mean(0), np.linalg.cholesky(covariance(draws)))
    # As many draws as designs are chosen and judged by.
    chosen = np.random.default_rng(campaign.seed).permutation(len(draws))[: 2 * HALF]
    return Believed(drawn.structure, belief, draws[chosen])


def design_problem(campaign: Campaign, believed: Believed | None = None) -> DesignProblem:
    """Return the problem of a campaign's next trial, from its priors where nothing else is believed.

    Raises:
        InputError: a prior that is missing, or a control without a trim value.
    """
    structure = campaign.full if believed is None else believed.structure
    model, design, power = campaign.model(structure), campaign.design, campaign.power
    names = tuple(term.text for term in model.coefficients)
    joules = None
    if design.per == "joule" and power is not None:
        joules = ElectricPower(power.hotel, power.propulsion, power.at, campaign.family.control)
    return DesignProblem(
        model,
        campaign.coefficient_priors(model) if believed is None else believed.belief,
        campaign.families,
        *design.grid(),
        campaign.noise,
        campaign.state_trim(model),
        dict(campaign.control_trim(model)),
        rates={channel: sensor.rate for channel, sensor in campaign.sensors.items()},
        limits=campaign.control_limits,
        motion=campaign.motion_limits,
        probability=design.probability,
        autopilot=campaign.pilot(model.controls),
        process=campaign.expected_process(model),
        utility=design.utility,
        over=design.over,
        per=design.per,
        turnaround=design.turnaround,
        power=joules,
        filter=design.filter,
        prediction=campaign.prediction(model),
        rivals=_rivals(campaign, names) if design.utility == "discrimination" else (),
        seed=campaign.seed,
        drawn=None if believed is None else believed.draws,
        place=campaign.where,
    )


def _rivals(campaign: Campaign, names: tuple[str, ...]) -> tuple[frozenset[str], ...]:
    """Return the terms that each rival lacks; if there are too many structures, those that lack one term alone stand for all."""
    terms = frozenset(names)
    if campaign.is_large and not campaign.shortlist:
        return tuple(frozenset({name}) for name in names if name in campaign.rules.optional)
    return tuple(terms - set(one.terms) for one in campaign.structures if set(one.terms) < terms)


def prior_draws(campaign: Campaign, model: VehicleModel) -> Float[np.ndarray, "S k"]:
    """Coefficients drawn from the priors, SI, as `DesignProblem.draws` are, of a campaign that may design nothing."""
    return draw_values(campaign.coefficient_priors(model), random_key(campaign.seed, "draws of the design"), 2 * HALF)


def plan_of(campaign: Campaign, model: VehicleModel) -> TrialPlan:
    """Plan of the campaign's trials: from trim, with its sensors."""
    time = campaign.family.time()
    start = campaign.state_trim(model)
    measured = campaign.noise, time.size, campaign.family.sample_time, campaign.measured_mask(time)
    return plan_trial(model, start, *measured, campaign.pilot(model.controls), campaign.expected_process(model))


def applied_controls(
    campaign: Campaign,
    model: VehicleModel,
    values: Float[np.ndarray, " k"],
    controls: Float[np.ndarray, "D n c"],
) -> Float[np.ndarray, "D n n_controls"]:
    """Return the controls of a vehicle under some designs, SI: as its autopilot makes them for these coefficients, or as commanded."""
    plan = plan_of(campaign, model)
    if plan.autopilot is None:
        return controls
    return in_blocks(lambda control: (_applied(plan, values, control),), controls)[0]


@program
def _applied(plan: TrialPlan, values: Array, controls: Array) -> Array:
    return jax.vmap(lambda control: plan.applied(values, control))(controls)
