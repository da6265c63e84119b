"""Stonefish and HoloOcean, which keep little: their own formulas, applied to the written files, give what is predicted of them."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.targets.holoocean import HoloOcean
from seatrial.export.targets.stonefish import Stonefish, geometry_added_mass
from tests.export.cases import COUNT, assert_equal, own_force, published, states, with_terms, written


def box_points(size, count):
    """Points all over a box, with the normal and the area that belong to each; shapes (n, 3), (n, 3) and (n,)."""
    half, points, normals, areas = 0.5 * np.array(size), [], [], []
    grid = (np.arange(count) + 0.5) / count * 2 - 1
    for axis in range(3):
        j, k = (i for i in range(3) if i != axis)
        for side in (-1.0, 1.0):
            at = np.zeros((count * count, 3))
            at[:, axis] = side * half[axis]
            at[:, j], at[:, k] = (
                half[i] * part.ravel() for i, part in zip((j, k), np.meshgrid(grid, grid), strict=True)
            )
            points.append(at)
            normals.append(np.eye(3)[[axis] * len(at)] * side)
            areas.append(np.full(len(at), 4 * half[j] * half[k] / len(at)))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas)


def stonefish_drag(link, density, nu, count):
    """Force and moment of the mesh: quadratic on faces that meet the water, friction on all, each times its multipliers."""
    size = np.array(link.find("dimensions").get("xyz").split(), float)
    quadratic, viscous = (
        np.array(link.find("hydrodynamics").get(key).split(), float) for key in ("quadratic_drag", "viscous_drag")
    )
    at, normal, area = box_points(size, count)
    water = -(nu[:3] + np.cross(nu[3:], at))
    across = (water * normal).sum(1, keepdims=True) * normal
    meets = (normal * across).sum(1) < 0
    push = np.where(meets, area * np.linalg.norm(across, axis=1), 0.0)[:, None] * across
    friction = ((water - across) * area[:, None]).sum(0)

    def weighed(vector, by):
        length = np.linalg.norm(vector)
        return (np.abs(vector) / length) @ by * vector if length > 0 else np.zeros(3)

    parts = [weighed(vector, quadratic) for vector in (push.sum(0), np.cross(at, push).sum(0))]
    return 0.5 * density * np.concatenate(parts) + density * np.concatenate([weighed(friction, viscous), np.zeros(3)])


@pytest.mark.parametrize("axis", range(6))
def test_stonefish_drags_each_motion_as_predicted(axis):
    """Drag in surge, sway and heave is the vehicle's own; that of a turn is an integral over the box."""
    vehicle = with_terms(published(), X_u=-1.2, Y_v=-4.0, Z_w=-5.0)
    vehicle = replace(vehicle, hull=replace(vehicle.hull, centre_of_gravity=(0, 0, 0), weight=300.0, buoyancy=300.0))
    link = ElementTree.fromstring(written(Stonefish(), vehicle)["vehicle.scn"]).find(".//base_link")
    half = 0.5 * np.array(link.find("dimensions").get("xyz").split(), float)
    added, turned = geometry_added_mass(half, 1025.0)
    mass = vehicle.rigid_mass + np.diag([added] * 3 + list(turned))
    speeds = np.random.default_rng(axis).normal(size=COUNT // 6 if axis < 3 else 3)
    nu, zero = np.zeros((6, speeds.size)), np.zeros(speeds.size)
    nu[axis] = speeds
    controls = dict.fromkeys(("n", "delta_r", "delta_s"), zero)
    predicted = (mass @ Stonefish().carries(vehicle).motion(nu, zero, zero, controls))[axis]
    found = np.array([stonefish_drag(link, 1025.0, column, 4 if axis < 3 else 100)[axis] for column in nu.T])
    np.testing.assert_allclose(found, predicted, rtol=1e-10 if axis < 3 else 1e-3)
    if axis < 3:
        np.testing.assert_allclose(predicted, own_force(vehicle, nu, zero, zero, controls)[axis], rtol=1e-10)


def test_stonefish_thrusters_push_along_their_axis():
    vehicle = published("bluerov2_heavy")
    root = ElementTree.fromstring(written(Stonefish(), vehicle)["vehicle.scn"])
    for thruster, actuator in zip(vehicle.thrusters, root.findall(".//actuator"), strict=True):
        _, pitch, yaw = map(float, actuator.find("origin").get("rpy").split())
        ahead = [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)]
        np.testing.assert_allclose(ahead, thruster.column[:3], atol=1e-12)
        assert actuator.find("specs").get("max_setpoint") == "40.0"


