"""Parameters of the configurations of a vehicle: those of one of them, and the changes between them with their ±."""

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
    """By how much a value changed between two configurations, SI.

    Attributes:
        name: of the coefficient, without a configuration.
        unit: SI.
        first: configuration with which all others are compared, the one of the first record.
        second: the other configuration.
        change: value in the second less that in the first.
        sd: standard deviation of the change.
    """

    name: str
    unit: str
    first: str
    second: str
    change: float
    sd: float


def configuration_differences(result: "Draws | Mode") -> tuple[ConfigurationDifference, ...]:
    """Return the differences between configurations by draws of a posterior, or by the normal approximation about its mode.

    Args:
        result: of a posterior of records of several configurations.

    Raises:
        InputError: neither draws nor a mode.
    """
    from seatrial.estimation.posterior.mode import Mode
    from seatrial.sampling.run import Draws  # with JAX, which readers of stored results do not need

    check_kind(result, (Draws, Mode), "result", "give the result of `sample` or `find_mode`")
    if isinstance(result, Mode):
        return differences(result.names, result.units, result.values, result.covariance)
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
    for j, full in enumerate(names):
        name, second = base_name(full), configuration_of(full)
        i = first.setdefault(name, j) if second else j
        if i != j:
            sd = float(np.sqrt(max(cov[i, i] + cov[j, j] - 2.0 * cov[i, j], 0.0)))
            change = float(mean[j] - mean[i])
            rows.append(ConfigurationDifference(name, units[j], configuration_of(names[i]), second, change, sd))
    return tuple(rows)


def names_in(names: Sequence[str], configuration: str | None, place: str) -> dict[str, str]:
    """Return the parameters of the vehicle in one configuration: the name of each, and that without the configuration.

    Args:
        names: of all parameters.
        configuration: whose values are taken; None if nothing differs between configurations.
        place: of its name, for errors.

    Raises:
        InputError: no such configuration, or none although values differ.
    """
    known = tuple(dict.fromkeys(filter(None, map(configuration_of, names))))
    if (configuration or known) and configuration not in known:
        raise InputError(
            place,
            found="nothing" if configuration is None else f'"{configuration}"',
            expected=f"a configuration: {', '.join(known)}"
            if known
            else "nothing, because no coefficient differs between configurations",
            remedy=nearest(configuration or "", known) if known else "leave it out",
        )
    return {
        name: base_name(name) if configuration_of(name) else name
        for name in names
        if configuration_of(name) in ("", configuration)
    }
