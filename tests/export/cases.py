"""Vehicles and random states that the tests of the exporters share, and our own forces at them."""

import zipfile
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from seatrial.core.signals import ANGLES, POSITIONS, RATES
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.vehicle import (
    CoefficientEstimates,
    EstimatedNumber,
    ExportedVehicle,
    ExportProvenance,
    of_published,
)
from seatrial.export.write import EXPORTERS
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.tether import Tether
from seatrial.vehicles.whole import whole_vehicle

# Every target; that of a library which is not installed is skipped.
TARGETS = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            name == "fmu" and find_spec("pythonfmu") is None, reason="pythonfmu is not installed: the extra `export`"
        ),
    )
    for name in EXPORTERS
]
SIGN = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
COUNT = 1000
HOSTILE = 'REMUS --> <b> & "100" """ \\ {n}'
FLIPPED = {"Y_uudelta_r": -9.64, "N_uudelta_r": 6.15, "Z_uudelta_s": 9.64, "M_uudelta_s": 6.15}
"""Fins of the other sign than those of the published REMUS."""
PROVENANCE = ExportProvenance(
    "abc123", HOSTILE, "M-2 (X_uabsu T_nabsn)", "0.1.0", ("X_u",), ("lag of n",), ("body: x",)
)


def published(name="remus100_hall_anstee", **changes) -> ExportedVehicle:
    """A vehicle of the catalogue, two of its coefficients as if estimated."""
    vehicle = of_published(name, load_vehicle(name))
    names = tuple(n for n in ("X_uabsu", "T_nabsn") if n in vehicle.coefficients)
    mean = np.array([vehicle.coefficients[n] for n in names])
    sd = 0.05 * np.abs(mean)
    root = np.diag(sd) @ np.array([[1.0, 0.0], [-0.6, 0.8]])[: len(names), : len(names)]
    covariance = root @ root.T
    estimated = CoefficientEstimates(names, mean, np.sqrt(np.diag(covariance)), covariance)
    return replace(vehicle, estimated=estimated, **changes)


def with_terms(vehicle: ExportedVehicle, **terms: float) -> ExportedVehicle:
    """The vehicle with some coefficients set."""
    return replace(vehicle, coefficients={**vehicle.coefficients, **terms})


def rich() -> ExportedVehicle:
    """A vehicle with linear damping, coupled inertia, off-axis centres, lags and limits beside all that is published."""
    vehicle = published()
    hull = replace(
        vehicle.hull,
        inertia=(0.3, 3.6, 3.7),
        products=(0.02, -0.03, 0.01),
        centre_of_gravity=(0.01, 0.004, 0.0196),
        centre_of_buoyancy=(0.003, -0.002, -0.01),
        weight=298.0,
    )
    actuators = {
        "n": Actuator(0.5, 0.0, 157.0, 60.0),
        "delta_r": Actuator(0.1, -0.2, 0.25, 1.0),
        "delta_s": Actuator(0.0, -0.2, 0.2),
    }
    linear = {"X_u": -1.2, "Y_v": -3.0, "Y_r": 0.4, "Z_w": -2.0, "K_p": -0.05, "M_q": -0.7, "N_r": -0.6, "N_v": 0.3}
    return replace(with_terms(vehicle, **linear), hull=hull, actuators=actuators)


def commanded():
    """An open frame whose thrust has terms in the commanded force, the inflow and the voltage."""
    frame = published("bluerov2_heavy")
    frame = replace(frame, hull=replace(frame.hull, trim={**frame.hull.trim, "V": 16.0}))
    return with_terms(frame, T_f=0.85, T_absf=-0.06, T_uabsf=-0.1, T_fdV=0.05)


def towing(name="bluerov2_heavy") -> ExportedVehicle:
    """A published vehicle with a tether."""
    vehicle = published(name)
    return replace(vehicle, hull=replace(vehicle.hull, tether=Tether((-0.3, 0.0, -0.1), 5.0, 30.0)))


def states(vehicle: ExportedVehicle, seed=0, count=COUNT):
    """Velocities (6, n), roll, pitch and controls, all random."""
    rng = np.random.default_rng(seed)
    scale = np.array([1.5, 0.4, 0.4, 0.5, 0.4, 0.4])
    nu = rng.normal(size=(6, count)) * scale[:, None]
    phi, theta = rng.uniform(-0.8, 0.8, (2, count))
    controls = {}
    for name in vehicle.model().controls:
        span = 150.0 if name.startswith("n") else 0.2 if name.startswith("delta") else 20.0
        controls[name] = rng.uniform(-span, span, count)
    return nu, phi, theta, controls


def own_force(vehicle: ExportedVehicle, nu, phi, theta, controls):
    """(M_RB + M_A) nudot of the package's own model, shape (6, n)."""
    model = vehicle.model()
    known = {**dict(zip(RATES, nu, strict=True)), "phi": phi, "theta": theta}
    values = tuple(controls[name] for name in model.controls)
    params = {**vehicle.forces, **vehicle.thrust_law}
    rates = model.derivative(params, tuple(known[name] for name in model.states), values)
    found = dict(zip(model.states, rates, strict=True))
    return (vehicle.rigid_mass + vehicle.added_mass) @ np.array([np.broadcast_to(found[r], nu[0].shape) for r in RATES])


