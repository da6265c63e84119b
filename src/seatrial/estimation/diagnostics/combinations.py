"""Which parameters the data only show together, and which of their sums and ratios are known when each alone is not.

Of all sums a^T c the one with the least sd(a^T c) / |a^T c| is a = C^-1 c, whose relative standard deviation is
(c^T C^-1 c)^-1/2 (Cauchy-Schwarz). It is compared with sums that mean something: the slope of a force with a signal at the
operating point, sum c_i d phi_i / d s, and the force itself there over the signal, sum c_i phi_i / s.

Changes of several parameters at once that leave every measurement as it is are the null space of the scaled information.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import AXES, CoefficientName, is_coefficient
from seatrial.core.signals import SIGNALS, signal_unit

# Eigenvalue of the information, its diagonal scaled to one, over the largest, below which a combination is invisible.
INVISIBLE = 1e-10
# Share of the largest effect on the measurements, each parameter's taken alone, below which it is not named as part of
# a change.
SHOWN = 1e-3
WORTH = 0.7  # Relative standard deviation, over that of the best parameter alone, from which a sum is worth naming


class Unknown(NamedTuple):
    """What these functions need of each parameter.

    Attributes:
        names: names.
        units: SI units.
        values: values.
        scale: change of each parameter that counts as one in the scaled information: its value where that is known, else its
            prior standard deviation.
        relative: whether `scale` is the value, so that scaled changes are relative ones.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " d"]
    scale: Float[np.ndarray, " d"]
    relative: np.ndarray

    def pick(self, chosen: Sequence[int]) -> "Unknown":
        """Return some of them."""
        at = list(chosen)
        names, units = tuple(self.names[i] for i in at), tuple(self.units[i] for i in at)
        return Unknown(names, units, self.values[at], self.scale[at], self.relative[at])


class Invisible(NamedTuple):
    """A change of several parameters at once that leaves every measurement as it is.

    Attributes:
        names: parameters that change.
        steps: by how much, in units of `Unknown.scale`, the smallest being one.
        relative: whether each step is a share of the parameter's value.
    """

    names: tuple[str, ...]
    steps: tuple[float, ...]
    relative: tuple[bool, ...]

    @property
    def is_scale(self) -> bool:
        """Whether all of them grow alike, so that their ratios are known."""
        return all(self.relative) and np.ptp(self.steps) < 1e-3 * abs(self.steps[0])


class Combination(NamedTuple):
    """A sum of parameters, or a ratio, with its value and standard deviation.

    Attributes:
        text: what it is made of, such as `X_u + 2 u0 X_uabsu`.
        meaning: what it is, empty if it is nothing but the sum known best.
        unit: SI unit.
        weights: factor of each parameter; empty of a ratio.
        value: its value.
        sd: its standard deviation.
    """

    text: str
    meaning: str
    unit: str
    weights: tuple[float, ...]
    value: float
    sd: float

    @property
    def relative_sd(self) -> float:
        """Standard deviation over the size of the value."""
        return self.sd / max(abs(self.value), 1e-300)


def null_combinations(information: Float[np.ndarray, "d d"], unknown: Unknown) -> tuple[Invisible, ...]:
    """Return the combinations without information, each with as few parameters as elimination leaves.

    The rank is judged with every diagonal entry scaled to one, so that it depends on no unit, value or prior.

    Args:
        information: of the data, in the parameters' own units, of parameters the data touch at all.
        unknown: the parameters.
    """
    size = np.sqrt(np.abs(np.diag(information)))
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(size, size))
    results = []
    for effect in _eliminated(vectors[:, eigenvalues < INVISIBLE * eigenvalues[-1]].T):
        named = np.flatnonzero(np.abs(effect) > SHOWN * np.abs(effect).max())
        part = unknown.pick(named)
        steps = effect[named] / (size[named] * part.scale)
        steps = steps / np.abs(steps).min() * np.sign(steps[0])
        results.append(Invisible(part.names, tuple(map(float, steps)), tuple(map(bool, part.relative))))
    return tuple(results)


