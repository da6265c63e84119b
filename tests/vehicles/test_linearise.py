import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.vehicles.hull import whole_hull
from seatrial.vehicles.linearise import linearise, trim
from tests.cases import DEDUCTION, MASS, N0, THRUST, TRUTH, U0, X_U, X_UU, paper_model
from tests.vehicles.test_longitudinal import (
    ENTRY,
    MODEL,
    NET_BUOYANCY,
    NEUTRAL,
    WEIGHT,
    Z_G,
    forces,
    longitudinal_vehicle,
    matrix_by_hand,
)
from tests.vehicles.test_longitudinal import MASS as DRY_MASS

FLIGHT = trim(MODEL, ENTRY.coefficients, n=125.0)
LEVEL = [*(FLIGHT.state[MODEL.states.index(name)] for name in ("u", "w", "q", "theta")), *FLIGHT.control]
THESIS_SPEED = 1.54


def force_derivatives(u, w, q, theta, n, delta):
    """Partial derivatives of `forces` by u, w, q, z, theta and by n, delta_s; x_g = 0."""
    s, c, net = np.sin(theta), np.cos(theta), -NET_BUOYANCY
    by_state = [
        [-1.21 - 2 * 2.93 * abs(u), -(35.5 + DRY_MASS) * q, -(35.5 + DRY_MASS) * w - 2 * 1.93 * q, 0, -net * c],
        [
            -28.6 * w + (DRY_MASS - 5.22) * q - 2 * 9.64 * u * delta,
            -2 * 1310 * abs(w) - 28.6 * u,
            -2 * 0.632 * abs(q) + (DRY_MASS - 5.22) * u + 2 * DRY_MASS * Z_G * q,
            0,
            -net * s,
        ],
        [
            24 * w - 2 * q - 2 * 6.15 * u * delta,
            2 * 3.18 * abs(w) - DRY_MASS * Z_G * q + 24 * u,
            -2 * 188 * abs(q) - DRY_MASS * Z_G * w - 2 * u,
            0,
            -WEIGHT * Z_G * c,
        ],
    ]
    by_control = [[2 * 0.9 * 6.28e-4 * abs(n), 0], [0, -9.64 * u**2], [0, -6.15 * u**2]]
    return np.array(by_state), np.array(by_control)


@pytest.mark.parametrize("u", [-1.1, U0])
def test_surge_by_hand(u):
    a, b = linearise(paper_model(), TRUTH, (u,), (N0,))
    assert (a.shape, b.shape) == ((1, 1), (1, 1))
    assert a[0, 0] == pytest.approx((X_U + 2 * X_UU * abs(u)) / MASS, rel=1e-13)
    assert b[0, 0] == pytest.approx(2 * (1 - DEDUCTION) * THRUST * 12.5 / MASS / (2 * np.pi), rel=1e-12)


@pytest.mark.parametrize("point", [LEVEL, [1.8, 0.2, -0.3, 0.4, 90.0, 0.1], [-0.5, -0.1, 0.2, -1.0, -40.0, 0.2]])
def test_longitudinal_by_hand(point):
    """In trim and anywhere else: mass matrix inverted on the derivatives of the published forces."""
    u, w, q, theta, n, delta = point
    a, b = linearise(MODEL, ENTRY.coefficients, (u, w, q, 2.0, theta), (n, delta))
    by_state, by_control = force_derivatives(*point)
    kinematics = [
        [-np.sin(theta), np.cos(theta), 0, 0, -w * np.sin(theta) - u * np.cos(theta)],
        [0, 0, 1, 0, 0],
    ]
    assert np.allclose(a[:3], np.linalg.solve(matrix_by_hand(), by_state), rtol=1e-11, atol=1e-13)
    assert np.allclose(a[3:], kinematics, rtol=1e-13)
    assert np.allclose(b[:3], np.linalg.solve(matrix_by_hand(), by_control), rtol=1e-11, atol=1e-13)
    assert (np.asarray(b[3:]) == 0).all()


def test_fins_of_the_thesis_linear_model():
    """Prestero's appendix D: fin coefficients 21.3 and 14.6 give -50.6 N/rad and -34.6 N m/rad at 1.54 m/s."""
    fins = {"Z_uudelta_s": -21.3, "M_uudelta_s": -14.6}
    model = longitudinal_vehicle(ENTRY.hull, tuple(fins))
    _, b = linearise(model, fins, (THESIS_SPEED, 0, 0, 0, 0), (0.0,))
    assert matrix_by_hand() @ b[:3, 0] == pytest.approx([0, -50.6, -34.6], rel=2e-3, abs=1e-9)


