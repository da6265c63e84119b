"""HoloOcean, which keeps little: its own formulas, applied to the written file, give what is predicted of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.targets.holoocean import (
    HoloOcean,
    _limit_changes,
    actuator_limits,
    lamb_factors,
    torpedo_motion,
    torpedo_of,
)
from seatrial.vehicles.actuators import Actuator
from tests.export.cases import COUNT, FLIPPED, assert_equal, published, rich, states, with_terms, written


def holoocean_rates(agent, nu, phi, theta, commands):
    """Fossen's torpedo from the agent's tables, with its matrices written out, for its u_control of four fins (rad) and rpm."""
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
    q = 0.5 * 1026 * area * speed**2
    tau = np.zeros(6)
    tau[0] = q * (lift * np.sin(attack) - drag * np.cos(attack))
    tau[2] = -q * (lift * np.cos(attack) + drag * np.sin(attack))
    hoerner = np.interp(0.5, [0.4933, 0.5585], [1.2108, 1.0836])
    for i in range(21):
        at = -half + i * d["length"] / 20
        local = nu[1] + at * nu[5]
        strip = -0.5 * 1026 * d["diam"] * hoerner * d["length"] / 20 * local * abs(local)
        tau[1] += strip
        tau[5] += at * strip
    *fins, rpm = commands
    n = rpm / 60
    for number, angle in enumerate(fins):  # from starboard by the lower side, at the end of the spheroid
        around = np.radians(a["fin_offset_deg"]) + number * 2 * np.pi / a["fin_count"]
        local = nu[0] ** 2 + (nu[1] * np.sin(around)) ** 2 + (nu[2] * np.cos(around)) ** 2
        push = 0.5 * rho * a["fin_area"] * a["CL_delta"] * angle * local
        force = push * np.array([0.0, np.sin(around), -np.cos(around)])
        tau += np.concatenate([force, np.cross([-half, 0.1 * np.cos(around), 0.1 * np.sin(around)], force)])
    tau[0] += (1 - a["t_prop"]) * rho * a["D_prop"] ** 4 * a["KT_0"] * n * abs(n)
    tau[3] += rho * a["D_prop"] ** 5 * a["KQ_0"] * n * abs(n) / 10
    w = m * 9.81 * z
    g = np.array([0, 0, 0, w * np.cos(theta) * np.sin(phi), w * np.sin(theta), 0])
    return tau - (coriolis(rigid) + ca + damping) @ nu - g


def u_control(contrary, n, delta_r, delta_s):
    """HoloOcean's command of ours, as the file tells it; `contrary` are those that it has with the other sign."""
    rudder, plane = (-x if name in contrary else x for name, x in (("delta_r", delta_r), ("delta_s", delta_s)))
    return np.array([plane, -rudder, -plane, rudder, n * 30 / np.pi])


@pytest.mark.parametrize("fins", [{}, FLIPPED], ids=["published", "flipped"])
def test_holoocean_moves_as_predicted(fins):
    vehicle = with_terms(published(), X_u=-1.2, Y_v=-3.0, **fins)
    (agent,) = json.loads(written(HoloOcean(), vehicle)["agent.json"])["agents"]
    carried, (nu, phi, theta, controls) = HoloOcean().carries(vehicle), states(vehicle)
    predicted = carried.motion
    zero = dict.fromkeys(controls, 0.0)
    ones = np.array([predicted(column, 0.0, 0.0, zero) for column in np.zeros((1, 6))])
    assert np.abs(ones).max() < 1e-12, "at rest and upright nothing acts"
    for i in range(COUNT):
        here = {name: float(value[i]) for name, value in controls.items()}
        wanted = predicted(nu[:, i], phi[i], theta[i], here)
        found = holoocean_rates(agent, nu[:, i], phi[i], theta[i], u_control(carried.reversed, **here))
        assert_equal(found[:, None], (total_of(agent) @ wanted)[:, None])


def total_of(agent):
    d = agent["dynamics"]
    from seatrial.export.targets.holoocean import lamb_factors

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


