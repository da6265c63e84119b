"""The square-root filter beside the covariance form on the paper's own problem: a vague prior, and 6000 samples."""

import numpy as np
import pytest

from seatrial.filters.run import run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.numerics.gaussian import independent
from seatrial.numerics.sigma_points import UnscentedRule
from seatrial.vehicles.discretise import discretise
from tests.cases import N0, RPM, SCALES, THRUST, U0, X_U, X_UU, paper_model, surge_rate

INITIAL = independent([U0, 0.75 * X_U, 0.75 * X_UU, 0.75 * THRUST], np.sqrt([1.0, 1e5, 1e5, 10.0]))
STEP = np.full(6000, 0.01)


def paper_space():
    process_sd, measurement_sd = np.sqrt([1e-6, 1e-7, 1e-7, 1e-10]), np.array([0.1, 0.1])
    return discretise(paper_model(), ("u", "udot"), INITIAL, process_sd, measurement_sd, SCALES)


def noise_free_trial(amplitude_rpm, period):
    """Control and exact measurement of u and udot under a doublet, by Euler."""
    doublet = Family("n", N0, duration=60.0, active=40.0, sample_time=0.01)
    control = np.asarray(doublet.signal(amplitude_rpm * RPM, period, doublet.time()))
    u, measured = U0, []
    for n in control / (2 * np.pi):
        rate = surge_rate(u, n)
        measured.append((u, rate))
        u = u + 0.01 * rate
    return control[:, None], np.array(measured)


@pytest.mark.proof
@pytest.mark.parametrize(("alpha", "tolerance"), [(1.0, 2e-8), (1e-3, 1e-5)])
def test_square_root_and_covariance_form_agree(alpha, tolerance):
    control, exact = noise_free_trial(200, 10.0)
    measurement = exact + 0.1 * np.random.default_rng(1).normal(size=exact.shape)
    rule = UnscentedRule(alpha)
    one = run_filter(SquareRootUnscentedKalmanFilter(rule), paper_space(), control, measurement, STEP)
    two = run_filter(UnscentedKalmanFilter(rule), paper_space(), control, measurement, STEP)
    assert int(one.failures) == int(two.failures) == 0
    for a, b in ((one.means, two.means), (one.sds, two.sds)):
        assert np.max(np.abs(a - b) / np.abs(b).max(axis=0)) <= tolerance
