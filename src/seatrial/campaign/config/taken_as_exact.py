"""Inertias and known forces that a campaign assumes exact; the coefficients of their axis scale with them.

The equation of an axis keeps its solutions if inertia, known forces and all coefficients are multiplied by one number. Data therefore
determine no coefficient better than the stated inertia and forces. The ± contains an error of the inertia, unless that is stated to be
exact, but no error of known forces.
"""

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import WholeVehicle
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import listed
from seatrial.vehicles.axis_equation import RATE_OF
from seatrial.vehicles.hull import AXES, Hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.thrusters import allocation, controls_of

# Velocities whose rates enter the equation of an axis by the place of the centre of gravity or by added mass; X has
# none that matters.
_COUPLED = {"Y": ("p", "r"), "Z": ("q",), "N": ("v", "p")}
_SHORT = 3  # Known forces that are named one by one, at most
_NOTHING = 1e-9  # Share of a thrust that rounding makes
_UNIT = {"X": "kg", "Y": "kg", "Z": "kg", "N": "kg m^2"}  # Of inertia about or along each axis


def taken_as_exact(campaign: Campaign) -> str:
    """Return the inertias and forces that are assumed exact, with which all coefficients of an axis scale; empty if there are none."""
    if campaign.hull.mass is None:
        return ""
    free = [CoefficientName.parse(name) for name in campaign.full.terms]
    model = campaign.model(campaign.full)
    scaling: dict[str, list[str]] = {}
    taken_up, guesses = [], []
    for axis in ("X", "Y", "Z", "N"):
        own = [one for one in free if one.axis in _axes(axis)]
        added = CoefficientName.parse(f"{axis}_{RATE_OF[axis]}dot")
        is_sought = any(one.text == added.text for one in own)
        if RATE_OF[axis] not in model.states or len(own) == is_sought or {*_COUPLED.get(axis, ())} & {*model.states}:
            continue
        body, forces = _body(campaign.hull, axis), _forces(campaign, model, axis)
        is_exact = campaign.estimation.inertia_error == "exact"
        inertia = [body] if body and is_exact else []
        if added.text in campaign.hull.fixed and is_exact:
            inertia.append(f"{added} = {campaign.hull.fixed[added.text]:.4g} {_UNIT[axis]}")
            guesses.append(added.text)
        facts = forces if is_sought and forces else [*inertia, *forces]
        if not facts:
            continue
        scaling.setdefault(listed(facts), []).extend(
            name for name in _axes(axis) if any(one.axis == name for one in own)
        )
        if is_sought and forces and body:
            taken_up.append(f"{body} ({added} contains its error)")
    if not scaling:
        return ""
    sentences = [
        f"{facts} (all coefficients of {listed(axes)} scale with {'them' if ' and ' in facts else 'it'})"
        for facts, axes in scaling.items()
    ]
    guessed = f"; if {' or '.join(guesses)} is a guess, move it to structure.always with a prior"
    more = (
        f". {campaign.example_vehicle}" if campaign.example_vehicle else guessed if guesses and campaign.imports else ""
    )
    return f"assumed exact, not in the ±: {'; '.join(sentences + taken_up)}{more}"


def _axes(axis: str) -> tuple[str, ...]:
    """Return the axes of the coefficients in one equation: thrust acts along X."""
    return ("X", "T") if axis == "X" else (axis,)


def _body(hull: Hull, axis: str) -> str:
    """Return the mass or moment of inertia of an axis; empty if it is unknown."""
    if axis != "N":
        return f"a mass of {hull.mass:.4g} kg"
    turning = hull.inertia[2]
    return "" if turning is None else f"a moment of inertia of {turning:.4g} kg m^2"


def _forces(campaign: Campaign, model: VehicleModel, axis: str) -> list[str]:
    """Return the known forces of controls along an axis: fixed coefficients, and thrusters with a fixed gain."""
    fixed = campaign.hull.fixed
    named = [CoefficientName.parse(name) for name in fixed]
    stated = [one for one in named if one.axis in _axes(axis) and {*one.signals} & {*model.controls}]
    forces = [f"{one} = {fixed[one.text]:.4g} {model.unit_of(one)}".removesuffix(" 1") for one in stated]
    if len(forces) > _SHORT:
        forces = [f"{len(forces)} fixed coefficients of controls"]
    vehicle, terms = campaign.vehicle, map(CoefficientName.parse, campaign.full.terms)
    if not isinstance(vehicle, WholeVehicle) or any(one.axis == "T" for one in (*named, *terms)):
        return forces  # a term of T describes the effect of the command of a thruster
    thrusters, sought = vehicle.body.thrusters, {*vehicle.unknowns}
    along = allocation(thrusters)[AXES.index(axis)]
    names = [name for name, share in zip(controls_of(thrusters, ()), along, strict=True) if abs(share) > _NOTHING]
    exact = [name for name in names if not {"gain_f", f"gain_{name}"} & sought]
    law = " law" * bool(vehicle.laws)
    return [*forces, f"the thrust{law} of {listed(exact)}"] if exact else forces