def written(exporter: Exporter, vehicle: ExportedVehicle) -> Mapping[str, str | bytes]:
    """Files without the manoeuvre, which takes a second."""
    statement = Statement(exporter.target, PROVENANCE, Carried(exporter.carries(vehicle).motion), (), "", (HOSTILE,))
    return exporter.write(vehicle, statement)


def with_law() -> ExportedVehicle:
    """An open frame with lags, limits, and all that may be estimated beside its coefficients."""
    frame = published("bluerov2_heavy")
    late = {name: Actuator(0.2, -40.0, 40.0, 300.0 if name == "f_2" else np.inf) for name in frame.controls}
    numbers = {"gain_f": 0.9, "gain_f_3": 0.7, "reverse_f": 0.8, "dead_f": 2.0, "lag_f": 0.35}
    numbers |= {"net_weight": -1.5, "x_b": 0.01, "z_b": -0.02}
    units = {"dead_f": "N", "lag_f": "s", "net_weight": "N", "x_b": "m", "z_b": "m"}
    estimated = {name: EstimatedNumber(x, 0.1 * abs(x), units.get(name, "1")) for name, x in numbers.items()}
    return replace(frame, actuators=late).with_numbers(estimated)


def whole_model(vehicle: ExportedVehicle):
    """The package's own model of a vehicle with its pose by Euler angles and its actuators, and the values of its parameters."""
    forces, law = vehicle.forces, vehicle.thrust_law
    added = {name: value for name, value in vehicle.coefficients.items() if name not in forces}
    model = whole_vehicle(
        replace(vehicle.hull, fixed=added, tether=None),
        tuple(forces),
        moves=vehicle.moves,
        attitude="euler",
        positions=POSITIONS,
        angles=ANGLES,
        added_coriolis=vehicle.added_coriolis,
        thrusters=vehicle.thrusters,
        actuators=vehicle.actuators,
        unknowns=tuple(law),
    )
    return model, {**forces, **law}


def whole_states(vehicle: ExportedVehicle, count: int, seed=0):
    """Random states and controls by name, each of shape (count,); velocities and angles that the model lacks are 0."""
    rng, (model, _) = np.random.default_rng(seed), whole_model(vehicle)
    spans = {"n": 150.0, "d": 0.3, "f": 45.0, "V": 16.0} | dict.fromkeys("uvw", 1.0) | dict.fromkeys("pqr", 0.5)
    spans |= {"x": 100.0, "y": 100.0, "z": 100.0, "phi": 1.2, "theta": 1.2, "psi": 3.0}
    state, control = (
        {name: rng.uniform(-1, 1, count) * spans.get(name, spans.get(name[0])) for name in names}
        for names in (model.states, model.controls)
    )
    zero = np.zeros(count)
    return {**dict.fromkeys((*RATES, *POSITIONS, *ANGLES), zero), **state}, control


def own_rates(vehicle: ExportedVehicle, state, control) -> np.ndarray:
    """Rates of all states that `whole_states` has, in its order, by the package's own model; 0 of those that it lacks."""
    model, values = whole_model(vehicle)
    rates = model.derivative(
        values, tuple(state[name] for name in model.states), tuple(control[name] for name in model.controls)
    )
    found = dict(zip(model.states, rates, strict=True))
    zero = np.zeros_like(state["u"])
    return np.array([np.broadcast_to(found.get(name, 0.0), zero.shape) for name in state])


def text_of(path: Path) -> str:
    """What can be read in a file; of an archive in all of its members."""
    if path.suffix == ".npz":
        return str(np.load(path)["about"])
    if not zipfile.is_zipfile(path):
        return path.read_bytes().decode(errors="replace")
    with zipfile.ZipFile(path) as archive:
        return "\n".join(archive.read(name).decode(errors="replace") for name in archive.namelist())


def assert_equal(found, wanted, tolerance=1e-10):
    """Equal to a share of the largest force of the state."""
    assert found.shape == wanted.shape
    assert np.isfinite(found).all()
    assert (np.abs(found - wanted).max(axis=0) <= tolerance * np.abs(wanted).max(axis=0)).all()


def cross(a, b):
    """Vector products of columns."""
    return np.cross(a, b, axis=0)


def rigid_coriolis(mass, nu):
    """Force of inertia C(nu) nu of a spatial inertia about the origin, from momentum."""
    momentum = mass @ nu
    return np.concatenate([cross(nu[3:], momentum[:3]), cross(nu[:3], momentum[:3]) + cross(nu[3:], momentum[3:])])


def spatial_inertia(mass, centre, inertia):
    """About the origin, of a body with its inertia about its centre of gravity."""
    x, y, z = centre
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[mass * np.eye(3), -mass * skew], [mass * skew, inertia - mass * skew @ skew]])


def down_of(phi, theta):
    """The vertical, positive down, in forward, starboard, down axes."""
    return np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
