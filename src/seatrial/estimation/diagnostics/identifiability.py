"""What data can tell about each parameter and what only about several together, before a trial and after it.

A combination of parameters about which the Fisher information I is zero to 1e-10 is one that no length of such data shows
(structural); eigenvalues are those of I in relative changes of the parameters. Standard deviations are those of the posterior,
before the data of (I + P^-1)^-1 with the prior's P: over half the value, or over 0.9 of the prior's, the data say too little.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from seatrial.compiled.batching import bucket_length, filled
from seatrial.estimation.diagnostics.combinations import (
    Combination,
    Invisible,
    Unknown,
    groups,
    known_combinations,
    null_combinations,
)
from seatrial.estimation.posterior.information import coefficient_information, likelihood_information
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import nominal
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.vehicles.model import VehicleModel

# Correlation beyond which the split between two parameters is over twice as uncertain as either given the other.
TOGETHER = 0.9
# Information of the data about a parameter, over that of its prior, below which no measurement depends on it.
UNTOUCHED = 1e-10
# Value, in prior standard deviations, below which a parameter is scaled by its prior and not by its value.
NEAR_ZERO = 1e-6


@dataclass(frozen=True, eq=False)
class Group:
    """Parameters that are known together rather than each.

    Attributes:
        names: the parameters.
        correlation: the correlation of two of them that is most distant from zero.
        known: sums that are known better, those with a meaning first, the best of all last.
    """

    names: tuple[str, ...]
    correlation: float
    known: tuple[Combination, ...]

    @property
    def headline(self) -> tuple[Combination, ...]:
        """The sums to use: those with a meaning, unless the best of all is known more than twice as well."""
        *meant, best = self.known
        return tuple(meant) if meant and meant[0].relative_sd <= 2 * best.relative_sd else (best,)


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What the data tell; arrays over the parameters.

    Attributes:
        stage: `before` or `after` the data.
        names: parameters.
        units: their SI units.
        values: point about which everything is said: prior means before the data, the posterior mode after.
        sd: posterior standard deviations, expected ones before the data.
        prior_sd: prior standard deviations.
        correlation: posterior correlations.
        eigenvalues: of the information of the data in relative changes, or in prior standard deviations where a value is
            near zero, ascending; NaN if the model diverges.
        untouched: parameters on which no measurement depends.
        invisible: combinations of the others on which no measurement depends.
        groups: parameters that are known together rather than each.
        shown: factor from SI to the unit in which each parameter is shown, and that unit; empty for SI.
    """

    stage: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " d"]
    sd: Float[np.ndarray, " d"]
    prior_sd: Float[np.ndarray, " d"]
    correlation: Float[np.ndarray, "d d"]
    eigenvalues: Float[np.ndarray, " d"]
    untouched: tuple[str, ...]
    invisible: tuple[Invisible, ...]
    groups: tuple[Group, ...] = field(default=())
    shown: tuple[tuple[float, str], ...] = field(default=())

    @property
    def relative_sd(self) -> Float[np.ndarray, " d"]:
        """Standard deviations over the sizes of the values."""
        return self.sd / np.maximum(np.abs(self.values), 1e-300)

    @property
    def contraction(self) -> Float[np.ndarray, " d"]:
        """Posterior over prior standard deviations."""
        return self.sd / self.prior_sd


