"""Every filter against its textbook form, on the surge trial with all kinds of gaps."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints
from filterpy.kalman import UnscentedKalmanFilter as PeerFilter

from seatrial.filters.belief import Masked, whiten
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import filter_within, run_filter
from seatrial.filters.square_root import LargeUnscentedKalmanFilter, SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.numerics.sigma_points import UnscentedRule
from tests.filters import textbook
from tests.filters.surge_trial import GAPS, MEAN, SD, surge_problem, surge_space, surge_trial

RULES = {"symmetric": (1.0, 2.0, 0.0), "small kappa": (1.0, 2.0, -1.0), "negative weight": (0.5, 2.0, 0.0)}
LOWER, UPPER = np.array([0.0, -3.2, 0.03]), np.array([np.inf, -1.6, 0.08])
BOUNDS = tuple(zip(LOWER.tolist(), UPPER.tolist(), strict=True))


def methods():
    yield "extended", ExtendedKalmanFilter(), textbook.extended, {}
    for name, rule in RULES.items():
        settings = dict(zip(("alpha", "beta", "kappa"), rule, strict=True))
        yield f"unscented, {name}", UnscentedKalmanFilter(UnscentedRule(*rule)), textbook.unscented, settings
        if name != "small kappa":
            square_root = SquareRootUnscentedKalmanFilter(UnscentedRule(*rule))
            yield f"square root, {name}", square_root, textbook.unscented, settings
            yield f"on arrays, {name}", LargeUnscentedKalmanFilter(UnscentedRule(*rule)), textbook.unscented, settings
    yield "constrained", SquareRootUnscentedKalmanFilter(bounds=BOUNDS), textbook.unscented, {"bounds": (LOWER, UPPER)}


METHODS = {name: rest for name, *rest in methods()}
CONTROL, COMPLETE, STEP = surge_trial()
MEASUREMENTS = np.stack([gap(COMPLETE) for gap in GAPS.values()])


@cache
def traces(name):
    """All kinds of gaps as one batch, each trial one lane."""
    return jax.vmap(lambda y: run_filter(METHODS[name][0], surge_space(), CONTROL, y, STEP))(MEASUREMENTS)


def lane(batch, gaps):
    return jax.tree.map(lambda x: x[list(GAPS).index(gaps)], batch)


def assert_agree(trace, run, tolerance):
    covs = np.asarray(trace.final.cov)
    assert int(trace.failures) == 0
    assert np.allclose(trace.means, run.means, rtol=0, atol=tolerance * np.abs(run.means).max(axis=0))
    assert np.allclose(trace.sds, np.sqrt(np.diagonal(run.covs, axis1=1, axis2=2)), rtol=tolerance)
    assert np.allclose(covs, run.covs[-1], rtol=tolerance, atol=tolerance * np.abs(covs).max())
    assert np.allclose(trace.innovations, run.innovations, atol=tolerance, equal_nan=True)
    assert np.allclose(trace.nis, run.nis, rtol=tolerance, atol=tolerance)
    assert np.array_equal(trace.clipped, run.clipped)
    assert float(trace.log_likelihood) == pytest.approx(run.log_likelihood, rel=tolerance)


@pytest.mark.parametrize("gaps", GAPS)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.proof] * name.endswith(("kappa", "weight"))) for name in METHODS]
)
def test_equals_the_textbook(name, gaps):
    _, reference, settings = METHODS[name]
    measurement = GAPS[gaps](COMPLETE)
    trace = lane(traces(name), gaps)
    run = reference(surge_problem(), CONTROL, measurement, STEP, **settings)
    assert np.array_equal(trace.n_measured, np.isfinite(measurement).sum(axis=1))
    assert_agree(trace, run, 1e-8)
    assert (run.clipped.sum() > 0) == (name == "constrained")


def test_equals_filterpy():
    """The peer keeps its predicted points for the update; here they are redrawn after the process noise is added."""
    problem = surge_problem()
    points = MerweScaledSigmaPoints(3, 1.0, 2.0, 0.0)
    peer = PeerFilter(3, 2, 0.1, problem.observe, problem.transition, points)
    peer.x, peer.P, peer.Q, peer.R = MEAN, np.diag(SD**2), problem.process_cov, problem.measurement_cov
    means, log_likelihood = [], 0.0
    for c, y, h in zip(CONTROL, COMPLETE, STEP, strict=True):
        peer.sigmas_f = points.sigma_points(peer.x, peer.P)
        peer.update(y, hx=lambda x, c=c: problem.observe(x, c))
        means.append(peer.x)
        log_likelihood += peer.log_likelihood
        final_cov = peer.P
        peer.predict(dt=h, fx=lambda x, dt, c=c: problem.transition(x, c, dt))
    for name in ("unscented, symmetric", "square root, symmetric"):
        trace = lane(traces(name), "complete")
        assert np.allclose(trace.means, means, rtol=1e-8)
        assert np.allclose(trace.final.cov, final_cov, rtol=1e-7, atol=1e-11)
        assert float(trace.log_likelihood) == pytest.approx(log_likelihood, rel=1e-9)


@pytest.mark.parametrize("gaps", ["complete", "ends unmeasured"])
@pytest.mark.parametrize("name", ["extended", "unscented, symmetric"])
def test_one_summary_equals_its_lane_of_a_batch_of_traces(name, gaps):
    trace = lane(traces(name), gaps)
    summary = filter_within(METHODS[name][0], surge_space(), CONTROL, GAPS[gaps](COMPLETE), STEP)
    assert int(summary.failures) == 0
    assert np.allclose(summary.final.mean, trace.final.mean, rtol=1e-10)
    assert np.allclose(summary.final.cov, trace.final.cov, rtol=1e-8, atol=1e-13)
    assert float(summary.log_likelihood) == pytest.approx(float(trace.log_likelihood), rel=1e-11)


def test_residuals_are_what_is_new_in_each_channel():
    """Of channels with covariance S, each given those before it, by conditional means and variances of a normal density."""
    rng = np.random.default_rng(5)
    half = rng.normal(size=(3, 3))
    cov, miss = half @ half.T + np.eye(3), rng.normal(size=3)
    lower = np.linalg.cholesky(cov)
    channels = tuple(jnp.asarray(miss))
    masked = Masked((1.0,) * 3, (1.0,) * 3, channels, channels)
    _, update = whiten([tuple(jnp.asarray(lower[i, : i + 1])) for i in range(3)], masked)
    for i in range(3):
        gain = np.linalg.solve(cov[:i, :i], cov[:i, i])
        assert float(update.residual[i]) == pytest.approx(miss[i] - gain @ miss[:i], rel=1e-12)
        assert float(update.variance[i]) == pytest.approx(cov[i, i] - gain @ cov[:i, i], rel=1e-12)
