"""Parameters of the configurations of a vehicle: those of one of them, and what changed between them, with its ±."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_kind
from seatrial.core.coefficients import base_name, configuration_of
from seatrial.core.errors import InputError, nearest

if TYPE_CHECKING:
    from seatrial.estimation.posterior.mode import Mode
    from seatrial.sampling.run import Draws


@dataclass(frozen=True)
class ConfigurationDifference:
    """A value in one configuration less that in the first, SI.

    Attributes:
        name: of the coefficient, without a configuration.
        unit: SI.
        first: configuration that all others are compared with, the one of the first record.
        second: the other configuration.
        first_mean: value in the first.
        first_sd: its standard deviation.
        second_mean: value in the second.
        second_sd: its standard deviation.
        difference: second less first.
        difference_sd: standard deviation of the difference.
    """

    name: str
    unit: str
    first: str
    second: str
    first_mean: float
    first_sd: float
    second_mean: float
    second_sd: float
    difference: float
    difference_sd: float


def configuration_differences(result: "Draws | Mode") -> tuple[ConfigurationDifference, ...]:
    """Return the differences between configurations by draws of a posterior, or by the normal approximation about its mode.

    Args:
        result: of a posterior of records of several configurations.

    Raises:
        InputError: neither draws nor a mode.
    """
    from seatrial.estimation.posterior.mode import Mode
    from seatrial.sampling.run import Draws  # with JAX, which readers of stored results do not need

    check_kind(result, (Draws, Mode), "result", "give what `sample` or `find_mode` returned")
    if isinstance(result, Mode):
        slope = result.sd / np.sqrt(np.diag(result.cov))
        return differences(result.names, result.units, result.values, result.cov * np.outer(slope, slope))
    table = result.array()
    return differences(result.names, result.units, table.mean(0), np.cov(table.T))


def differences(
    names: Sequence[str], units: Sequence[str], mean: Float[np.ndarray, " d"], cov: Float[np.ndarray, "d d"]
) -> tuple[ConfigurationDifference, ...]:
    """Return each value of a later configuration less that of the first.

    Args:
        names: of the parameters, those of a configuration as `X_u@loaded`.
        units: theirs, SI.
        mean: of them, SI.
        cov: their covariance, SI.
    """
    rows, first = [], {}
    sd = np.sqrt(np.diag(cov))
    for j, full in enumerate(names):
        name, second = base_name(full), configuration_of(full)
        i = first.setdefault(name, j) if second else j
        if i == j:
            continue
        row = ConfigurationDifference(
            name,
            units[j],
            first=configuration_of(names[i]),
            second=second,
            first_mean=float(mean[i]),
            first_sd=float(sd[i]),
            second_mean=float(mean[j]),
            second_sd=float(sd[j]),
            difference=float(mean[j] - mean[i]),
            difference_sd=float(np.sqrt(max(cov[i, i] + cov[j, j] - 2.0 * cov[i, j], 0.0))),
        )
        rows.append(row)
    return tuple(rows)


def names_in(names: Sequence[str], configuration: str | None, place: str) -> dict[str, str]:
    """Return the parameters of the vehicle in one configuration: the name of each, and that without the configuration.

    Args:
        names: of all parameters.
        configuration: whose values are taken; None if nothing differs between configurations.
        place: of its name, for errors.

    Raises:
        InputError: no such configuration, or none where values differ.
    """
    known = tuple(dict.fromkeys(filter(None, map(configuration_of, names))))
    if (configuration or known) and configuration not in known:
        differing = dict.fromkeys(base_name(name) for name in names if configuration_of(name))
        raise InputError(
            place,
            found="nothing" if configuration is None else f'"{configuration}"',
            expected=f"one of {', '.join(known)}, because {', '.join(differing)} differ between them"
            if known
            else "nothing, because no value differs between configurations",
            remedy=nearest(configuration or "", known) if known else "leave it out",
        )
    return {
        name: base_name(name) if configuration_of(name) else name
        for name in names
        if configuration_of(name) in ("", configuration)
    }