def identify(
    parameters: Sequence[Parameter],
    values: Float[np.ndarray, " d"],
    information: Float[np.ndarray, "d d"],
    *,
    cov: Float[np.ndarray, "d d"] | None = None,
    at: Mapping[str, float] | None = None,
) -> Identifiability:
    """Judge any information: of a plan, of several trials added up, or of data.

    Args:
        parameters: the unknowns.
        values: where the information was computed, and what the parameters are taken to be.
        information: of the data alone, in the parameters' own units.
        cov: posterior covariance; None before the data.
        at: operating point, signal name to SI value, for combinations with a meaning.
    """
    values = np.asarray(values, float)
    prior_sd = np.array([float(parameter.prior.sd) for parameter in parameters])
    names, units = tuple(p.name for p in parameters), tuple(p.unit for p in parameters)
    relative = np.abs(values) > NEAR_ZERO * prior_sd
    unknown = Unknown(names, units, values, np.where(relative, values, prior_sd), relative)
    stage = "before" if cov is None else "after"
    scaled = information * np.outer(unknown.scale, unknown.scale)
    if not np.isfinite(scaled).all():
        eigenvalues, untouched, invisible = np.full(values.size, np.nan), [], ()
        information = np.zeros_like(information)
    else:
        eigenvalues = np.linalg.eigvalsh(scaled)
        touched = np.abs(np.diag(information)) * prior_sd**2 > UNTOUCHED
        untouched = [name for name, yes in zip(names, touched, strict=True) if not yes]
        seen = np.flatnonzero(touched)
        invisible = null_combinations(information[np.ix_(seen, seen)], unknown.pick(seen)) if seen.size else ()
    if cov is None:  # before the data: the inverse of their information and the prior's together
        gains, vectors = np.linalg.eigh(information * np.outer(prior_sd, prior_sd))
        cov = (vectors / (1.0 + np.maximum(gains, 0.0))) @ vectors.T * np.outer(prior_sd, prior_sd)
    cov = np.asarray(cov, float)
    sd = np.sqrt(np.diag(cov))
    correlation = cov / np.maximum(np.outer(sd, sd), 1e-300)
    results = []
    for members in groups(correlation, TOGETHER):
        part = unknown.pick(members)
        if any(item.is_scale and set(part.names) <= set(item.names) for item in invisible):
            continue
        pairs = [correlation[i, j] for i, j in combinations(members, 2)]
        known = known_combinations(part, cov[np.ix_(members, members)], at or {})
        results.append(Group(part.names, float(max(pairs, key=abs)), known))
    return Identifiability(
        stage,
        names,
        units,
        values,
        sd,
        prior_sd,
        correlation,
        eigenvalues,
        tuple(untouched),
        invisible,
        tuple(results),
        tuple(p.shown or (1.0, p.unit) for p in parameters),
    )


def identifiability_of_fit(
    posterior: Posterior,
    mode: Mode,
    draws: Float[np.ndarray, "n d"] | None = None,
    at: Mapping[str, float] | None = None,
) -> Identifiability:
    """Judge a fit: the information of its data at the mode, and the covariance of its posterior.

    Args:
        posterior: posterior.
        mode: its mode, of the parameters that are present.
        draws: posterior draws of them in their own units; without them the covariance is that of the mode's curvature.
        at: operating point, signal name to SI value.
    """
    information = likelihood_information(posterior, mode.values)
    if draws is None:
        places = posterior.places
        z = jnp.zeros(posterior.dim).at[places].set(mode.z)
        rising = np.sign(np.asarray(posterior.constrain(z + 0.01) - posterior.constrain(z - 0.01)))[places]
        slope = rising * mode.sd / np.sqrt(np.diag(mode.cov))
        # The curvature inside a box can promise more spread than the box has.
        slope = slope * np.minimum(
            1.0, [p.prior.sd for p in posterior.present_parameters] / np.maximum(mode.sd, 1e-300)
        )
        cov = mode.cov * np.outer(slope, slope)
    else:
        cov = np.atleast_2d(np.cov(draws.T))
    return identify(posterior.present_parameters, mode.values, information, cov=cov, at=at)


def identifiability_of_design(
    parameters: Sequence[Parameter],
    model: VehicleModel,
    control: Float[np.ndarray, "n n_controls"],
    sample_time: float,
    start: Sequence[float],
    noise: Mapping[str, float],
    at: Mapping[str, float] | None = None,
    autopilot: Autopilot | None = None,
    process: Sequence[float] | None = None,
) -> Identifiability:
    """Judge one planned trial from the vehicle's coefficients at the nominal values of their priors.

    Args:
        parameters: the model's coefficients with their priors, in its order.
        model: vehicle.
        control: control held from each sample to the next; under an autopilot what is commanded.
        sample_time: s.
        start: state at the first sample.
        noise: standard deviation of each measured channel, SI.
        at: operating point, signal name to SI value.
        autopilot: through which the trial runs.
        process: standard deviation that each state gains in one second, SI; None for none.
    """
    values = np.array([nominal(parameter.prior) for parameter in parameters])
    params = {parameter.name: value for parameter, value in zip(parameters, values, strict=True)}
    n, size = len(control), bucket_length(len(control))
    control, step = filled(np.asarray(control, float), size), filled(np.full(n, float(sample_time)), size, 0.0)
    weight = filled(np.broadcast_to(1.0 / np.array(list(noise.values()), float), (n, len(noise))), size, 0.0)
    begin = np.asarray(start, float)
    parts = model, tuple(noise), params, control, step, begin, weight
    gained = None if process is None else np.asarray(process, float)
    information = np.asarray(coefficient_information(*parts, autopilot, gained))
    return identify(parameters, values, information, at=at)
