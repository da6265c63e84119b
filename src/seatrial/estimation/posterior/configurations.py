"""What changed between the configurations of a vehicle: differences of their values, with the ± that their correlation leaves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_kind
from seatrial.core.coefficients import base_name, configuration_of
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


def configuration_differences(result: Draws | Mode) -> tuple[ConfigurationDifference, ...]:
    """Return the differences between configurations by draws of a posterior, or by the normal approximation about its mode.

    Args:
        result: of a posterior of records of several configurations.

    Raises:
        InputError: neither draws nor a mode.
    """
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
        variance = max(float(cov[i, i] + cov[j, j] - 2.0 * cov[i, j]), 0.0)
        values = *map(float, (mean[i], sd[i], mean[j], sd[j], mean[j] - mean[i])), float(np.sqrt(variance))
        rows.append(ConfigurationDifference(name, units[j], configuration_of(names[i]), second, *values))
    return tuple(rows)
