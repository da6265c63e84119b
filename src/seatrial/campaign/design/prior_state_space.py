"""What is believed about a vehicle before a trial: its priors, and the state space of the trial in units of their deviations."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.posterior import random_key
from seatrial.core.gaussian import Gaussian
from seatrial.core.state_space import StateSpace
from seatrial.design.prior_belief import draw_values
from seatrial.estimation.priors import Prior
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.model import VehicleModel

STATE_SD = 0.05
"""Standard deviation of the vehicle's own state about trim at the start of a designed trial, in its unit (m/s)."""
HALF = 400
"""Draws of the priors behind each probability of staying inside the limits."""


def coefficient_priors(campaign: Campaign, model: VehicleModel) -> tuple[Prior, ...]:
    """Prior of every coefficient of a model, SI."""
    return tuple(campaign.prior(term.text) for term in model.coefficients)


def prior_draws(campaign: Campaign, model: VehicleModel) -> Float[np.ndarray, "S k"]:
    """Coefficients drawn from the priors, SI: the first half chooses designs, the second judges the one that is chosen."""
    return draw_values(coefficient_priors(campaign, model), random_key(campaign.seed, "draws of the design"), 2 * HALF)


def believed(priors: Sequence[Prior]) -> Gaussian:
    """The normal belief with the means and standard deviations of independent priors."""
    return Gaussian(np.array([prior.mean for prior in priors]), np.diag([prior.sd for prior in priors]))


def belief_space(campaign: Campaign, model: VehicleModel, belief: Gaussian) -> tuple[StateSpace, np.ndarray]:
    """State space and the standard deviations in whose units its coefficients are, so that each is of order one.

    Args:
        campaign: trim and sensors.
        model: vehicle.
        belief: about its coefficients, SI.
    """
    scales, d = np.asarray(belief.sd), len(model.states)
    chol = np.zeros((d + scales.size,) * 2)
    chol[range(d), range(d)] = STATE_SD
    chol[d:, d:] = np.asarray(belief.chol_cov) / scales[:, None]
    initial = Gaussian(np.concatenate([campaign.state_trim(model), np.asarray(belief.mean) / scales]), chol)
    noise = np.array(list(campaign.noise.values()))
    space = discretise(model, campaign.channels, initial, np.zeros(d + scales.size), noise, scales.tolist())
    return space, scales
