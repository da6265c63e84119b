"""From `[prior.NAME]` tables to priors in SI."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from math import inf, isfinite
from typing import Any

from seatrial.campaign.config.assumed_unknowns import no_unknown_prior
from seatrial.campaign.config.campaign import no_prior
from seatrial.campaign.config.schema import PriorTable
from seatrial.campaign.config.toml import FileKeys
from seatrial.core.coefficients import AXES, CoefficientName, base_name
from seatrial.core.display_units import listed
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.units import to_si
from seatrial.estimation.posterior.unknowns import Unknown
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
from seatrial.estimation.simulation.mounts import LATE, MAX_LATENESS
from seatrial.estimation.simulation.sensor_errors import noise_kinds, noise_name
from seatrial.vehicles.tether import TETHER

_BOUNDS = ("lower", "upper")
_NUMBERS = (*_BOUNDS, "mean", "sd", "scale", "median", "factor")
# Distribution to the numbers it needs, how many bounds it may have beside them (one at least), and what makes it.
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


def numbers_of(distribution: object) -> tuple[str, ...]:
    """Return the keys of numbers that a prior of a distribution may have; none of one that is no distribution."""
    needed, bounds, _ = _KINDS.get(str(distribution), ((), 0, None))
    return (*needed, *_BOUNDS) if bounds else needed


_CALLED = {"location": "mean", "scale": "sd"}  # Arguments of a truncated normal by their keys


def read_priors(
    tables: Mapping[str, PriorTable],
    keys: FileKeys,
    units: Mapping[str, str],
    unknown: Sequence[Unknown],
    never: Sequence[str],
    inertia: float,
    parts: Sequence[str] = (),
) -> dict[str, Prior]:
    """Read every prior that something uses.

    Args:
        tables: as written, with those of what is known from elsewhere.
        keys: of the file.
        units: SI unit of every coefficient.
        unknown: what is estimated beside them.
        never: terms that the rules leave out; their priors are not read.
        inertia: see `read_prior`.
        parts: names of one configuration, such as `X_u@loaded`, which may have a prior instead of that of `X_u`.

    Raises:
        InputError: a prior that is missing, that nothing uses, or that is none; a support below 0 of what has no sign.
    """
    if missing := {name: unit for name, unit in units.items() if name not in tables}:
        raise no_prior(keys.where, missing, [other for other in tables if other not in units])
    if needed := [one for one in unknown if one.default is None and one.name not in tables]:
        raise no_unknown_prior(keys.where, needed)
    every = {**units, **{one.name: one.unit for one in unknown}}
    every |= {name: every[base_name(name)] for name in parts if base_name(name) in every}
    priors = {
        name: read_prior(tables[name], unit, keys.where(f"prior.{name}"), name=base_name(name), inertia=inertia)
        for name, unit in every.items()
        if name in tables
    }
    _check_used(tables, keys, (*units, *never), [*(one.name for one in unknown), *parts])
    if "delay" in priors and not isinstance(priors["delay"], Uniform):
        raise InputError(
            keys.where("prior.delay"),
            found=f"a {type(priors['delay']).__name__} prior",
            expected="a uniform prior from 0 s",
            remedy="give lower and upper",
        )
    for name in priors:
        if name.startswith(f"{LATE}_") and priors[name].bounds[1] > MAX_LATENESS:
            raise InputError(
                keys.where(f"prior.{name}"),
                found="a support that reaches beyond 1 s",
                expected=f"a prior of the lag of the sensor, from 0 s to {MAX_LATENESS:g} s at most",
                remedy='for example distribution = "uniform", lower = 0.0 and upper = 0.5',
            )
    unsigned = [one.name for one in unknown if not one.signed]
    for name, prior in priors.items():
        if base_name(name) in unsigned and prior.bounds[0] < 0:
            raise InputError(
                keys.where(f"prior.{name}"),
                found="a support that reaches below 0",
                expected="a prior from 0 up",
                remedy="give lower = 0 and upper, or a half-normal or log-uniform prior",
            )
    return priors


def _check_used(tables: Mapping[str, PriorTable], keys: FileKeys, terms: Sequence[str], unknown: Sequence[str]) -> None:
    """Check that something uses every prior: a term, the delay, or what else is unknown."""
    allowed = tuple(dict.fromkeys((*terms, "delay", *unknown)))
    channels = [one.removeprefix(noise_name("")) for one in unknown if one.startswith(noise_name(""))]
    unused = [name for name in tables if name not in allowed]
    if unused:
        raise InputError(
            keys.where(f"prior.{unused[0]}"),
            found=f'"{unused[0]}", which nothing uses',
            expected="one of " + ", ".join(sorted(allowed)),
            remedy=_unused_remedy(unused, channels, allowed),
        )


def _unused_remedy(unused: Sequence[str], channels: Sequence[str], allowed: Sequence[str]) -> str:
    """Return what to do with priors that nothing uses; all that is used has a prior, so that none is meant for a term without one."""
    name = unused[0]
    of_noise = {one: (channel, kind) for channel in channels for one, kind in noise_kinds(channel).items()}
    if name in of_noise:
        channel = of_noise[name][0]
        kind = next((kind for one, (of, kind) in of_noise.items() if of == channel and one in allowed), "white")
        tables = [f"[prior.{one}]" for one in unused if one in of_noise]
        return f"remove {listed(tables)}, of {of_noise[name][1]} residuals: those of {channel} are {kind}"
    if (base := base_name(name)) != name and base in allowed:
        siblings = [one for one in allowed if base_name(one) == base and one != base]
        return (
            nearest(name, siblings) if siblings else f"add {base} to estimation.by_configuration, or remove this table"
        )
    if name in TETHER:
        return "add [vehicle.tether] to a vehicle with `moves`"
    with suppress(InputError):
        return f"delete the table, or name {CoefficientName.parse(name).text} under always or optional of [structure]"
    return nearest(name, allowed)


def prior_of_keys(keys: Mapping[str, Any], unit: str, where: str, name: str) -> Prior:
    """Build the prior of the keys of a table that the program writes itself; arguments and errors as `read_prior`."""
    return read_prior(PriorTable(**keys), unit, where, name=name)


def read_prior(table: PriorTable, unit: str, where: str, *, name: str = "", inertia: float = 1.0) -> Prior:
    """Build the prior of a table.

    Args:
        table: as written.
        unit: SI unit of the parameter.
        where: file and key, for errors.
        name: of the parameter, which says what `dissipative` means.
        inertia: mass that added mass must leave positive, kg; 1 for coefficients per unit of mass.

    Raises:
        InputError: numbers that are missing, too many, infinite or in the wrong order; a prior that is empty, or
            `dissipative` where nothing is known about the sign.
    """
    numbers = _numbers(table, where)
    make = _KINDS[table.distribution][2]
    with _of_key(where, numbers):
        make(**numbers)
    factor = 1.0 if table.unit is None else to_si(1.0, table.unit, unit, f"{where}.unit")
    with located(where):
        si = {key: value if key == "factor" else value * factor for key, value in numbers.items()}
        prior = make(**si)
    return _physical(prior, name, inertia, f"{where}.dissipative") if table.dissipative else prior


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
                remedy="give the smallest and the largest plausible value"
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


@contextmanager
def _of_key(where: str, numbers: Mapping[str, float]) -> Iterator[None]:
    """Put the key of a table in the place of the argument that an error of a prior names."""
    try:
        yield
    except InputError as error:
        name = error.where.rpartition(", ")[2]
        key = next((key for key in (name, _CALLED.get(name)) if key in numbers), None)
        place = f"{where}: {error.where}" if key is None else f"{where}.{key}"
        raise InputError(place, found=error.found, expected=error.expected, remedy=error.remedy) from None


def _physical(prior: Prior, name: str, inertia: float, where: str) -> Prior:
    """Cut a coefficient's prior to its physical side."""
    term = CoefficientName.parse(name) if name.split("_")[0] in AXES else None
    support = None if term is None else physical_support(term, inertia)
    if support is None:
        raise InputError(
            where,
            found=f"true for {name}, which may have either sign",
            expected="damping (X_u, X_uabsu) or added mass (X_udot) along the axis of the term",
            remedy="remove the key, and bound the prior by lower and upper if you know a bound",
        )
    with located(where):
        return restricted(prior, *support)
