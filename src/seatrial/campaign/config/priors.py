"""From `[prior.NAME]` tables to priors in SI."""

from collections.abc import Callable, Mapping
from math import inf, isfinite

from seatrial.campaign.config.campaign import Campaign, no_prior
from seatrial.campaign.config.file_keys import FileKeys
from seatrial.campaign.config.nuisance_parameters import nuisances
from seatrial.campaign.config.schema import PriorTable
from seatrial.core.coefficients import AXES, CoefficientName
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.units import to_si
from seatrial.estimation.priors import (
    LogNormal,
    LogUniform,
    Normal,
    Prior,
    Uniform,
    half_normal,
    physical_support,
    restricted,
    truncated_normal,
)
from seatrial.estimation.sensors import correlation_name

_BOUNDS = ("lower", "upper")
_NUMBERS = (*_BOUNDS, "mean", "sd", "scale", "median", "factor")
_KINDS: dict[str, tuple[tuple[str, ...], int, Callable[..., Prior]]] = {
    "uniform": (_BOUNDS, 0, Uniform),
    "log-uniform": (_BOUNDS, 0, LogUniform),
    "normal": (("mean", "sd"), 0, Normal),
    "half-normal": (("scale",), 1, half_normal),
    "log-normal": (("median", "factor"), 0, LogNormal),
    "truncated-normal": (
        ("mean", "sd"),
        2,
        lambda mean, sd, lower=-inf, upper=inf: truncated_normal(mean, sd, lower, upper),
    ),
}
"""Distribution to the numbers it needs, how many bounds it may have beside them (one at least), and what makes it."""


def read_priors(tables: Mapping[str, PriorTable], keys: FileKeys, campaign: Campaign) -> dict[str, Prior]:
    """Read every prior that something uses.

    Args:
        tables: as written, with those of what is known from elsewhere.
        keys: of the file.
        campaign: of which all but the priors is known.

    Raises:
        InputError: a prior that is missing, that nothing uses, or that is none; a support below 0 of what has no sign.
    """
    found, units, model = {}, campaign.units, campaign.model(campaign.full)
    inertia = 1.0 if campaign.hull.mass is None else campaign.hull.mass
    unknown = tuple(
        nuisances(campaign.estimation, campaign.sensor_models, campaign.noise, model, has_delay="delay" in tables)
    )
    for name, unit in units.items():
        if name not in tables:
            unused = [other for other in tables if other not in campaign.full.terms]
            raise no_prior(keys.where(f"prior.{name}"), name, unit, unused)
        found[name] = read_prior(tables[name], unit, keys.where(f"prior.{name}"), name=name, inertia=inertia)
    for one in unknown:
        where = keys.where(f"prior.{one.name}")
        if one.name in tables:
            found[one.name] = read_prior(tables[one.name], one.unit, where, name=one.name, inertia=inertia)
        elif one.default is None:
            raise one.no_prior(where)
    allowed = {*units, *campaign.rules.never, "delay", *(one.name for one in unknown)}
    for name in tables:
        if name not in allowed:
            raise InputError(
                keys.where(f"prior.{name}"),
                found=f'"{name}", which nothing uses',
                expected="one of " + ", ".join(sorted(allowed)),
                remedy="remove it: white residuals have no correlation time"
                if name in map(correlation_name, campaign.channels)
                else nearest(name, allowed),
            )
    if "delay" in found and not isinstance(found["delay"], Uniform):
        raise InputError(
            keys.where("prior.delay"),
            found=f"a {type(found['delay']).__name__} prior",
            expected="a uniform prior from 0 s",
            remedy="give lower and upper",
        )
    for one in unknown:
        if not one.signed and one.name in found and found[one.name].bounds[0] < 0:
            raise InputError(
                keys.where(f"prior.{one.name}"),
                found="a support that reaches below 0",
                expected="a prior from 0 up",
                remedy="give lower = 0 and upper, or a half-normal or log-uniform prior",
            )
    return found


