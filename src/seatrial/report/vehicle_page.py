"""The page of a published vehicle, as Markdown, from the catalogue's own numbers and its own motion."""

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.vehicles.catalogue import PublishedVehicle
from seatrial.vehicles.control_signs import DEFAULT_SPEED, control_senses, sense_words
from seatrial.vehicles.hull import AXES, Hull

MOTIONS = {"X": "surge", "Y": "sway", "Z": "heave", "K": "roll", "M": "pitch", "N": "yaw", "T": "thrust"}


def vehicle_page(name: str, vehicle: PublishedVehicle) -> str:
    """Body, coefficients by axis with SI units, senses of the controls, actuators, sources and errata.

    Args:
        name: in the catalogue.
        vehicle: it.
    """
    hull, model = vehicle.hull, vehicle.build()
    parts = [
        f"# {hull.name}",
        f'`catalogue = "{name}"`; moves {", ".join(vehicle.moves)}; controls {", ".join(vehicle.controls)}.',
        "## Sources and errata",
        vehicle.notes,
        "## Body",
        _table(("", "value"), _body(hull)),
    ]
    if not vehicle.coefficients:
        parts.append("Its forces are no sum of named coefficients, so none of them can be estimated.")
    for axis in (*AXES, "T"):
        rows = [
            (f"`{text}`", f"{value:.6g}", model.unit_of(CoefficientName.parse(text)), kind)
            for kind, values in (("", vehicle.coefficients), ("fixed", hull.fixed))
            for text, value in values.items()
            if CoefficientName.parse(text).axis == axis
        ]
        if rows:
            parts += [f"## {MOTIONS[axis].capitalize()}", _table(("coefficient", "value", "unit", ""), rows)]
    if vehicle.thrusters:
        rows = [
            (str(number), _triple(thruster.place), _triple(thruster.direction))
            for number, thruster in enumerate(vehicle.thrusters, 1)
        ]
        parts += ["## Thrusters", _table(("", "place, m", "direction"), rows)]
    speed = 0.0 if vehicle.thrusters else hull.trim.get("u", DEFAULT_SPEED)
    where = f"{speed:.4g} m/s straight ahead" if speed else "rest"
    senses = control_senses(model, vehicle.coefficients, speed)
    rows = [(name, sense_words(sense)) for name, sense in senses.items()]
    intro = f"Signs are those of the source. The table shows the simulated effect of a positive change, from {where}:"
    parts += ["## Controls", intro, _table(("control", "a positive change"), rows)]
    if vehicle.actuators:
        parts += ["## Actuators", _table(("control", "lag, s", "limits", "rate"), _actuators(vehicle))]
    return "\n\n".join(parts) + "\n"


def _body(hull: Hull) -> list[tuple[str, str]]:
    inertia = ", ".join("unknown" if value is None else f"{value:.4g}" for value in hull.inertia)
    return [
        ("mass", "unknown" if hull.mass is None else f"{hull.mass:.5g} kg"),
        ("inertia I_xx, I_yy, I_zz about the origin", f"{inertia} kg m^2"),
        ("centre of gravity", f"{_triple(hull.centre_of_gravity)} m"),
        ("centre of buoyancy", f"{_triple(hull.centre_of_buoyancy)} m"),
        ("weight, buoyancy", f"{hull.weight:.5g} N, {hull.buoyancy:.5g} N"),
        ("thrust deduction, wake", f"{hull.thrust_deduction:g}, {hull.wake:g}"),
    ]


def _actuators(vehicle: PublishedVehicle) -> list[tuple[str, ...]]:
    rows = []
    for name, actuator in vehicle.actuators.items():
        factor, unit = shown_unit(name)
        low, high, rate = (value * factor for value in (actuator.lower, actuator.upper, actuator.rate))
        limits = f"{low:.4g} to {high:.4g} {unit}" if np.isfinite([low, high]).all() else "none"
        rows.append(
            (name, f"{actuator.time_constant:g}", limits, f"{rate:.4g} {unit}/s" if np.isfinite(rate) else "none")
        )
    return rows


def _triple(values: tuple) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _table(head: tuple[str, ...], rows: list) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
