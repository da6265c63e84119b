"""Design of the first trial from the priors, and of the next one from the posterior."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from seatrial.campaign.config import Campaign
from seatrial.campaign.shown import shown_unit
from seatrial.campaign.store import Store, is_current, key_of, write_dataset
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import InputError
from seatrial.core.files import write_text
from seatrial.core.gaussian import Gaussian
from seatrial.design.sweep import Sweep, sweep_family
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.model import VehicleModel

STATE_SD = 0.05
"""Standard deviation of the vehicle's own state about trim at the start of a designed trial, in its unit (m/s)."""


def design_key(campaign: Campaign) -> str:
    """Key of the first design."""
    source = campaign.source
    return key_of(
        "design",
        *(part.model_dump() for part in (source.vehicle, source.structure, source.design)),
        {name: table.model_dump() for name, table in source.prior.items()},
        {name: table.model_dump() for name, table in source.sensors.items()},
        {name: table.model_dump() for name, table in source.limits.items()},
    )


def check_designable(campaign: Campaign) -> None:
    """Check that trials of this vehicle can be designed.

    Raises:
        InputError: it moves along other axes than X.
    """
    if not campaign.is_surge:
        raise InputError(
            campaign.where("structure"),
            found=f"terms on the axes {' '.join(campaign.axes)}",
            expected="terms on X and T only, of which trials are designed so far",
            remedy="`seatrial select`, `estimate`, `profile` and `criteria` work on other axes",
        )


def design_first(campaign: Campaign, watch: Watch = SILENT) -> Sweep:
    """Sweep the design grid under the priors of the full structure, or read the sweep if it is current."""
    check_designable(campaign)
    store, key = Store(campaign.folder), design_key(campaign)
    if is_current(store.design, key):
        return read_sweep(campaign, store.design)
    model = campaign.model(campaign.full)
    priors = [campaign.prior(term.text, model.unit_of(term)) for term in model.coefficients]
    belief = Gaussian(np.array([prior.mean for prior in priors]), np.diag([prior.sd for prior in priors]))
    return _sweep(campaign, model, belief, store.design, key, {"basis": "the priors"}, watch)


def design_next(campaign: Campaign, structure: Any, draws: np.ndarray, key: str, watch: Watch) -> Sweep:
    """Sweep the grid for the chosen structure from what the trial so far has taught.

    Args:
        campaign: configuration.
        structure: chosen structure.
        draws: posterior draws of its coefficients, SI, shape (n, k).
        key: key of the posterior.
        watch: who is told.
    """
    store = Store(campaign.folder)
    stamp = key_of("next", design_key(campaign), key, structure.terms)
    if is_current(store.next_design, stamp):
        return read_sweep(campaign, store.next_design)
    belief = Gaussian(draws.mean(0), np.linalg.cholesky(np.atleast_2d(np.cov(draws, rowvar=False))))
    return _sweep(
        campaign,
        campaign.model(structure),
        belief,
        store.next_design,
        stamp,
        {"basis": f"the posterior of {structure.label}"},
        watch,
    )


def read_sweep(campaign: Campaign, path: Path) -> Sweep:
    """Read a stored sweep; the schedule of its best trial is written again where it is missing or not the same."""
    data = open_dataset(path)
    sweep = Sweep(
        campaign.family, *(np.asarray(data[name]) for name in ("amplitude", "period", "gain", "peak_speed", "final_sd"))
    )
    schedule, text = Store(campaign.folder).schedule(path), _schedule(sweep)
    if not schedule.is_file() or schedule.read_bytes() != text.encode():
        write_text(schedule, text)
    return sweep


def _sweep(
    campaign: Campaign, model: VehicleModel, belief: Gaussian, path: Path, key: str, attrs: dict[str, str], watch: Watch
) -> Sweep:
    """Run the filter in units of the current standard deviations, where every coefficient is of order one."""
    family, (amplitude, period) = campaign.family, campaign.grid()
    if model.controls != (family.control,):
        raise InputError(
            campaign.where("structure"),
            found="controls " + ", ".join(model.controls),
            expected=f"the one control that is designed, {family.control}",
            remedy="leave the terms of other controls out",
        )
    scales = np.asarray(belief.sd)
    d = len(model.states)
    chol = np.zeros((d + scales.size,) * 2)
    chol[range(d), range(d)] = STATE_SD
    chol[d:, d:] = np.asarray(belief.chol_cov) / scales[:, None]
    speed = [campaign.hull.trim.get(state, 0.0) for state in model.states]
    initial = Gaussian(np.concatenate([speed, np.asarray(belief.mean) / scales]), chol)
    noise = np.array([campaign.noise(channel) for channel in campaign.channels])
    space = discretise(model, campaign.channels, initial, np.zeros(d + scales.size), noise, scales.tolist())
    report = watch.progress(f"design: {amplitude.size * period.size} trials")
    report(0, 1)
    sweep = sweep_family(
        space, family, amplitude, period, campaign.limits(), measured=campaign.measured_mask(family.time())
    )
    report(1, 1)
    names = [term.text for term in model.coefficients]
    dataset = xr.Dataset(
        {
            "gain": (
                ("amplitude", "period"),
                sweep.gain,
                {"units": "nat", "long_name": "entropy reduction of the coefficients"},
            ),
            "peak_speed": (("amplitude", "period"), sweep.peak_speed, {"units": "m/s"}),
            "final_sd": (
                ("amplitude", "period", "coefficient"),
                sweep.final_sd * scales,
                {"long_name": "predicted sd, SI"},
            ),
            "sd_before": (("coefficient",), scales, {"long_name": "sd before the trial, SI"}),
        },
        coords={
            "amplitude": ("amplitude", sweep.amplitude, {"units": "SI"}),
            "period": ("period", sweep.period, {"units": "s"}),
            "coefficient": names,
        },
        attrs={**attrs, "control": family.control, "trim": family.trim},
    )
    write_dataset(path, dataset, key)
    return read_sweep(campaign, path)


def _schedule(sweep: Sweep) -> str:
    """Edges of the best trial in the unit of the trade: time and control, linear in between where the edges are ramps."""
    factor, unit = shown_unit(sweep.family.control)
    time, control = sweep.best_manoeuvre().sample(sweep.family.sample_time)
    bend = np.abs(np.diff(control, n=2)) > 1e-9 * max(1.0, float(np.abs(control).max()))
    corner = np.flatnonzero(np.concatenate([[True], bend, [True]]))
    rows = "".join(f"{time[i]:.6g},{control[i] * factor:.10g}\n" for i in corner)
    return f"time_s,{sweep.family.control}_{unit}\n{rows}"