def read_prior(table: PriorTable, unit: str, where: str, *, name: str = "", inertia: float = 1.0) -> Prior:
    """Build the prior of a table.

    Args:
        table: as written.
        unit: SI unit of the parameter.
        where: file and key, for errors.
        name: of the parameter, which says what `physical` means.
        inertia: mass that added mass must leave positive, kg; 1 for coefficients per unit of mass.

    Raises:
        InputError: numbers that are missing, too many, infinite or in the wrong order; a prior that is empty, or
            `physical` where nothing is known about the sign.
    """
    numbers = _numbers(table, where)
    _check_sizes(table.distribution, numbers, where)
    factor = 1.0 if table.unit is None else to_si(1.0, table.unit, unit, f"{where}.unit")
    with located(where):
        si = {key: value if key == "factor" else value * factor for key, value in numbers.items()}
        prior = _KINDS[table.distribution][2](**si)
    return _physical(prior, name, inertia, f"{where}.physical") if table.physical else prior


def _numbers(table: PriorTable, where: str) -> dict[str, float]:
    """Numbers of the table, those its distribution needs and no others."""
    needed, bounds, _ = _KINDS[table.distribution]
    allowed = (*needed, *(_BOUNDS if bounds else ()))
    numbers = {}
    for key in _NUMBERS:
        value = getattr(table, key)
        if (value is None and key in needed) or (value is not None and key not in allowed):
            raise _not_these(table.distribution, where, f"{key} " + ("missing" if value is None else "given"))
        if value is None:
            continue
        if not isfinite(value):
            raise InputError(
                f"{where}.{key}",
                found=str(value),
                expected="a finite number",
                remedy="give the smallest and the largest value you would believe"
                + ("; leave the key out for a side without a bound" if bounds else ""),
            )
        numbers[key] = value
    given = [key for key in _BOUNDS if key in numbers]
    if bounds and not 1 <= len(given) <= bounds:
        raise _not_these(table.distribution, where, " and ".join(given) + " given" if given else "no bound")
    return numbers


def _not_these(distribution: str, where: str, found: str) -> InputError:
    needed, bounds, _ = _KINDS[distribution]
    keys = " and ".join(needed) + ("", " and one of lower and upper", " and lower, upper or both")[bounds]
    return InputError(where, found=found, expected=f"{keys} for a {distribution} prior", remedy="correct the table")


def _check_sizes(distribution: str, numbers: dict[str, float], where: str) -> None:
    """Check that sizes are positive and bounds in order."""
    for key in ("sd", "scale"):
        if key in numbers and not numbers[key] > 0:
            raise InputError(
                f"{where}.{key}",
                found=f"{numbers[key]:g}",
                expected="more than 0",
                remedy="fix the coefficient in the vehicle instead if it is known",
            )
    if "lower" in numbers and "upper" in numbers and not numbers["lower"] < numbers["upper"]:
        raise InputError(
            where,
            found=f"lower {numbers['lower']:g}, upper {numbers['upper']:g}",
            expected="lower below upper",
            remedy="swap or correct them: nothing lies between",
        )
    if distribution == "log-uniform" and not numbers["lower"] > 0:
        raise InputError(
            f"{where}.lower",
            found=f"{numbers['lower']:g}",
            expected="more than 0 for a log-uniform prior",
            remedy="give the smallest size that can matter",
        )
    if numbers.get("median") == 0:
        raise InputError(
            f"{where}.median",
            found="0",
            expected="a median above or below 0, whose sign all values have",
            remedy="give the value that is as likely too large as too small, for example -3.0",
        )
    if "factor" in numbers and not numbers["factor"] > 1:
        raise InputError(
            f"{where}.factor",
            found=f"{numbers['factor']:g}",
            expected="more than 1: two values in three lie within this factor of the median",
            remedy="2.0 says: between half and twice the median",
        )


def _physical(prior: Prior, name: str, inertia: float, where: str) -> Prior:
    """Cut a coefficient's prior to its physical side."""
    term = CoefficientName.parse(name) if name.split("_")[0] in AXES else None
    support = None if term is None else physical_support(term, inertia)
    if support is None:
        raise InputError(
            where,
            found=f"true for {name}, whose sign physics leaves open",
            expected="damping along the term's own axis (X_u, X_uabsu) or its added mass (X_udot)",
            remedy="remove the key, and bound the prior by lower and upper where you know better",
        )
    with located(where):
        return restricted(prior, *support)
