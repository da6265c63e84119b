"""Coefficients by a record's own regression rows: where to linearise about when the priors do not say how the vehicle moves."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config import Campaign
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.estimation.late_rows import delayed, likely_delay
from seatrial.estimation.priors import Prior
from seatrial.estimation.row_fit import independent_rows
from seatrial.estimation.weak_form import where_measured
from seatrial.estimation.windows import FEWEST


def values_by_rows(
    campaign: Campaign, record: Record, names: Sequence[str], priors: Sequence[Prior]
) -> Float[np.ndarray, " k"]:
    """Mean of the coefficients of the full structure given one record's rows and normal priors, inside the priors' bounds.

    Args:
        campaign: whose axes each have an equation.
        record: a trial.
        names: coefficients.
        priors: of each, SI.

    Raises:
        InputError: a whole vehicle, whose axes have no equations of their own; a signal that was not measured; or too few rows, or
            rows that cannot tell the terms apart.
    """
    equations = campaign.vehicle.equations(campaign.full)
    if not equations:
        raise InputError(
            f'record "{record.label}"',
            found="a whole vehicle, whose axes are coupled",
            expected="equations of single axes",
            remedy="centre the priors where the vehicle moves",
        )
    used = dict.fromkeys(name for equation in equations for name in (equation.rate, *equation.signals))
    record = where_measured(record, [name for name in used if name in record.measured])
    width = FEWEST * float(np.median(record.step))
    if campaign.has_delay:
        delay = likely_delay([record], equations, width, *campaign.prior("delay", "s").bounds)
        record = delayed(record, delay)
    noise = {channel: campaign.noise(channel) for channel in campaign.channels}
    rows, _ = independent_rows(equations, [record], noise, width)
    order = [rows.names.index(name) for name in names]
    mean, sd = (np.array([float(getattr(prior, key)) for prior in priors]) for key in ("mean", "sd"))
    design = rows.design[:, order]
    stacked = np.vstack([design * sd, np.eye(sd.size)])
    moved, *_ = np.linalg.lstsq(stacked, np.concatenate([rows.target - design @ mean, np.zeros(sd.size)]), rcond=None)
    lower, upper = np.array([prior.bounds for prior in priors]).T
    return np.clip(mean + sd * moved, lower, upper)
