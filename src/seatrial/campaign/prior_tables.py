"""From a `[prior.NAME]` table to a prior in SI."""

import numpy as np

from seatrial.campaign.schema import PriorTable
from seatrial.core.errors import InputError
from seatrial.core.units import to_si
from seatrial.estimation.priors import LogUniform, Normal, Prior, Uniform

_NEEDED = {"uniform": ("lower", "upper"), "log-uniform": ("lower", "upper"), "normal": ("mean", "sd")}


def read_prior(table: PriorTable, unit: str, where: str) -> Prior:
    """Build the prior of a table.

    Args:
        table: as written.
        unit: SI unit of the parameter.
        where: file and key, for errors.

    Raises:
        InputError: numbers that are missing, too many, infinite or in the wrong order.
    """
    needed = _NEEDED[table.distribution]
    numbers = []
    for key in ("lower", "upper", "mean", "sd"):
        value = getattr(table, key)
        if (value is None) == (key in needed):
            raise InputError(
                where,
                found=f"{key} " + ("missing" if value is None else "given"),
                expected=" and ".join(needed) + f" for a {table.distribution} prior",
                remedy="correct the table",
            )
        if value is None:
            continue
        if not np.isfinite(value):
            raise InputError(
                f"{where}.{key}",
                found=str(value),
                expected="a finite number",
                remedy="an improper prior has no evidence: bound it",
            )
        numbers.append(value)
    first, second = numbers
    if table.distribution == "normal":
        if not second > 0:
            raise InputError(
                f"{where}.sd",
                found=f"{second:g}",
                expected="more than 0",
                remedy="fix the coefficient in the vehicle instead if it is known",
            )
    elif not first < second:
        raise InputError(
            where,
            found=f"lower {first:g}, upper {second:g}",
            expected="lower below upper",
            remedy="swap or correct them",
        )
    elif table.distribution == "log-uniform" and not first > 0:
        raise InputError(
            f"{where}.lower",
            found=f"{first:g}",
            expected="more than 0 for a log-uniform prior",
            remedy="give the smallest size that can matter",
        )
    factor = 1.0 if table.unit is None else to_si(1.0, table.unit, unit, f"{where}.unit")
    kinds = {"uniform": Uniform, "log-uniform": LogUniform, "normal": Normal}
    return kinds[table.distribution](first * factor, second * factor)