def known_combinations(
    unknown: Unknown, cov: Float[np.ndarray, "d d"], at: Mapping[str, float]
) -> tuple[Combination, ...]:
    """Return the sums of a group that are known better than its parameters: those with a meaning first, the best of all last.

    Args:
        unknown: parameters that are correlated.
        cov: their covariance.
        at: operating point, signal name to SI value.
    """
    results = []
    for meant in _meant(unknown, at):
        weights = np.array(meant.weights)
        sd = float(np.sqrt(max(weights @ cov @ weights, 0.0)))
        results.append(meant._replace(value=float(weights @ unknown.values), sd=sd))
    results += _ratio_of_two(unknown, cov)
    single = float(np.min(np.sqrt(np.diag(cov)) / np.maximum(np.abs(unknown.values), 1e-300)))
    better = sorted((item for item in results if item.relative_sd < WORTH * single), key=lambda item: item.relative_sd)
    return (*better, _best(unknown, cov, WORTH * single))


def groups(correlation: Float[np.ndarray, "d d"], threshold: float) -> list[list[int]]:
    """Return the parameters tied by correlations beyond a threshold, each group in order."""
    left, results = set(range(len(correlation))), []
    while left:
        group, border = set(), {min(left)}
        while border:
            group |= border
            border = {j for i in border for j in left - group if abs(correlation[i, j]) > threshold}
        left -= group
        if len(group) > 1:
            results.append(sorted(group))
    return results


def _eliminated(rows: Float[np.ndarray, "r d"]) -> Float[np.ndarray, "r d"]:
    """Return the same space by rows of which each has a one in a column of zeros of the others: Gauss and Jordan, largest pivots."""
    rows, free = rows.copy(), list(range(len(rows)))
    while free:
        which, column = np.unravel_index(np.argmax(np.abs(rows[free])), rows[free].shape)
        pivot = free.pop(which)
        rows[pivot] /= rows[pivot, column]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, column] * rows[pivot]
    return rows


def _meant(unknown: Unknown, at: Mapping[str, float]) -> list[Combination]:
    """Return the sums of force coefficients of one axis in one signal that mean something, without their standard deviations."""
    if not all(map(is_coefficient, unknown.names)):
        return []
    terms = [CoefficientName.parse(name) for name in unknown.names]
    signals = {signal for term in terms for signal in term.signals}
    signal = next(iter(signals), "")
    mixed = any(len({factor.change for factor in term.factors}) > 1 for term in terms)
    if len(signals) != 1 or len({term.axis for term in terms}) != 1 or not at.get(signal) or mixed:
        return []
    if any(term.is_added_mass for term in terms):
        return []
    here = at[signal]
    point = f"{signal}0 = {here:.4g} {signal_unit(signal)}"
    force = "drag" if (terms[0].axis, signal) == ("X", "u") else AXES[terms[0].axis][1]
    powers = [sum(factor.power for factor in term.factors) for term in terms]
    over = [float(term.regressor({signal: here}, {signal: here})) / here for term in terms]
    slopes = [
        float(power == 1) if term.trim_signals else power * share
        for term, power, share in zip(terms, powers, over, strict=True)
    ]
    size = f"{signal}0" if here > 0 else f"|{signal}0|"
    # The unit of a force over the signal; as the coefficient's unit, it may be per unit of mass.
    dimensions = (terms[0].dimension, terms[0].dimension._replace(kg=terms[0].dimension.kg - 1))
    own = [dimension for dimension in dimensions if unknown.units[0] == str(dimension)]
    unit = str(own[0].times(SIGNALS[signal].dimension, powers[0] - 1)) if own else "1"
    sums = (
        (f"the slope of the {force} at {point}", slopes, [_factor(power, power - 1, size) for power in powers]),
        (f"the {force} over {signal} at {point}", over, [_factor(1, power - 1, size) for power in powers]),
    )
    return [
        Combination(_sum(weights, factors, unknown.names), meaning, unit, tuple(weights), 0.0, 0.0)
        for meaning, weights, factors in sums
        if np.count_nonzero(weights) > 1
    ]


