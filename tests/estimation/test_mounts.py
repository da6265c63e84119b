"""What a sensor off the origin shows, against SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seatrial.estimation.simulation.mounts import Mount
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.catalogue import load_vehicle

BODY = dict(zip("uvwpqr", (1.2, -0.3, 0.2, 0.4, -0.5, 0.6), strict=True))
POSE = {"phi": 0.3, "theta": -0.8, "psi": 2.0, "x": 4.0, "y": -2.0, "z": 7.0}
PLACE, TURN, SCALE = (0.3, -0.1, 0.2), (0.05, -0.1, 0.2), 1.02


def shown(mount, channels, values=()):
    known = {**BODY, **POSE}
    return np.array(
        [mount.show(channel, dict(values), lambda name: known.get(name, 0.0)) for channel in channels], float
    )


def test_velocity_rotation_and_position_at_a_place():
    mount = Mount("dvl", PLACE, TURN, SCALE)
    v, omega = (np.array([BODY[name] for name in names]) for names in ("uvw", "pqr"))
    back = Rotation.from_euler("ZYX", TURN[::-1]).inv()
    np.testing.assert_allclose(shown(mount, "uvw"), SCALE * back.apply(v + np.cross(omega, PLACE)), rtol=1e-12)
    np.testing.assert_allclose(shown(mount, "pqr"), SCALE * back.apply(omega), rtol=1e-12)
    attitude = Rotation.from_euler("ZYX", [POSE[name] for name in ("psi", "theta", "phi")])
    position = np.array([POSE[name] for name in "xyz"])
    np.testing.assert_allclose(shown(mount, "xyz"), SCALE * (position + attitude.apply(PLACE)), rtol=1e-12)


def test_what_is_sought_takes_the_place_of_what_is_stated():
    names = ("x_dvl", "yaw_dvl", "scale_dvl")
    sought = dict(zip(names, (0.5, -0.3, 0.9), strict=True))
    whole = Mount("dvl", (0.5, *PLACE[1:]), (*TURN[:2], -0.3), 0.9)
    np.testing.assert_allclose(
        shown(Mount("dvl", PLACE, TURN, SCALE, unknown=names), "uvw", sought), shown(whole, "uvw")
    )
    assert shown(Mount("at the origin"), "uvw") == pytest.approx([BODY[name] for name in "uvw"])


def test_an_accelerometer_shows_second_differences_of_its_place():
    """R^T (d2/dt2 (x + R r) - g), the path of the place simulated over three instants."""
    vehicle = load_vehicle("bluerov2_heavy")
    model = vehicle.build(attitude="quaternion", positions=("x", "y", "z"))
    turn = Rotation.from_euler("ZYX", [2.0, -0.8, 0.3])
    x, y, z, w = turn.as_quat()
    at = {**BODY, "x": 4.0, "y": -2.0, "z": 7.0, "q_w": w, "q_x": x, "q_y": y, "q_z": z}
    state, push = tuple(at[name] for name in model.states), (3.0, -2.0, 5.0, -8.0, 4.0, -1.0, 2.0, -6.0)
    h, places = 1e-4, []
    for step in (-h, 0.0, h):
        moved = rk4_step(lambda x: model.derivative(vehicle.coefficients, x, push), state, step)
        there = dict(zip(model.states, map(float, moved), strict=True))
        attitude = Rotation.from_quat([there[name] for name in ("q_x", "q_y", "q_z", "q_w")])
        places.append(np.array([there[name] for name in "xyz"]) + attitude.apply(PLACE))
    force = turn.inv().apply(np.diff(places, 2, axis=0)[0] / h**2 - [0.0, 0.0, 9.81])
    mount = Mount("imu", PLACE)
    found = [
        float(mount.show(name, {}, lambda part: model.output(part, vehicle.coefficients, state, push)))
        for name in ("a_x", "a_y", "a_z")
    ]
    np.testing.assert_allclose(found, force, atol=1e-5)
