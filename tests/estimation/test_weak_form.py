"""Rows in weak form: exact linear motion gives its coefficients back, gaps and uneven steps included; and what is refused."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.core.record import Channel, make_record
from seatrial.estimation.regression.weak_form import (
    bump_windows,
    pointwise_trials,
    raw_rows,
    weak_trials,
    where_measured,
)
from seatrial.vehicles.axis_equation import axis_equation
from tests.cases import PROVENANCE
from tests.estimation.row_cases import SHIP, SHIP_CHANNELS, SHIP_EQUATIONS, SHIP_TRUE, ship_motion, ship_record
from tests.estimation_cases import make_trial


def fitted(record, width=2.0, overlap=True, equations=SHIP_EQUATIONS):
    raw = raw_rows(equations, weak_trials([record], equations, width, overlap)[0])
    values = [np.linalg.lstsq(phi, y, rcond=None)[0] for phi, y in zip(raw.design, raw.target, strict=True)]
    return np.sum(values, axis=0)


def even(step, end=60.0):
    time = np.arange(0.0, end, step)
    return ship_record(time, ship_motion(time))


@pytest.mark.parametrize("overlap", [True, False])
def test_exact_motion_gives_its_coefficients_back(overlap):
    assert fitted(even(0.01), overlap=overlap) == pytest.approx(SHIP_TRUE, rel=2e-4)


def test_error_falls_as_the_square_of_the_step():
    errors = [np.abs(fitted(even(step)) - SHIP_TRUE).max() for step in (0.1, 0.05, 0.025)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.25)


def test_uneven_steps_are_weighed_by_their_length():
    time = np.cumsum(np.random.default_rng(1).choice([0.005, 0.01, 0.02], size=5000))
    assert fitted(ship_record(time, ship_motion(time))) == pytest.approx(SHIP_TRUE, rel=2e-3)


def test_windows_that_touch_a_gap_are_dropped():
    time = np.arange(0.0, 60.0, 0.02)
    states = ship_motion(time)
    whole = weak_trials([ship_record(time, states)], SHIP_EQUATIONS, 2.0)[0].windows
    states[1000, 0] = states[1500:1600, 1] = np.nan
    gappy = ship_record(time, states)
    windows = weak_trials([gappy], SHIP_EQUATIONS, 2.0)[0].windows
    lost = set(whole.centre) - set(windows.centre)
    near = [c for c in whole.centre if abs(c - 20.0) < 1.001 or (c + 1.001 > 30.0 and c - 1.001 < 31.98)]
    assert lost == set(near)
    assert fitted(gappy) == pytest.approx(SHIP_TRUE, rel=1e-3)
    assert (np.diff(windows.index) > 1).any()


def test_a_hole_in_time_is_a_gap():
    time = np.arange(0.0, 60.0, 0.02)
    states = ship_motion(time)
    kept = (time < 20) | (time > 25)
    record = make_record(
        time[kept],
        {name: ship_record(time, states).channel(name)[kept] for name in ("delta_r", "v", "r")},
        SHIP_CHANNELS,
        PROVENANCE,
    )
    assert fitted(record) == pytest.approx(SHIP_TRUE, rel=1e-3)


def test_bumps_add_up_to_one():
    time = np.arange(0.0, 20.0, 0.01)
    windows = weak_trials([ship_record(time, ship_motion(time))], SHIP_EQUATIONS, 2.0)[0].windows
    weight = np.asarray((windows.left + windows.right).sum(0)) / 0.01
    assert weight[(time > 1.01) & (time < 17.9)] == pytest.approx(1.0, abs=1e-9)


def test_a_constant_has_no_rate():
    time = np.arange(0.0, 20.0, 0.01)
    windows = weak_trials([ship_record(time, ship_motion(time))], SHIP_EQUATIONS, 2.0)[0].windows
    assert windows.rate @ np.ones(time.size) == pytest.approx(0.0, abs=1e-9)
    assert windows.rate @ time == pytest.approx(1.0, rel=1e-9)


def test_inertia_known_terms_and_the_rate_of_another_axis():
    """m_y dv/dt = m_y (a v + b r + c delta) written with dr/dt in place of v, which it is a combination of."""
    inertia = 5.0
    swap = SHIP[0, 0] / SHIP[1, 0]
    equation = axis_equation(
        "Y", ("Y_rdot", "Y_delta_r"), inertia, known={"Y_r": inertia * (SHIP[0, 1] - swap * SHIP[1, 1])}
    )
    values = fitted(even(0.01), equations=(equation,))
    assert values == pytest.approx(inertia * np.array([swap, SHIP_TRUE[2] - swap * SHIP_TRUE[5]]), rel=1e-3)


def test_measured_accelerations_are_rows_of_their_own():
    rng = np.random.default_rng(5)
    u, rate, rev = 1.5 + 0.1 * rng.normal(size=50), rng.normal(size=50), 12 + rng.normal(size=50)
    rate[7] = np.nan
    equation = axis_equation("X", ("X_u", "T_nabsn"), 30.0, thrust_deduction=0.1, known={"X_uabsu": -2.0})
    trial = pointwise_trials([make_trial(np.arange(50) * 0.1, rev, u=u, udot=rate)], [equation])[0]
    raw = raw_rows([equation], trial)
    kept, n = np.isfinite(rate), 2 * np.pi * rev
    assert raw.design[0] == pytest.approx(np.column_stack([u, 0.9 * n * np.abs(n)])[kept])
    assert raw.target[0] == pytest.approx((30 * rate + 2 * u * np.abs(u))[kept])


def test_signals_that_were_not_measured():
    record = even(0.02)
    with pytest.raises(InputError, match=r'no channel "u", which the term N_ur needs'):
        weak_trials([record], [axis_equation("N", ("N_ur",))], 2.0)
    with pytest.raises(InputError, match=r'no channel "rdot", which the rate of r, axis N needs'):
        pointwise_trials([record], [axis_equation("N", ("N_r",))])


def test_windows_that_cannot_be_had():
    with pytest.raises(InputError, match="at least 10 steps"):
        weak_trials([even(0.2)], SHIP_EQUATIONS, 1.0)
    with pytest.raises(InputError, match=r"a record of 9\.98 s"):
        weak_trials([even(0.02, end=10.0)], SHIP_EQUATIONS, 12.0)
    time = np.arange(0.0, 60.0, 0.02)
    states = ship_motion(time)
    states[::40, 0] = np.nan
    with pytest.raises(InputError, match="gaps in every one of 118 windows"):
        weak_trials([ship_record(time, states)], SHIP_EQUATIONS, 1.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("Q", ("Q_n",)), "X, Y, Z, K, M, N"),
        (("N", ()), "no term with an estimated coefficient"),
        (("N", ("N_r", "Y_r")), 'axis "Y"'),
        (("N", ("N_rabsv", "N_absvr")), "the same regressor as N_rabsv"),
        (("X", ("X_u", "X_udot")), "the acceleration that the equation is solved for"),
        (("X", ("X_du3",)), 'no trim value of "u"'),
        (("X", ("X_u",), -3.0), "axis X, inertia"),
        (("X", ("T_nabsn",), 3.0, 1.0), "axis X, thrust_deduction"),
    ],
)
def test_equations_that_cannot_be(arguments, words):
    with pytest.raises(InputError, match=words):
        axis_equation(*arguments)


def test_slow_sensors_are_taken_where_they_measured_and_controls_averaged_between():
    time = np.arange(0.0, 10.0, 0.1)
    speed = np.where(np.arange(time.size) % 3 == 0, np.sin(time), np.nan)
    record = make_record(
        time,
        {"n": np.arange(time.size) * 1.0, "u": speed},
        (Channel("n", "rad/s", "control"), Channel("u", "m/s", "measurement")),
        PROVENANCE,
    )
    slow = where_measured(record, ["u"])
    np.testing.assert_allclose(slow.time, time[::3])
    np.testing.assert_allclose(slow.channel("n")[:-1], np.arange(time.size)[1::3][: slow.time.size - 1])
    assert np.isfinite(slow.channel("u")).all()


def test_white_force_weighs_each_sample_by_the_bump_and_the_root_of_its_share_of_time():
    """cos^2 inside the window and nothing outside, where the first and last step reach; none where windows do not overlap."""
    time = np.cumsum(np.random.default_rng(1).choice([0.05, 0.1, 0.2], size=60))
    windows = bump_windows(time, np.ones(60, bool), 2.0, True, "uneven")
    share = np.append(np.diff(time), 0.0) / 2 + np.append(0.0, np.diff(time)) / 2
    away = np.abs(time - windows.centre[:, None])
    bump = np.where(away < 1.0, np.cos(np.pi * away / 2) ** 2, 0.0)
    np.testing.assert_allclose(windows.white.toarray(), bump * np.sqrt(share), atol=1e-12)
    assert not bump_windows(time, np.ones(60, bool), 2.0, False, "uneven").white.toarray().any()
