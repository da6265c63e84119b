import numpy as np
import pytest

from seatrial.campaign.paper.filters import (
    TABLE_1,
    make_trials,
    printed_units,
    rms_error,
    run_all,
    table_1,
    table_2,
)
from seatrial.campaign.paper.reading import PRINTED, READINGS, RPM
from tests.cases import U0, naive_rk4, surge_rate

A, B = READINGS["A"], READINGS["B"]


def test_both_readings_have_the_same_trim():
    """Thrust, and so speed: 6.28e-2 12.5^2 = 6.28e-4 125^2, at 1.541862 m/s."""
    assert A.truth["T_nabsn"] * A.trim**2 == pytest.approx(B.truth["T_nabsn"] * B.trim**2, rel=1e-12)
    assert A.hull.trim["u"] == pytest.approx(U0, abs=1e-9)
    assert B.hull.trim["u"] == pytest.approx(1.541861549917, abs=1e-9)


def test_trials_against_a_plain_loop():
    """Speed by textbook RK4, and noise of 0.1 on both channels: 3 000 values, whose sd has an error of 1.3 %."""
    trials = make_trials(A, 1)
    rev_per_s = trials.control[0, :, 0] / (2 * np.pi)
    assert np.abs(trials.control - A.trim).max() <= 400 * RPM
    speed = [U0]
    for n in rev_per_s[:-1]:
        speed.append(naive_rk4(lambda u, n=n: surge_rate(u, n), speed[-1], 0.01))
    noise = trials.measured[0] - np.column_stack([speed, surge_rate(np.array(speed), rev_per_s)])
    assert noise.std() == pytest.approx(0.1, rel=0.05)
    assert abs(noise.mean()) < 4 * 0.1 / np.sqrt(3000)


@pytest.mark.thorough
def test_tables_1_and_2():
    """Over 100 seeds: the independently measured 0.430, 0.271, 0.114 within 5 %, and near-equal filters."""
    runs = run_all(A, 100)
    assert sum(int(np.asarray(run.trace.failures).sum()) for run in runs.values()) == 0
    sds = printed_units(A, runs["SRUKF"].trace.sds[:, -1, 1:]).mean(0)
    assert sds == pytest.approx([0.430, 0.271, 0.114], rel=0.05)
    errors = np.array([rms_error(A, runs[name]) for name in TABLE_1])
    assert np.ptp(errors, axis=0) == pytest.approx(0, abs=0.02)
    assert errors[2, 0] == pytest.approx(0.395, rel=4 / np.sqrt(200))
    np.testing.assert_allclose(runs["UKF"].trace.means, runs["SRUKF"].trace.means, atol=1e-6 * abs(PRINTED["T_nabsn"]))
    first, second = table_1(A, runs), table_2(A, runs)
    assert first.verdict == "reproduced in shape"
    assert "not the same" in second.because
    assert {number.name: number.found for number in second.numbers}["share of clipping in the first 5 s"] > 0.9
