"""Correlated draws of estimated coefficients, each a vehicle that can move: scenarios of a controller, ranges of a learner.

Draws are normal, with the mean and covariance of the export, within the bounds of the priors. A draw without a positive definite mass
matrix, or whose damping gives energy, is counted and replaced. The set of robust design is the ellipsoid

    (x - mean)' covariance^-1 (x - mean) <= r^2,    r^2 the quantile of chi-square with k degrees of freedom.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv

from seatrial.core.argument_checks import check_count
from seatrial.core.errors import InputError
from seatrial.export.stability import check_stable
from seatrial.export.vehicle import CoefficientEstimates, ExportedVehicle

DRAWS = 256  # Draws if no other number is asked for
MOST_DRAWS = 10_000
SET_PROBABILITY = 0.9  # Of the ellipsoid
OUTSIDE = "bounds of the priors"
OF_ONE_MODEL = "the draws and every ± are of the chosen model only, although the data do not decide between models"
NOT_INFORMED = 0.9  # Share of the prior's standard deviation from which the data did not inform a coefficient
_MAX_TRIES = 20  # Draws that are tried for each one that is wanted


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Draws of the estimated coefficients of a vehicle, all of one weight.

    Attributes:
        names: of the coefficients.
        values: SI, shape (n, k).
        replaced: number of draws that were replaced, by the coefficient of which they have an impossible value.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "n k"]
    replaced: Mapping[str, int]


class Width(NamedTuple):
    """How far to randomise a coefficient: its value, and its standard deviation by the data and before them, SI.

    `by_data` is False if the data did not inform it: its width is then the prior's.
    """

    name: str
    value: float
    sd: float
    prior_sd: float | None
    by_data: bool


class Ellipsoid(NamedTuple):
    """Set that holds a share of the posterior, SI: centre (k,), matrix (k, k) in front of r^2, and the squared radius."""

    names: tuple[str, ...]
    centre: Float[np.ndarray, " k"]
    matrix: Float[np.ndarray, "k k"]
    squared_radius: float
    probability: float

    def holds(self, values: Float[np.ndarray, "... k"]) -> np.ndarray:
        """Return whether vectors of coefficients lie inside."""
        away = np.asarray(values, float) - self.centre
        scale = np.sqrt(np.diag(self.matrix))
        solved = np.linalg.solve(self.matrix / np.outer(scale, scale), (away / scale)[..., None])[..., 0]
        return np.sum(away / scale * solved, -1) <= self.squared_radius


@lru_cache(maxsize=4)
def ensemble_of(vehicle: ExportedVehicle, count: int = DRAWS, seed: int = 0) -> Ensemble:
    """Return draws of a vehicle's estimated coefficients; the same arguments give the same draws.

    Args:
        vehicle: with estimated coefficients.
        count: number of draws.
        seed: of the draws.

    Raises:
        InputError: a count that is none, or a posterior of which hardly any vehicle can move.
    """
    place = f'vehicle "{vehicle.name}", draws'
    check_count(count, place, least=2, remedy=f"some hundreds are enough, and {MOST_DRAWS} the most")
    if count > MOST_DRAWS:
        raise InputError(place, found=f"{count}", expected=f"at most {MOST_DRAWS}", remedy="some hundreds are enough")
    estimated, kept, replaced = vehicle.estimated, [], Counter()
    bounds = estimated.prior or (np.full(estimated.mean.shape, -np.inf), np.full(estimated.mean.shape, np.inf))
    scale = np.where(estimated.sd > 0, estimated.sd, 1.0)
    correlation = estimated.covariance / np.outer(scale, scale)
    random = np.random.default_rng(seed)
    tries = random.multivariate_normal(np.zeros(estimated.sd.size), correlation, _MAX_TRIES * count, method="eigh")
    for values in estimated.mean + estimated.sd * tries:
        if np.any((values <= bounds[0]) | (values >= bounds[1])):
            replaced[OUTSIDE] += 1
            continue
        try:
            check_stable(drawn_vehicle(vehicle, values), "draws")
        except InputError as refusal:
            replaced[refusal.where.rpartition(", ")[2]] += 1
            continue
        kept.append(values)
        if len(kept) == count:
            return Ensemble(estimated.names, np.array(kept), dict(replaced))
    raise InputError(
        place,
        found=f"{len(kept)} of {len(tries)} draws that can be a vehicle; impossible: {_counts(replaced)}",
        expected="a posterior most of which is possible",
        remedy="give these coefficients priors that end at 0 (`dissipative = true`), or run a trial that determines them",
    )


def drawn_vehicle(vehicle: ExportedVehicle, values: Float[np.ndarray, " k"]) -> ExportedVehicle:
    """Return a vehicle with other values of its estimated coefficients, SI, shape (k,)."""
    drawn = dict(zip(vehicle.estimated.names, map(float, values), strict=True))
    return replace(vehicle, coefficients={**vehicle.coefficients, **drawn})


def widths_of(estimated: CoefficientEstimates) -> tuple[Width, ...]:
    """Return how far to randomise each coefficient."""
    prior = [None] * len(estimated.names) if estimated.prior is None else estimated.prior.sd.tolist()
    return tuple(
        Width(name, float(mean), float(sd), before, before is None or bool(sd < NOT_INFORMED * before))
        for name, mean, sd, before in zip(estimated.names, estimated.mean, estimated.sd, prior, strict=True)
    )


def ellipsoid_of(estimated: CoefficientEstimates) -> Ellipsoid:
    """Return the set that holds `SET_PROBABILITY` of a normal posterior of this mean and covariance."""
    squared = 2.0 * float(gammaincinv(estimated.mean.size / 2, SET_PROBABILITY))  # the quantile of chi-square
    return Ellipsoid(estimated.names, estimated.mean, estimated.covariance, squared, SET_PROBABILITY)


def ensemble_lines(vehicle: ExportedVehicle, ensemble: Ensemble) -> tuple[str, ...]:
    """Return how the draws came about, how far to randomise, and the ellipsoid, line by line."""
    count, total = len(ensemble.values), sum(ensemble.replaced.values())
    ellipsoid = ellipsoid_of(vehicle.estimated)
    lines = [
        f"draws: {count}, each with a positive definite mass matrix and damping that takes energy; {total} others were impossible and "
        f"replaced" + (f" ({_counts(ensemble.replaced)})" if total else ""),
        "randomise by these standard deviations, or by whole rows of the draws, which keep the correlations:",
        *(f"  {_width_words(vehicle, width)}" for width in widths_of(vehicle.estimated)),
    ]
    lines += [f"caution: {OF_ONE_MODEL}"] if vehicle.estimated.quoted == "averaged" else []
    known = [name for name in vehicle.coefficients if name not in ensemble.names]
    lines += [f"not in the draws, because they were not estimated: {' '.join(['mass', 'inertia', *known])}"]
    return (
        *lines,
        f"ellipsoid of {ellipsoid.probability:.0%} of the posterior: mean, covariance and r^2 = {ellipsoid.squared_radius:.4g}; "
        f"{ellipsoid.holds(ensemble.values).mean():.0%} of the draws are inside",
    )


def _width_words(vehicle: ExportedVehicle, width: Width) -> str:
    unit = vehicle.unit(width.name)
    sd = width.sd if width.by_data or width.prior_sd is None else width.prior_sd
    words = f"{width.name} = {width.value:.4g} {unit} by {_share(sd, width.value)} ({sd:.2g} {unit})"
    if not width.by_data:
        return f"{words}: the data did not inform it, this width is the prior's"
    if width.prior_sd is not None:
        words += f", not by {_share(width.prior_sd, width.value)} as before the data"
    averaged = [one for one in vehicle.estimated.averaged if one.name == width.name]
    if vehicle.estimated.quoted == "averaged" and averaged:
        words += (
            f"; over all models the mean is {averaged[0].mean:.4g}, the standard deviation {averaged[0].sd:.2g} {unit}"
        )
    return words


def _share(sd: float, value: float) -> str:
    share = 100 * sd / abs(value) if value else np.inf
    return "more than its value" if share > 1000 else f"{share:.0f} %" if share >= 10 else f"{share:.2g} %"


def _counts(replaced: Mapping[str, int]) -> str:
    return ", ".join(f"{number} by {name}" for name, number in replaced.items())
