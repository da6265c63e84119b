"""Inertia, added mass and drag of a vehicle from its outer shape: a closed hull of elliptical sections, or an open frame in a box.

    added mass of a hull   strips, rho pi h^2 across the height h, times Lamb's ellipsoid over the strips of that ellipsoid
    added mass of a frame  square prisms and plates, times the share of the box that solid parts fill
    drag                   rho/2 C_D times area: friction and form along a hull, cross-flow across it, a bluff block for a frame

Fins, thrusters and lift are not modelled. The factors of error are those of published values of vehicles (docs/dev/shapes.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import elliprd

from seatrial.core.argument_checks import check_choice, check_number, check_path
from seatrial.core.errors import InputError, needing_extra
from seatrial.core.signals import RATES
from seatrial.vehicles.hull import AXES
from seatrial.vehicles.model import ROTATIONS

FORMS = ("torpedo", "ellipsoid", "box")
SEAWATER = 1025.0  # kg/m^3
LEAST_DENSITY, MOST_DENSITY = 200.0, 3000.0  # Mass over the enclosed volume that a vehicle may have, kg/m^3
LEAST_LENGTH, MOST_LENGTH = 1e-3, 1e3  # Of a part of a vehicle, m
# Length over the root of beam times height of the vehicles from which the factors of error follow
COMPARED = {"hull": (4.3, 8.6), "box": (1.2, 1.7)}
STATIONS = 801  # Along a hull; closest at its ends, where it is steep
CUTS = 101  # Sections of a mesh

# Added mass of a square prism along its axis over rho a^3, by its length over its side a: DNV-RP-N103 (2017), table A-2, which
# gives it over rho times the volume. At length 0 it is that of a square plate, 0.579 pi/4.
_PRISM = ((0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), (0.455, 0.68, 0.72, 0.72, 0.76, 0.75, 0.78, 0.77))
# Added mass of a rectangular plate over that of a square one of the same area, by the ratio of its sides; the same table.
_PLATE = ((1.0, 1.5, 2.0, 3.0, 5.0, 10.0), (1.0, 0.973, 0.925, 0.828, 0.693, 0.517))
FRICTION = 0.004  # Of a turbulent boundary layer at a Reynolds number of two million, ITTC-1957
APPENDAGES = 2.0  # Drag with fins, openings and sensors over that of the bare hull: 0.27 and 0.1 of a towed REMUS 100 (Prestero, 2001)
CROSS_FLOW = 1.1  # Drag coefficient of a cylinder across the flow: Hoerner, Fluid-Dynamic Drag (1965), chapter 3
BLOCK = 1.05  # Of a cube, face on: the same
# Linear drag over quadratic drag, of the published tables, middle: m/s, and m/s at the ends of the length. No theory gives them.
LINEAR_SPEED, LINEAR_TIP_SPEED = 0.1, 1.0


class Quality(NamedTuple):
    """How well a kind of number follows from the shape.

    Attributes:
        factor: 68 % of published values lie within it of the estimate, 95 % within its square.
        source: of the formula.
    """

    factor: float
    source: str


QUALITIES = {
    "hull inertia": Quality(1.65, "uniform density"),
    "box inertia": Quality(1.65, "uniform density"),
    "hull added mass": Quality(1.6, "strips, Lamb's ellipsoid"),
    "hull added inertia": Quality(2.5, "strips, Lamb's ellipsoid"),
    "box added mass": Quality(1.8, "DNV-RP-N103, share of solid parts"),
    "box added inertia": Quality(3.5, "added mass of strips"),
    "hull surge drag": Quality(1.6, "Hoerner, bare hull, doubled"),
    "hull cross-flow drag": Quality(2.9, "cross-flow, C_D 1.1"),
    "hull turning drag": Quality(4.0, "cross-flow on strips, C_D 1.1"),
    "box drag": Quality(2.4, "Hoerner, block, C_D 1.05"),
    "box turning drag": Quality(4.8, "block on strips, C_D 1.05"),
    "linear drag": Quality(8.0, f"that of quadratic drag at {LINEAR_SPEED} m/s"),
    "linear turning drag": Quality(5.6, f"that of quadratic drag at {LINEAR_TIP_SPEED} m/s of the ends"),
}
"""By kind of number; docs/dev/shapes.md compares them with published vehicles."""


class ShapeTerm(NamedTuple):
    """A coefficient from the shape: its name, its value in SI, below 0, and its kind in `QUALITIES`."""

    name: str
    value: float
    kind: str


@dataclass(frozen=True)
class Shape:
    """The outer shape of a vehicle; build it with `vehicle_shape`, which checks it. Body axes at the centre of volume.

    Attributes:
        body: whether it is a closed hull or an open frame in a box.
        size: length, beam and height, m.
        mass: kg.
        volume: of the hull, or of the box about a frame, m^3.
        inertia: I_xx, I_yy, I_zz of a body of uniform density, kg m^2.
        sections: station along x, half the beam and half the height there, m; none of a box.
    """

    body: Literal["hull", "box"]
    size: tuple[float, float, float]
    mass: float
    volume: float
    inertia: tuple[float, float, float]
    sections: Float[np.ndarray, "3 n"]

    @property
    def slenderness(self) -> float:
        """Length over the root of beam times height."""
        length, beam, height = self.size
        return length / sqrt(beam * height)


def vehicle_shape(form: str, mass: float, lengths: Mapping[str, float], mesh: Path | str | None = None) -> Shape:
    """Build the shape of a vehicle; arguments and errors as `priors_from_shape`.

    Args:
        form: of `FORMS`.
        mass: kg.
        lengths: m, by name: `length`, `diameter` or `beam` and `height`, `nose` and `tail`.
        mesh: STL file instead of the lengths.
    """
    place = f"shape, {check_choice(form, FORMS, 'shape, form')}"
    check_number(mass, f"{place}, mass", above=0.0, remedy="give the mass in kg")
    ends = {"least": LEAST_LENGTH, "most": MOST_LENGTH, "remedy": "give the length in m"}
    given = {name: check_number(one, f"{place}, {name}", **ends) for name, one in lengths.items()}
    remedy = "check the lengths and the mass, and their units"
    if mesh is not None:
        shape = _of_mesh(form, mass, given, check_path(mesh, f"{place}, mesh"), place)
        remedy = "check the mass, and that the mesh is in m"
    else:
        size = _size(given, form, place)
        shape = _box(size, mass) if form == "box" else _hull(mass, _sections(form, size, given, place), size)
    if not LEAST_DENSITY <= (density := mass / shape.volume) <= MOST_DENSITY:
        about = " x ".join(f"{one:.3g}" for one in shape.size)
        raise InputError(
            f"{place}, mass",
            found=f"{mass:g} kg in {shape.volume:.3g} m^3, {about} m: {density:.4g} kg/m^3",
            expected=f"a density of {LEAST_DENSITY:g} to {MOST_DENSITY:g} kg/m^3, which vehicles have",
            remedy=remedy,
        )
    return shape


def shape_terms(shape: Shape, density: float = SEAWATER) -> tuple[ShapeTerm, ...]:
    """Return added mass, linear and quadratic drag of a shape; of roll only those of a box and of a hull that is not round.

    Args:
        shape: of the vehicle.
        density: of the water, kg/m^3.
    """
    check_number(density, "shape, density of water", above=0.0)
    is_box = shape.body == "box"
    added, drag = (_box_added, _box_drag) if is_box else (_hull_added, _hull_drag)
    masses, areas, terms = added(shape, density), drag(shape, density), []
    for axis, rate in zip(AXES, RATES, strict=True):
        turns = axis in ROTATIONS
        if masses[axis] > 0:
            kind = f"{shape.body} added {'inertia' if turns else 'mass'}"
            terms.append(ShapeTerm(f"{axis}_{rate}dot", -masses[axis], kind))
        if axis in areas:
            way = "turning " if turns else "" if is_box else "surge " if axis == "X" else "cross-flow "
            speed = LINEAR_TIP_SPEED / shape.size[0] if turns else LINEAR_SPEED
            terms.append(ShapeTerm(f"{axis}_{rate}", -speed * areas[axis], f"linear {'turning ' * turns}drag"))
            terms.append(ShapeTerm(f"{axis}_{rate}abs{rate}", -areas[axis], f"{shape.body} {way}drag"))
    return tuple(terms)


def ellipsoid_added_mass(length: float, beam: float, height: float) -> dict[str, float]:
    """Return added mass and inertia of an ellipsoid over the density of the water, by axis, m^3 and m^5.

    With the half axes a, b, c and Delta^2 = (a^2 + t)(b^2 + t)(c^2 + t), alpha = a b c times the integral of dt/((a^2 + t) Delta) from 0
    to infinity, which is Carlson's R_D. Lamb, Hydrodynamics (6th ed., 1932), sections 114 and 115.
    """
    half = np.array([length, beam, height]) / 2
    volume = 4 / 3 * pi * half.prod()
    squares = half**2
    alpha = [2 / 3 * half.prod() * elliprd(*np.delete(squares, axis), squares[axis]) for axis in range(3)]
    added = {AXES[axis]: float(volume * alpha[axis] / (2 - alpha[axis])) for axis in range(3)}
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        difference, total = squares[one] - squares[other], squares[one] + squares[other]
        turned = alpha[other] - alpha[one]
        # A body of revolution sets no water in motion when it turns about its own axis.
        round_ = abs(difference) < 1e-9 * total
        share = 0.0 if round_ else difference**2 * turned / (2 * difference - total * turned)
        added[AXES[axis + 3]] = float(volume / 5 * share)
    return added


def _strips(sections: Float[np.ndarray, "3 n"]) -> dict[str, float]:
    """Return added mass and inertia of elliptical strips over the density, by axis but surge. Newman, Marine Hydrodynamics (1977), 4.3."""
    x, b, h = sections
    ways = {"Y": h**2, "Z": b**2, "K": (b**2 - h**2) ** 2 / 8, "M": (b * x) ** 2, "N": (h * x) ** 2}
    return {axis: pi * float(np.trapezoid(values, x)) for axis, values in ways.items()}


def _hull_added(shape: Shape, density: float) -> dict[str, float]:
    """Return strips with the loss at the ends that an ellipsoid of the same size has, by axis."""
    round_, strips = ellipsoid_added_mass(*shape.size), _strips(shape.sections)
    about = _strips(_sections("ellipsoid", shape.size, {}, ""))
    added = {axis: density * one * (round_[axis] / about[axis] if about[axis] else 0.0) for axis, one in strips.items()}
    return {"X": density * shape.volume * round_["X"] / (pi / 6 * float(np.prod(shape.size)))} | added


def _hull_drag(shape: Shape, density: float) -> dict[str, float]:
    """Return quadratic drag of a bare hull along its axis, doubled, and of its sections across the flow, by axis.

    C_D over the wetted area is C_f (1 + 1.5 (d/l)^1.5 + 7 (d/l)^3): Hoerner, Fluid-Dynamic Drag (1965), chapter 6.
    """
    x, b, h = shape.sections
    width = 1 / shape.slenderness
    girth = pi * (3 * (b + h) - np.sqrt((3 * b + h) * (b + 3 * h)))  # Ramanujan's, of an ellipse
    wetted = float(np.trapezoid(girth, x))
    along = APPENDAGES * FRICTION * (1 + 1.5 * width**1.5 + 7 * width**3) * wetted
    across = {"Y": 2 * h, "Z": 2 * b, "M": 2 * b * np.abs(x) ** 3, "N": 2 * h * np.abs(x) ** 3}
    areas = {"X": along} | {axis: CROSS_FLOW * float(np.trapezoid(one, x)) for axis, one in across.items()}
    return {axis: density / 2 * area for axis, area in areas.items()}


def _box_added(shape: Shape, density: float) -> dict[str, float]:
    """Return the added mass of a block times the share of it that is solid, and the moments of that mass as strips, by axis."""
    added = {}
    for axis in range(3):
        depth, (one, other) = shape.size[axis], np.delete(shape.size, axis)
        side, aspect = sqrt(one * other), max(one / other, other / one)
        prism = float(np.interp(depth / side, *_PRISM) * np.interp(aspect, *_PLATE)) * side**3
        added[AXES[axis]] = density * prism * min(1.0, shape.mass / (density * shape.volume))
    (length, beam, height), (along, aside, down) = shape.size, (added[axis] for axis in "XYZ")
    turning = {
        "K": (beam**2 * down + height**2 * aside) / 12,
        "M": (length**2 * down + height**2 * along) / 12,
        "N": (length**2 * aside + beam**2 * along) / 12,
    }
    return added | turning


def _box_drag(shape: Shape, density: float) -> dict[str, float]:
    """Return the quadratic drag of a block, by axis."""
    faces = {AXES[axis]: density / 2 * BLOCK * float(np.delete(shape.size, axis).prod()) for axis in range(3)}
    length, beam, height = shape.size
    # The integral of |s|^3 over an edge is s^4/32: a force rho/2 C_D r^2 s|s| on each strip.
    turning = {
        "K": (beam**3 * faces["Z"] + height**3 * faces["Y"]) / 32,
        "M": (length**3 * faces["Z"] + height**3 * faces["X"]) / 32,
        "N": (length**3 * faces["Y"] + beam**3 * faces["X"]) / 32,
    }
    return faces | turning


def _size(given: Mapping[str, float], form: str, place: str) -> tuple[float, float, float]:
    """Return length, beam and height."""
    size = {name: given.get(name, given.get("diameter")) for name in ("length", "beam", "height")}
    size["length"] = given.get("length")
    unused = [name for name in ("nose", "tail") if name in given and form != "torpedo"]
    unused += ["diameter"] if {"diameter", "beam", "height"} <= {*given} else []
    length, beam, height = size.values()
    if length is not None and beam is not None and height is not None and not unused:
        return length, beam, height
    expected = "length, and a diameter or beam and height" + ("; nose and tail if known" * (form == "torpedo"))
    remedy = f"remove {unused[0]}" if unused else f"add {' and '.join(one for one in size if size[one] is None)}, in m"
    raise InputError(place, found=", ".join(given) or "no length", expected=expected, remedy=remedy)


def _sections(
    form: str, size: tuple[float, float, float], given: Mapping[str, float], place: str
) -> Float[np.ndarray, "3 n"]:
    """Return the sections of a hull from its tail to its nose."""
    length, beam, height = size
    turn = np.linspace(0.0, pi, STATIONS)
    x, wide = -length / 2 * np.cos(turn), np.sin(turn)
    if form == "torpedo":
        nose, tail = given.get("nose", beam), given.get("tail", 2 * beam)
        if nose + tail > length:
            found = f"{length:g} m, with a nose of {nose:g} m and a tail of {tail:g} m"
            remedy = "give `nose` and `tail`"
            raise InputError(f"{place}, length", found=found, expected="no less than both", remedy=remedy)
        before, after = np.minimum((length / 2 - x) / nose, 1.0), np.minimum((length / 2 + x) / tail, 1.0)
        wide = np.sqrt(before * (2 - before)) * after * (2 - after)
    return np.array([x, beam / 2 * wide, height / 2 * wide])


def _hull(mass: float, sections: Float[np.ndarray, "3 n"], size: tuple[float, float, float]) -> Shape:
    """Return a hull of uniform density about its centre of volume."""
    x, b, h = sections
    volume = float(np.trapezoid(pi * b * h, x))
    x = x - float(np.trapezoid(pi * b * h * x, x)) / volume
    squares = {"x": x**2, "y": b**2 / 4, "z": h**2 / 4}  # means over each section
    mean = {axis: float(np.trapezoid(pi * b * h * one, x)) / volume for axis, one in squares.items()}
    inertia = (mass * (mean["y"] + mean["z"]), mass * (mean["x"] + mean["z"]), mass * (mean["x"] + mean["y"]))
    return Shape("hull", size, mass, volume, inertia, np.array([x, b, h]))


def _box(size: tuple[float, float, float], mass: float) -> Shape:
    length, beam, height = size
    xx, yy, zz = (mass / 12 * total for total in (beam**2 + height**2, length**2 + height**2, length**2 + beam**2))
    return Shape("box", size, mass, length * beam * height, (xx, yy, zz), np.empty((3, 0)))


def _of_mesh(form: str, mass: float, given: Mapping[str, float], path: Path, place: str) -> Shape:
    """Return the shape of a closed mesh; its sections are taken as ellipses of their beam and height."""
    place = f"{place}, {path}"
    if given or form == "torpedo":
        remedy = "leave the lengths out, and give the form ellipsoid for a closed hull or box for an open frame"
        raise InputError(place, found=", ".join(given) or form, expected="a mesh alone", remedy=remedy)
    with needing_extra("mesh", place, "a mesh that {} reads, which is not installed"):
        import trimesh
    expected, remedy = (
        "an STL file of a closed surface, in m",
        "correct the path, or repair the mesh and save it as STL",
    )
    try:
        with path.open("rb") as file:
            mesh = trimesh.load_mesh(file, file_type="stl")
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise InputError(place, found=str(error), expected=expected, remedy=remedy) from error
    if not len(mesh.faces) or not mesh.is_volume:
        found = "holes, or faces that point inwards" if len(mesh.faces) else "no triangles"
        raise InputError(place, found=found, expected=expected, remedy=remedy)
    low, high = mesh.bounds
    length, beam, height = (float(one) for one in high - low)
    if form == "box":
        return _box((length, beam, height), mass)
    xx, yy, zz = (float(one) * mass / mesh.mass for one in np.diag(mesh.moment_inertia))
    stations, half = np.linspace(low[0], high[0], CUTS), np.zeros((2, CUTS))
    for cut in range(1, CUTS - 1):
        lines = trimesh.intersections.mesh_plane(mesh, [1.0, 0.0, 0.0], [stations[cut], 0.0, 0.0])
        ends = np.asarray(lines).reshape(-1, 3)
        half[:, cut] = np.ptp(ends[:, 1:], axis=0) / 2 if len(ends) else 0.0
    sections = np.array([stations - mesh.center_mass[0], *half])
    return Shape("hull", (length, beam, height), mass, float(mesh.volume), (xx, yy, zz), sections)
