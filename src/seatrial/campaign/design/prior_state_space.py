"""What is believed about a vehicle before a trial: its priors, and the state space of the trial in units of their deviations."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.posterior import random_key
from seatrial.design.prior_belief import coefficient_space, draw_values, normal_of
from seatrial.estimation.priors import Prior
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.model import VehicleModel

HALF = 400  # Draws of the priors behind each probability of staying inside the limits


def prior_draws(campaign: Campaign, model: VehicleModel) -> Float[np.ndarray, "S k"]:
    """Coefficients drawn from the priors, SI: the first half chooses designs, the second judges the one that is chosen."""
    return draw_values(campaign.coefficient_priors(model), random_key(campaign.seed, "draws of the design"), 2 * HALF)


def believed(priors: Sequence[Prior]) -> Gaussian:
    """The normal belief with the means and standard deviations of independent priors."""
    return normal_of(tuple(priors))


def belief_space(campaign: Campaign, model: VehicleModel, belief: Gaussian) -> tuple[StateSpace, np.ndarray]:
    """State space and the standard deviations in whose units its coefficients are, so that each is of order one.

    Args:
        campaign: trim and sensors.
        model: vehicle.
        belief: about its coefficients, SI.
    """
    process = np.array(campaign.expected_process(model) or np.zeros(len(model.states)))
    per_sample = process * np.sqrt(campaign.family.sample_time)
    return coefficient_space(model, belief, campaign.state_trim(model), campaign.noise, per_sample)
