"""Design of the first trial from the priors, and of the next one from the posterior."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from seatrial.campaign.config import Campaign
from seatrial.campaign.design_words import design_words
from seatrial.campaign.problem import random_key
from seatrial.campaign.schedules import write_schedule
from seatrial.campaign.store import Store, is_current, key_of, write_dataset
from seatrial.campaign.watch import SILENT, Watch
from seatrial.campaign.weighing import SAFETY_DRAWS, plan_of, safety_lines, utility_unit, weigh
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import InputError
from seatrial.core.gaussian import Gaussian
from seatrial.design.prior_belief import draw_values
from seatrial.design.sweep import Sweep, sweep_family
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.model import VehicleModel

STATE_SD = 0.05
"""Standard deviation of the vehicle's own state about trim at the start of a designed trial, in its unit (m/s)."""
SWEPT = {
    "gain": "entropy reduction of the coefficients",
    "worth": "what makes a design the best",
    "peak_speed": "largest speed of the expected motion",
    "final_sd": "predicted sd after the trial",
}
"""What is kept of every design."""


def design_key(campaign: Campaign) -> str:
    """Key of the first design."""
    source = campaign.source
    return key_of(
        "design",
        *(part.model_dump() for part in (source.vehicle, source.structure, source.design)),
        None if source.power is None else source.power.model_dump(),
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


@dataclass(frozen=True, eq=False)
class Designs:
    """What was swept: one sweep for each family that has a design inside the limits.

    Attributes:
        sweeps: that of the best design first.
        refused: families without a design inside the limits, and why.
        basis: what the designs were swept from, in words.
        names: coefficients.
        sd_before: their standard deviations before the trial, SI.
        unit: of what makes a design the best, where that is not the entropy reduction itself.
        safety: how surely the best design keeps each limit of the motion.
    """

    sweeps: tuple[Sweep, ...]
    refused: dict[str, str]
    basis: str
    names: tuple[str, ...]
    sd_before: np.ndarray
    unit: str = "nat"
    safety: tuple[str, ...] = ()

    @property
    def best(self) -> Sweep:
        """Sweep of the family that holds the best design."""
        return self.sweeps[0]

    def lines(self) -> list[str]:
        """The best of each family, and the families that have none."""
        found = [f"{_words(sweep)}: {sweep.gain[sweep.best]:.2f} nat{self._worth(sweep)}" for sweep in self.sweeps]
        return found + [f"{kind}: no design, {why}" for kind, why in self.refused.items()]

    def _worth(self, sweep: Sweep) -> str:
        worth, gain = sweep.worth[sweep.best], sweep.gain[sweep.best]
        return "" if worth == gain else f", worth {worth:.3g} {self.unit}".rstrip()


def design_first(campaign: Campaign, watch: Watch = SILENT) -> Designs:
    """Sweep the design grid under the priors of the full structure, or read the sweep if it is current."""
    check_designable(campaign)
    store, key = Store(campaign.folder), design_key(campaign)
    if is_current(store.design, key):
        return read_designs(campaign, store.design)
    model = campaign.model(campaign.full)
    priors = tuple(campaign.prior(term.text, model.unit_of(term)) for term in model.coefficients)
    belief = Gaussian(np.array([prior.mean for prior in priors]), np.diag([prior.sd for prior in priors]))
    draws = draw_values(priors, random_key(campaign, "draws of the design"), 2 * SAFETY_DRAWS)
    return _sweep(campaign, model, belief, draws, store.design, key, "the priors", watch)


def design_next(campaign: Campaign, structure: Any, draws: np.ndarray, key: str, watch: Watch) -> Designs:
    """Sweep the grid for the chosen structure from what the trials so far have taught.

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
        return read_designs(campaign, store.next_design)
    belief = Gaussian(draws.mean(0), np.linalg.cholesky(np.atleast_2d(np.cov(draws, rowvar=False))))
    basis = f"the posterior of {structure.label}"
    order = np.random.default_rng(campaign.source.campaign.seed).permutation(len(draws))[: 2 * SAFETY_DRAWS]
    model = campaign.model(structure)
    return _sweep(campaign, model, belief, draws[order], store.next_design, stamp, basis, watch)


def read_designs(campaign: Campaign, path: Path) -> Designs:
    """Read stored sweeps; the schedule of the best trial is written again where it is missing or not the same."""
    data, families = open_dataset(path), {family.kind: family for family in campaign.families}
    grid = np.asarray(data["amplitude"]), np.asarray(data["period"])
    sweeps = [
        Sweep(
            families[str(kind)],
            *grid,
            *(np.asarray(data[name].sel(family=kind)) for name in ("gain", "peak_speed", "final_sd", "worth")),
        )
        for kind in data["family"].values
    ]
    found = Designs(
        tuple(sorted(sweeps, key=lambda sweep: -sweep.worth[sweep.best])),
        json.loads(data.attrs["refused"]),
        data.attrs["basis"],
        tuple(str(name) for name in data["coefficient"].values),
        np.asarray(data["sd_before"]),
        utility_unit(campaign),
        tuple(json.loads(data.attrs["safety"])),
    )
    sample_time = campaign.family.sample_time
    write_schedule(Store(campaign.folder).schedule(path), found.best.best_manoeuvre(), sample_time)
    return found


def _sweep(
    campaign: Campaign,
    model: VehicleModel,
    belief: Gaussian,
    draws: np.ndarray,
    path: Path,
    key: str,
    basis: str,
    watch: Watch,
) -> Designs:
    """Run the filter in units of the current standard deviations, where every coefficient is of order one."""
    families, (amplitude, period) = campaign.families, campaign.grid()
    if model.controls != (campaign.family.control,):
        raise InputError(
            campaign.where("structure"),
            found="controls " + ", ".join(model.controls),
            expected=f"the one control that is designed, {campaign.family.control}",
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
    report = watch.progress(f"design: {len(families) * amplitude.size * period.size} trials")
    report(0, len(families))
    mask, sweeps, refused, plan = campaign.measured_mask(campaign.family.time()), [], {}, plan_of(campaign, model)
    for done, family in enumerate(families, 1):
        try:
            found = sweep_family(space, family, amplitude, period, campaign.limits(), measured=mask)
            sweeps.append(weigh(campaign, plan, found, draws))
        except InputError as error:
            if len(families) == 1:
                raise
            refused[family.kind] = f"{error.found}; expected {error.expected}"
        report(done, len(families))
    if not sweeps:
        raise InputError(
            campaign.where("design"),
            found="; ".join(f"{kind}: {why}" for kind, why in refused.items()),
            expected="one design at least that fits and is inside the limits",
            remedy="lower the amplitudes, choose other periods, or widen the limits if the vehicle allows it",
        )
    best = max(sweeps, key=lambda sweep: np.nanmax(sweep.worth))
    axes = {"gain": (), "worth": (), "peak_speed": (), "final_sd": ("coefficient",)}
    units = {"gain": "nat", "worth": utility_unit(campaign), "peak_speed": "m/s", "final_sd": "SI"}
    dataset = xr.Dataset(
        {
            name: (
                ("family", "amplitude", "period", *axes[name]),
                np.stack([getattr(sweep, name) for sweep in sweeps]) * (scales if name == "final_sd" else 1.0),
                {"units": units[name], "long_name": SWEPT[name]},
            )
            for name in SWEPT
        }
        | {"sd_before": (("coefficient",), scales, {"units": "SI", "long_name": "sd before the trial"})},
        coords={
            "family": [sweep.family.kind for sweep in sweeps],
            "amplitude": ("amplitude", amplitude, {"units": "SI"}),
            "period": ("period", period, {"units": "s"}),
            "coefficient": [term.text for term in model.coefficients],
        },
        attrs={
            "basis": basis,
            "control": campaign.family.control,
            "trim": campaign.family.trim,
            "refused": json.dumps(refused),
            "safety": json.dumps(list(safety_lines(campaign, plan, best, draws))),
        },
    )
    write_dataset(path, dataset, key)
    return read_designs(campaign, path)


def _words(sweep: Sweep) -> str:
    row, column = sweep.best
    return design_words(sweep.family, float(sweep.amplitude[row]), float(sweep.period[column]))
