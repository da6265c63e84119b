"""The vehicle of the study under both readings."""

import pytest

from studies.remus100.reading import READINGS, RPM
from tests.cases import U0

A, B = READINGS["A"], READINGS["B"]


def test_reading_a():
    """Printed -1.21, -2.93, 6.28 with T in 1e-2 N/(rev/s)^2, trim at 750 rpm, m - X_udot = 31.4 kg."""
    assert A.truth == pytest.approx({"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-2 / 39.47841760435743})
    assert A.printed_truth == pytest.approx({"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28})
    assert (A.turns, A.inertia) == pytest.approx((78.53981633974483, 31.4))
    assert (A.filter_noise, A.sigma) == (0.1, 0.0757)
    assert (A.steps / RPM, A.lowest / RPM, A.highest / RPM) == pytest.approx((400, 100, 200))
    assert A.thrust_filter / A.thrust_print == pytest.approx(100)
    assert (A.doubted, A.doubted_values, A.wide) == ("X_du3", (0.1, 1.0), 50.0)


def test_reading_b():
    """As reading A but with T in 1e-4 N/(rad/s)^2 and 125 rad/s."""
    assert B.truth == pytest.approx({"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4})
    assert B.printed_truth == pytest.approx(A.printed_truth)
    assert (B.turns, B.inertia, B.thrust_filter / B.thrust_print) == pytest.approx((125.0, 31.4, 1.0))
    assert (B.sigma, B.steps, B.highest) == pytest.approx((A.sigma, A.steps, A.highest))


def test_both_readings_have_the_same_trim():
    """Thrust, and so speed: 6.28e-2 12.5^2 = 6.28e-4 125^2, at 1.541862 m/s."""
    assert A.truth["T_nabsn"] * A.turns**2 == pytest.approx(B.truth["T_nabsn"] * B.turns**2, rel=1e-12)
    assert A.hull.trim["u"] == pytest.approx(U0, abs=1e-9)
    assert B.hull.trim["u"] == pytest.approx(1.541861549917, abs=1e-9)