def test_righting_moment_of_the_thesis():
    """-5.77 N m/rad is printed; z_g W with the printed z_g and W is 1.6 % more."""
    a, _ = linearise(MODEL, ENTRY.coefficients, (THESIS_SPEED, 0, 0, 0, 0), (125.0, 0.0))
    assert (matrix_by_hand() @ a[:3])[2, 4] == pytest.approx(-5.77, rel=0.02)


def test_pitch_transfer_function_of_the_thesis():
    """theta / delta_s = -4.15 / (s^2 + 0.825 s + 0.693), from the linear coefficients printed in appendix D.

    The transfer function leaves out surge, whose coupling through z_g changes the pitch inertia by 0.14 %.
    """
    hull = whole_hull(
        "pitch alone",
        30.48,
        (None, 3.45, None),
        centre_of_gravity=(0.0, 0.0, 5.77 / WEIGHT),
        fixed={"X_udot": -0.93, "M_qdot": -4.88},
    )
    params = {"X_u": -13.5, "M_q": -6.87, "M_delta_s": -34.6}
    a, b = linearise(longitudinal_vehicle(hull, tuple(params)), params, (0, 0, 0, 0, 0), (0.0,))
    pitch = np.asarray(a)[np.ix_([2, 4], [2, 4])]
    assert np.poly(pitch) == pytest.approx([1, 6.87 / 8.33, 5.77 / 8.33], rel=3e-3)
    assert b[2, 0] == pytest.approx(-34.6 / 8.33, rel=3e-3)
    assert np.linalg.eigvals(pitch)[0].real == pytest.approx(-0.41, abs=0.005)
    assert abs(np.linalg.eigvals(pitch)[0].imag) == pytest.approx(0.72, abs=0.01)


def test_published_hull_diverges_in_pitch_until_drag_holds_it():
    """Z_w M_q < M_w (Z_q + m u): the Munk moment beats fins and damping, in the thesis' linear coefficients as well."""
    a, _ = linearise(MODEL, ENTRY.coefficients, (THESIS_SPEED, 0, 0, 0, 0), (125.0, 0.0))
    z_w, z_q, m_w, m_q = (THESIS_SPEED * x for x in (-28.6, -5.22, 24.0, -2.0))
    assert z_w * m_q < m_w * (z_q + 30.48 * THESIS_SPEED)
    assert 30.7 * (-9.67 + 30.48 * THESIS_SPEED) > -66.6 * -6.87
    assert np.linalg.eigvals(a).real.max() > 0.3


def test_level_flight_balances_by_hand():
    u, w, _, theta, n, _ = LEVEL
    assert MODEL.controls == ("n", "delta_s")
    assert np.abs(forces(*LEVEL)).max() < 1e-9
    assert w == pytest.approx(u * np.tan(theta), rel=1e-9)
    assert theta < 0
    assert n == 125.0


@pytest.mark.parametrize("speed", [1.0, 1.54, 2.3])
def test_trim_by_speed_and_by_propeller_agree(speed):
    by_speed = trim(MODEL, ENTRY.coefficients, u=speed)
    by_propeller = trim(MODEL, ENTRY.coefficients, n=by_speed.control[0])
    assert by_speed.state[0] == speed
    assert by_propeller.state == pytest.approx(by_speed.state, abs=1e-9)
    assert by_propeller.control == pytest.approx(by_speed.control, abs=1e-8)


def test_neutral_vehicle_needs_neither_pitch_nor_fin():
    level = trim(longitudinal_vehicle(NEUTRAL, tuple(ENTRY.coefficients)), ENTRY.coefficients, n=125.0)
    assert level.state == pytest.approx((U0, 0.0, 0.0, 0.0, 0.0), abs=1e-10)
    assert level.control == pytest.approx((125.0, 0.0), abs=1e-10)
    without_fins = [name for name in ENTRY.coefficients if "delta_s" not in name]
    finless = trim(
        longitudinal_vehicle(NEUTRAL, without_fins), {name: ENTRY.coefficients[name] for name in without_fins}, u=U0
    )
    assert finless.control == pytest.approx((125.0,), abs=1e-7)


@pytest.mark.parametrize(
    ("asked", "expected"),
    [({}, "one of u and n"), ({"u": 1.0, "n": 90.0}, "one of u and n"), ({"u": 0.2}, "level flight")],
)
def test_no_trim(asked, expected):
    with pytest.raises(InputError, match=expected):
        trim(MODEL, ENTRY.coefficients, **asked)


def test_no_trim_without_a_propeller():
    with pytest.raises(InputError, match="driven by n"):
        trim(longitudinal_vehicle(NEUTRAL, ("X_uabsu",)), {"X_uabsu": -3.0}, u=1.0)
    with pytest.raises(InputError, match="a longitudinal vehicle"):
        trim(paper_model(), TRUTH, u=1.0)