def test_holoocean_has_the_vehicle_s_actuators_or_says_that_they_are_its_own():
    vehicle = rich()
    carried = HoloOcean().carries(vehicle)
    (agent,) = json.loads(written(HoloOcean(), vehicle)["agent.json"])["agents"]
    actuator, said = agent["actuator"], " ".join(carried.changed)
    assert actuator["T_n"] == 0.5
    assert actuator["nMax"] == pytest.approx(157 * 30 / np.pi)
    assert actuator["T_delta"] == 0.1
    assert actuator["deltaMax_fin_deg"] == pytest.approx(np.degrees(0.2))
    assert "HoloOcean's own" not in said
    assert "limits of n alike either way limits of delta_r alike either way" in said
    assert "one lag and limit for all fins" in said
    assert carried.actuators["n"] == Actuator(0.5, -157.0, 157.0)
    assert [line.rpartition(" of ")[2] for line in carried.lost[-3:]] == ["n", "delta_r", "delta_s"]
    assert carried.lost[-2] == "greatest rate 57.3 deg/s and limits -11.46 to 14.32 deg of delta_r"
    bare = HoloOcean().carries(published())
    assert "T_n = 1 s, nMax = 1525 rpm, T_delta = 0.1 s" in " ".join(bare.changed)
    assert bare.actuators["n"].time_constant == 1.0
    assert bare.actuators["delta_s"].upper == pytest.approx(np.radians(13.6))
    (agent,) = json.loads(written(HoloOcean(), published())["agent.json"])["agents"]
    assert (agent["actuator"]["T_n"], agent["actuator"]["nMax"], agent["actuator"]["T_delta"]) == (1.0, 1525.0, 0.1)


def test_damping_of_the_torpedo_has_the_power_of_the_vehicle_s():
    """Of each axis by itself: over a swing of 0.2 rad/s |x| x loses 8 / (3 pi) 0.2 x, and none drives where the vehicle's does."""
    own = {"K_p": -0.11, "K_pabsp": -0.3, "M_q": -3.0, "M_qabsq": -40.0, "N_r": -7.0, "N_rabsr": -20.0}
    own |= {"X_u": -2.0, "Y_v": -30.0}
    vehicle = with_terms(published(), **own)
    (agent,) = json.loads(written(HoloOcean(), vehicle)["agent.json"])["agents"]
    d, total = agent["dynamics"], np.diag(total_of(agent))
    frequency = [np.sqrt(d["mass"] * 9.81 * d["r_bg"][2] / total[i]) for i in (3, 4)]
    swing = 0.2 * 8 / (3 * np.pi)
    assert 2 * d["zeta_roll"] * frequency[0] * total[3] == pytest.approx(0.11 + swing * 0.3)
    assert 2 * d["zeta_pitch"] * frequency[1] * total[4] == pytest.approx(3.0 + swing * 40.0)
    yaw = total[5]
    assert yaw / d["T_yaw"] == pytest.approx(7.0 + swing * 20.0)
    k1, k2, _ = lamb_factors(d["length"] / d["diam"])
    assert d["mass"] * (1 + k1) / d["T_surge"] == pytest.approx(2.0)
    assert d["mass"] * (1 + k2) / d["T_sway"] == pytest.approx(30.0)
    driven = with_terms(vehicle, K_p=0.5, M_q=30.0, N_r=30.0, X_u=0.0, Y_v=0.0)
    (agent,) = json.loads(written(HoloOcean(), driven)["agent.json"])["agents"]
    d = agent["dynamics"]
    assert (d["zeta_roll"], d["zeta_pitch"]) == (0.0, 0.0)
    assert min(d["T_yaw"], d["T_surge"], d["T_sway"]) >= 1e5


def test_drag_of_the_torpedo_is_the_vehicle_s_at_its_trim_speed():
    vehicle, u = with_terms(published(), X_u=-2.0, X_uabsu=-3.5), 1.3
    vehicle = replace(vehicle, hull=replace(vehicle.hull, trim={"u": u}))
    torpedo = torpedo_of(vehicle, 1026.0)
    ahead = torpedo_motion(torpedo)(np.array([u, 0, 0, 0, 0, 0.0]), 0.0, 0.0, {})
    inertia = torpedo.mass * (1 + lamb_factors(torpedo.half_length / torpedo.radius)[0])
    force = inertia * ahead[0] + torpedo.mass * torpedo.low * ahead[4]
    assert -force == pytest.approx(2.0 * u + 3.5 * u**2, rel=1e-9)


def test_spheroid_has_the_mass_and_the_added_mass_of_the_vehicle():
    vehicle = published()
    t = torpedo_of(vehicle, 1000.0)
    assert 4 / 3 * np.pi * 1000.0 * t.half_length * t.radius**2 == pytest.approx(vehicle.hull.mass)
    assert lamb_factors(t.half_length / t.radius)[0] * t.mass == pytest.approx(vehicle.added_mass[0, 0])
    sphere = lamb_factors(1.0 + 1e-4)
    assert sphere == pytest.approx((0.5, 0.5, 0.0), abs=1e-3)
    assert lamb_factors(1e4) == pytest.approx((0.0, 1.0, 1.0), abs=1e-3)


