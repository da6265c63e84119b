"""Judges the thrusters of a campaign: what they span, whether they mirror each other, and whether each pushes the way that is said.

The last is a gain of each thruster by least squares on the measured motion: near 1 if all is as stated, near -1 if a command, a
propeller or a direction is turned round.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import CampaignVehicle, WholeVehicle
from seatrial.campaign.inference.posterior import initial_state
from seatrial.core.coefficients import CoefficientName
from seatrial.core.findings import Finding
from seatrial.core.record import Record
from seatrial.core.signals import GAUGE_CHANNELS, RATES, thruster_controls
from seatrial.estimation.diagnostics.feedback_check import not_judged_in_loop
from seatrial.estimation.diagnostics.record_checks import MAX_GAIN_SD, MIN_GAIN_ERROR, not_judged_yet
from seatrial.estimation.diagnostics.symmetry import mirror_of
from seatrial.estimation.posterior.first_guess import fit_motion
from seatrial.estimation.priors import Normal, Prior
from seatrial.selection.structures import Structure
from seatrial.vehicles.hull import AXES
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.thrusters import allocation, controls_of

ZERO_SHARE = 1e-9  # Share of the largest entry below which a force or moment is none


def thruster_lines(vehicle: CampaignVehicle, channels: tuple[str, ...]) -> list[str]:
    """Return the allocation matrix, its rank on the axes that move, and what has no mirror image; nothing without thrusters."""
    if not isinstance(vehicle, WholeVehicle) or not vehicle.body.thrusters:
        return []
    thrusters, moving = vehicle.body.thrusters, _axes(channels, vehicle)
    matrix = allocation(thrusters)
    rank = int(np.linalg.matrix_rank(matrix[moving], tol=1e-6 * float(np.abs(matrix).max())))
    head = "".join(f"{number:>9}" for number in range(1, len(thrusters) + 1))
    rows = ["".join(f"{x:9.3f}" for x in np.where(np.abs(row) < ZERO_SHARE, 0.0, row)) for row in matrix]
    names = " ".join(AXES[i] for i in moving)
    lines = [
        f"allocation of {len(thrusters)} thrusters: force (N) and moment (N m) for 1 N of each thruster",
        f"   {head}",
    ]
    lines += [f"  {axis}{row}" for axis, row in zip(AXES, rows, strict=True)]
    what = "move" if vehicle.moves else "are measured"
    rank_line = f"  rank {rank} on the {len(moving)} axes that {what}, {names}"
    lines.append(f"{rank_line}: {_not_spanned(matrix, moving)}" if rank < len(moving) else rank_line)
    alone = [str(number) for number, one in enumerate(thrusters, 1) if mirror_of(one, thrusters) is None]
    mirror_words = f"no mirror image of {', '.join(alone)} on the other side" if alone else "each has its mirror image"
    return [*lines, f"  port and starboard: {mirror_words}"]


def _axes(channels: tuple[str, ...], vehicle: WholeVehicle) -> list[int]:
    """Return the axes that move, or along which a gauge holds the vehicle."""
    if vehicle.moves:
        return [RATES.index(rate) for rate in vehicle.moves]
    return [i for i, force in enumerate(GAUGE_CHANNELS) if force in channels]


def _not_spanned(matrix: np.ndarray, moving: Sequence[int]) -> str:
    """Return which combinations of forces no thrusts make."""
    left, sizes, _ = np.linalg.svd(matrix[moving])
    sizes = np.concatenate([sizes, np.zeros(len(moving) - sizes.size)])
    texts = []
    for vector in left.T[sizes < 1e-6 * max(float(sizes[0]), ZERO_SHARE)]:
        parts = [f"{x:+.2g} {AXES[i]}" for i, x in zip(moving, vector, strict=True) if abs(x) > 1e-3]
        texts.append(" ".join(parts).removeprefix("+"))
    return "no thrusts make " + ", nor ".join(texts)


def mirrored_thrusters(vehicle: CampaignVehicle, full: Structure) -> dict[str, tuple[str, ...]]:
    """Return the thrusters that drive a rate, by its name, where some drive it forwards and some backwards, as port and starboard do r."""
    if not isinstance(vehicle, WholeVehicle) or not vehicle.body.thrusters:
        return {}
    matrix, controls = allocation(vehicle.body.thrusters), all_thrusters(full, vehicle)
    drives = {rate: np.where(np.abs(row) < ZERO_SHARE, 0.0, row) for rate, row in zip(RATES, matrix, strict=True)}
    return {
        rate: tuple(name for name, push in zip(controls, row, strict=True) if push)
        for rate, row in drives.items()
        if row.min() < 0 < row.max()
    }


def all_thrusters(full: Structure, vehicle: WholeVehicle) -> tuple[str, ...]:
    """Return the controls of all thrusters, of which the model has those that push along or about an axis that moves."""
    terms = (*full.terms, *vehicle.hull.fixed)
    return controls_of(vehicle.body.thrusters, map(CoefficientName.parse, terms))


def check_thrusters(
    campaign: Campaign,
    record: Record,
    wrong: Sequence[Finding] = (),
    feedback: Mapping[str, Sequence[str]] | None = None,
) -> list[Finding]:
    """Judge the thrusters by one record; nothing if there are none, or where no velocity is measured.

    Args:
        campaign: whose vehicle has them.
        record: whose sensors look along the body.
        wrong: what is to be corrected first: gains of such a record would accuse the thrusters instead.
        feedback: controls that are computed from measured channels, and these channels: their gains are biased.
    """
    vehicle = campaign.vehicle
    if not isinstance(vehicle, WholeVehicle) or not vehicle.body.thrusters:
        return []
    matrix, hull = allocation(vehicle.body.thrusters), vehicle.hull
    can_right = np.array([hull.weight != hull.buoyancy] * 3 + [any(hull.righting)] * 3)
    idle = [i for i in _axes(campaign.channels, vehicle) if np.abs(matrix[i]).max() < ZERO_SHARE]
    findings = [
        Finding("axis-not-driven", "note" if can_right[i] else "caution", (AXES[i],), {}, ("drop-axis",)) for i in idle
    ]
    if wrong:
        names = [name for name in thruster_controls(len(vehicle.body.thrusters), True) if name in record.controls]
        return [*findings, not_judged_yet(names, "thruster-gain", wrong)]
    return [*findings, *not_judged_in_loop(_gains(campaign, vehicle, record), feedback or {})]


def model_with_gains(
    campaign: Campaign, vehicle: WholeVehicle, record: Record
) -> tuple[VehicleModel, dict[str, Prior]]:
    """Return the model of all terms in which each thruster has a gain, and the priors with which it is fitted to a record.

    A gain is near 1; of a thruster that never moves in the record none is sought.
    """
    controls = [name for name in thruster_controls(len(vehicle.body.thrusters), True) if name in record.controls]
    names = [f"gain_{name}" for name in controls]
    unknowns = (*vehicle.unknowns, *(name for name in names if name not in vehicle.unknowns))
    model = replace(vehicle, unknowns=unknowns).model(campaign.full)
    priors: dict[str, Prior] = {term.text: campaign.prior(term.text) for term in model.coefficients}
    priors |= {one.name: campaign.prior(one.name) for one in model.unknowns if one.name not in names}
    moved = [name for name, control in zip(names, controls, strict=True) if np.ptp(record.channel(control)) > 0]
    return model, priors | {name: Normal(1.0, 1.0) for name in moved}


def _gains(campaign: Campaign, vehicle: WholeVehicle, record: Record) -> list[Finding]:
    model, priors = model_with_gains(campaign, vehicle, record)
    fitted = fit_motion(model, [record], [initial_state(campaign, model, record)], priors)
    gains = {name.removeprefix("gain_"): one for name, one in fitted.items() if name.startswith("gain_f_")}
    return [_judged(name, *one) for name, one in gains.items() if name in record.controls]


def _judged(control: str, gain: float, sd: float) -> Finding:
    values = {"gain": float(gain), "sd": float(sd)}
    if sd > MAX_GAIN_SD:
        return Finding("thruster-gain-unknown", "note", (control,), values, ("move-apart",))
    if gain + 2.0 * sd < 0:
        return Finding("thruster-reversed", "alarm", (control,), values, ("turn-thruster",))
    if abs(gain - 1.0) > MIN_GAIN_ERROR + 2.0 * sd:
        return Finding("thruster-gain", "caution", (control,), values, ("check-thrust-law",))
    return Finding("thruster-gain", "pass", (control,), values)