def holoocean_rates(agent, nu, phi, theta, controls):
    """Fossen's torpedo from the agent's tables, with its matrices written out."""
    d, a = agent["dynamics"], agent["actuator"]
    rho, m, half, b = d["rho"], d["mass"], d["length"] / 2, d["diam"] / 2
    e = np.sqrt(1 - (b / half) ** 2)
    alpha = 2 * (1 - e**2) / e**3 * (0.5 * np.log((1 + e) / (1 - e)) - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * np.log((1 + e) / (1 - e))
    k3 = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    ix, iy = 0.4 * m * b**2, 0.2 * m * (half**2 + b**2)
    x, y, z = d["r_bg"]
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    h = np.block([[np.eye(3), skew.T], [np.zeros((3, 3)), np.eye(3)]])
    rigid = h.T @ np.diag([m, m, m, ix, iy, iy]) @ h
    ma = np.diag(
        [m * alpha / (2 - alpha), m * beta / (2 - beta), m * beta / (2 - beta), d["r44"] * ix, k3 * iy, k3 * iy]
    )
    total = rigid + ma

    def coriolis(matrix):
        def s(v):
            return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])

        p, q = matrix[:3] @ nu, matrix[3:] @ nu
        return np.block([[np.zeros((3, 3)), -s(p)], [-s(p), -s(q)]])

    ca = coriolis(ma)
    for i, j in ((4, 0), (0, 4), (4, 2), (2, 4), (5, 0), (0, 5), (5, 1), (1, 5)):
        ca[i, j] = 0
    roll, pitch = (np.sqrt(m * 9.81 * (z - d["r_bb"][2]) / total[i, i]) for i in (3, 4))
    speed = np.linalg.norm(nu[:3])
    fade = np.exp(-3 * speed)
    damping = np.diag(
        [fade * total[0, 0] / d["T_surge"], fade * total[1, 1] / d["T_sway"], total[2, 2] / d["T_sway"],
         2 * d["zeta_roll"] * roll * total[3, 3], 2 * d["zeta_pitch"] * pitch * total[4, 4], total[5, 5] / d["T_yaw"]]
    )  # fmt: skip
    area = d["area_fraction"] * d["length"] * d["diam"]
    ratio, attack = d["diam"] ** 2 / area, np.arctan2(nu[2], nu[0])
    lift = np.pi * ratio / (1 + np.sqrt(1 + (ratio / 2) ** 2)) * attack
    drag = d["Cd"] * np.pi * b**2 / area + lift**2 / (np.pi * d["e"] * ratio)
    q = 0.5 * rho * area * speed**2
    tau = np.zeros(6)
    tau[0] = q * (lift * np.sin(attack) - drag * np.cos(attack))
    tau[2] = -q * (lift * np.cos(attack) + drag * np.sin(attack))
    for i in range(20):
        at = -half + (i + 0.5) * d["length"] / 20
        local = nu[1] + at * nu[5]
        strip = -0.5 * rho * d["diam"] * 1.1977 * d["length"] / 20 * local * abs(local)
        tau[1] += strip
        tau[5] += at * strip
    n, rudder, plane = controls["n"] / (2 * np.pi), -controls["delta_r"], controls["delta_s"]
    for angle, other, force, moment, sign in ((rudder, 1, 1, 5, 1.0), (plane, 2, 2, 4, -1.0)):
        pressure = 0.5 * rho * (nu[0] ** 2 + nu[other] ** 2) * a["fin_count"] / 2 * a["fin_area"] * a["CL_delta"]
        tau[force] -= pressure * angle
        tau[0] -= pressure * angle**2
        tau[moment] -= sign * a["x_fin"] * pressure * angle
    tau[0] += (1 - a["t_prop"]) * rho * a["D_prop"] ** 4 * a["KT_0"] * n * abs(n)
    tau[3] += rho * a["D_prop"] ** 5 * a["KQ_0"] * n * abs(n) / 10
    w = m * 9.81 * z
    g = np.array([0, 0, 0, w * np.cos(theta) * np.sin(phi), w * np.sin(theta), 0])
    return tau - (coriolis(rigid) + ca + damping) @ nu - g


def test_holoocean_moves_as_predicted():
    vehicle = with_terms(published(), X_u=-1.2, Y_v=-3.0)
    (agent,) = json.loads(written(HoloOcean(), vehicle)["agent.json"])["agents"]
    predicted, (nu, phi, theta, controls) = HoloOcean().carries(vehicle).motion, states(vehicle)
    zero = dict.fromkeys(controls, 0.0)
    ones = np.array([predicted(column, 0.0, 0.0, zero) for column in np.zeros((1, 6))])
    assert np.abs(ones).max() < 1e-12, "at rest and upright nothing acts"
    for i in range(COUNT):
        here = {name: float(value[i]) for name, value in controls.items()}
        wanted = predicted(nu[:, i], phi[i], theta[i], here)
        found = holoocean_rates(agent, nu[:, i], phi[i], theta[i], here)
        assert_equal(found[:, None], (total_of(agent) @ wanted)[:, None])


def total_of(agent):
    d = agent["dynamics"]
    from seatrial.export.torpedo import lamb_factors

    m, b, half, z = d["mass"], d["diam"] / 2, d["length"] / 2, d["r_bg"][2]
    k1, k2, k3 = lamb_factors(half / b)
    ix, iy = 0.4 * m * b**2, 0.2 * m * (half**2 + b**2)
    total = np.diag(
        [m + m * k1, m + m * k2, m + m * k2, 1.3 * ix + m * z * z, iy * (1 + k3) + m * z * z, iy * (1 + k3)]
    )
    total[0, 4] = total[4, 0] = m * z
    total[1, 3] = total[3, 1] = -m * z
    return total


def test_holoocean_refuses_what_is_no_torpedo():
    with pytest.raises(InputError, match="8 thrusters"):
        HoloOcean().check(published("bluerov2_heavy"))
    high = published()
    with pytest.raises(InputError, match="below that of buoyancy"):
        HoloOcean().check(replace(high, hull=replace(high.hull, centre_of_gravity=(0.0, 0.0, -0.01))))