def _ratio_of_two(unknown: Unknown, cov: Float[np.ndarray, "d d"]) -> list[Combination]:
    """Return the ratio of two parameters that grow together and are away from zero, its variance that of the difference of logarithms."""
    relative = np.sqrt(np.diag(cov)) / np.maximum(np.abs(unknown.values), 1e-300)
    if len(unknown.names) != 2 or relative.max() > 0.3:
        return []
    scaled = cov / np.outer(unknown.values, unknown.values)
    axes = {name.split("_")[0] for name in unknown.names if is_coefficient(name)}
    value = float(unknown.values[0] / unknown.values[1])
    sd = abs(value) * float(np.sqrt(max(scaled[0, 0] + scaled[1, 1] - 2 * scaled[0, 1], 0.0)))
    meaning = "which sets the steady speed" if axes == {"X", "T"} else ""
    text = f"the ratio {unknown.names[0]} / {unknown.names[1]}"
    return [Combination(text, meaning, _unit_ratio(unknown, 1), (), value, sd)]


def _factor(multiple: int, power: int, size: str) -> str:
    raised = "" if power == 0 else size if power == 1 else f"{size}^{power}"
    return " ".join(part for part in ("" if multiple == 1 else str(multiple), raised) if part)


def _sum(weights: Sequence[float], factors: Sequence[str], names: Sequence[str]) -> str:
    """`X_u + 2 u0 X_uabsu`: signs from the weights, sizes from the factors in words."""
    parts = [
        f"{'-' if weight < 0 else '+'} {factor} {name}".replace("  ", " ")
        for weight, factor, name in zip(weights, factors, names, strict=True)
        if weight != 0
    ]
    return " ".join(parts).removeprefix("+ ")


def _best(unknown: Unknown, cov: Float[np.ndarray, "d d"], enough: float) -> Combination:
    """Return the sum of least relative standard deviation, of as few of the parameters as come within 5 % of it.

    Where that is not below `enough`, as of two parameters whose difference is known and small, the sum of least variance in units
    of the standard deviations.
    """
    sd = np.sqrt(np.diag(cov))
    correlation, size = cov / np.outer(sd, sd), unknown.values / sd
    members = list(range(sd.size))
    while len(members) > 2:
        fewer = [[i for i in members if i != out] for out in members]
        precision = [_precision(correlation, size, some) for some in fewer]
        if max(precision) < _precision(correlation, size, members) / 1.05:
            break
        members = fewer[int(np.argmax(precision))]
    if 1 / _precision(correlation, size, members) < enough:
        weights = _weights(correlation, size, members)
    else:
        members = list(range(sd.size))
        weights = np.linalg.eigh(correlation)[1][:, 0]
        members = [i for i in members if abs(weights[i]) > 0.1 * np.abs(weights).max()]
        weights = weights[members]
    weights = weights / sd[members]
    weights = weights / weights[0]
    part = unknown.pick(members)
    factors = [_ratio(weight, part, i) if i else "" for i, weight in enumerate(weights)]
    variance = weights @ cov[np.ix_(members, members)] @ weights
    value = float(weights @ part.values)
    return Combination(
        _sum(weights, factors, part.names), "", part.units[0], tuple(weights), value, float(np.sqrt(max(variance, 0.0)))
    )


def _weights(correlation: np.ndarray, size: np.ndarray, members: list[int]) -> np.ndarray:
    """Return the weights of the best sum in units of the standard deviations."""
    eigenvalues, vectors = np.linalg.eigh(correlation[np.ix_(members, members)])
    return vectors @ ((vectors.T @ size[members]) / np.maximum(eigenvalues, 1e-12))


def _precision(correlation: np.ndarray, size: np.ndarray, members: list[int]) -> float:
    """Size of the best sum over its standard deviation; tiny where no parameter differs from zero."""
    return float(np.sqrt(max(size[members] @ _weights(correlation, size, members), 1e-300)))


def _ratio(weight: float, part: Unknown, i: int) -> str:
    """Return the factor of one member with its unit, that of the first member over its own; nothing if it is one."""
    unit = _unit_ratio(part, i)
    if unit == "1":
        return "" if abs(abs(weight) - 1) < 5e-4 else f"{abs(weight):.3g}"
    return f"{abs(weight):.3g} {unit}"


def _unit_ratio(unknown: Unknown, i: int) -> str:
    """Return the unit of the first parameter over that of another."""
    if unknown.units[i] == unknown.units[0]:
        return "1"
    if is_coefficient(unknown.names[0]) and is_coefficient(unknown.names[i]):
        first, own = (CoefficientName.parse(name).dimension for name in (unknown.names[0], unknown.names[i]))
        return str(first.times(own, -1))
    return f"({unknown.units[0]})/({unknown.units[i]})"