@pytest.mark.parametrize(
    ("actuators", "found"),
    [
        ({}, {}),
        ({"n": Actuator(0.0, -100.0, 120.0)}, {"nMax": 120 * 30 / np.pi}),
        ({"n": Actuator(0.3, -130.0, 120.0)}, {"T_n": 0.3, "nMax": 130 * 30 / np.pi}),
        (
            {"delta_r": Actuator(0.1, -0.3, 0.2), "delta_s": Actuator(0.2, -0.25, 0.4)},
            {"T_delta": 0.2, "deltaMax_fin_deg": np.degrees(0.2)},
        ),
        ({"delta_s": Actuator(0.0, -0.25, 0.4)}, {"deltaMax_fin_deg": np.degrees(0.25)}),
    ],
)
def test_limits_of_the_actuators_are_the_narrowest_and_lags_the_longest(actuators, found):
    assert actuator_limits(replace(published(), actuators=actuators)) == pytest.approx(found)


def test_numbers_that_holoocean_has_of_its_own_and_the_spheroid_in_words():
    """Its formulas take them from the table, so that no motion tells whether they are those of its own vehicle."""
    vehicle = published()
    (agent,) = json.loads(written(HoloOcean(), vehicle)["agent.json"])["agents"]
    own = {"r44": 0.3, "e": 0.7, "area_fraction": 0.7, "K_nomoto": 0.25, "r_bb": [0.0, 0.0, 0.0]}
    assert {key: agent["dynamics"][key] for key in own} == own
    propeller = {
        "fin_count": 4,
        "fin_offset_deg": 0.0,
        "CL_delta": 1.0,
        "D_prop": 0.14,
        "t_prop": 0.0,
        "w": 0.0,
        "Ja_max": 1.0,
    }
    assert {key: agent["actuator"][key] for key in propeller} == propeller
    for kind in ("KT", "KQ"):
        assert agent["actuator"][f"{kind}_0"] == agent["actuator"][f"{kind}_max"]
    torpedo, said = torpedo_of(vehicle, 1000.0), HoloOcean(density=1000.0).carries(vehicle).changed[0]
    assert agent["sensors"] == [{"sensor_type": "DynamicsSensor", "configuration": {"UseCOM": True, "UseRPY": False}}]
    assert agent["control_scheme"] == 1
    assert f"{2 * torpedo.half_length:.3g} m long and {2 * torpedo.radius:.3g} m thick" in said


def test_torpedo_has_the_vehicle_s_thrust_torque_righting_arm_and_mean_fin():
    """Its fins stand at its end, u^2 times area and density each; its centre of gravity counts from that of buoyancy."""
    vehicle = with_terms(published(), N_uudelta_r=-6.0, M_uudelta_s=-8.0, T_nabsn=6e-4, K_nabsn=-1e-5)
    hull = replace(vehicle.hull, centre_of_gravity=(0.0, 0.0, 0.03), centre_of_buoyancy=(0.0, 0.0, 0.01))
    torpedo = torpedo_of(replace(vehicle, hull=hull), 1000.0)
    assert torpedo.low == pytest.approx(0.02)
    assert 1000.0 * torpedo.fin_area * torpedo.half_length == pytest.approx(7.0)
    assert torpedo.thrust == pytest.approx((1 - hull.thrust_deduction) * 6e-4)
    assert torpedo.torque == -1e-5
    gentle = torpedo_of(with_terms(vehicle, X_u=-0.5, Y_v=-0.5), 1000.0)
    assert max(gentle.surge_time, gentle.sway_time) < 1e3


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"low": 0.0}, "a centre of gravity 0 m below that of buoyancy"),
        ({"low": 0.01}, None),
        ({"share": 0.51}, "an added mass of 0.51 of the mass in surge"),
        ({"share": 0.49}, None),
        ({"share": 0.0}, "an added mass of 0 of the mass in surge"),
    ],
)
def test_what_is_no_torpedo_from_both_sides(change, found):
    """A centre of gravity at that of buoyancy, itself not at the origin; an added mass of no spheroid."""
    given = {"low": 0.02, "share": 0.03} | change
    vehicle = published()
    hull = replace(vehicle.hull, centre_of_gravity=(0.0, 0.0, 0.01 + given["low"]), centre_of_buoyancy=(0.0, 0.0, 0.01))
    vehicle = replace(vehicle, hull=hull, coefficients={**vehicle.coefficients, "X_udot": -given["share"] * hull.mass})
    if found is None:
        HoloOcean().check(vehicle)
    else:
        with pytest.raises(InputError, match=found):
            HoloOcean().check(vehicle)


@pytest.mark.parametrize(
    ("lower", "upper", "told"), [(-100.0, 100.0, False), (-100.0, 90.0, True), (-np.inf, 90.0, False)]
)
def test_limits_that_differ_either_way_are_told(lower, upper, told):
    said = _limit_changes(replace(published(), actuators={"n": Actuator(0.1, lower, upper)}))
    assert said == (["limits of n alike either way"] if told else [])
