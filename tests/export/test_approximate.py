"""HoloOcean, which keeps little: its own formulas, applied to the written file, give what is predicted of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.targets.holoocean import HoloOcean
from tests.export.cases import COUNT, assert_equal, published, states, with_terms, written


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
