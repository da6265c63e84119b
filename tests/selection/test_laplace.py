import jax
import numpy as np
import pytest

from seatrial.estimation.mode import Mode
from seatrial.estimation.priors import Normal
from seatrial.selection.laplace import _Check, _complaints, laplace_evidence
from tests.estimation_cases import posterior
from tests.selection.targets import correlated, far_peaks, linear
from tests.selection.test_evidence import box, half_forbidden

KEY = jax.random.key(1)
MODE = Mode(np.zeros(1), np.eye(1), np.eye(1), 0.0, 0.0, np.zeros(1), np.ones(1), False)


@pytest.mark.parametrize(
    "problem",
    [lambda: linear(2), lambda: correlated(5)],
    ids=["linear 2", "correlated 5"],
)
def test_exact_for_normal_posteriors(problem):
    target, exact = problem()
    found = laplace_evidence(target, KEY)
    assert found.status == ""
    assert np.isnan(found.std_error)
    assert found.log_value == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(("problem", "name"), [(box, "a"), (half_forbidden, "b")])
def test_parameter_at_its_bound_is_named(problem, name):
    target, _ = problem()
    found = laplace_evidence(target, KEY)
    assert found.diagnostics["at_bound"] == [name]
    assert f"the posterior of {name} runs into the end of the prior" in found.status


def test_flat_topped_posterior_is_corrected():
    """The likelihood exp(-20 a^4) has no curvature at its top: against quadrature."""
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: -20.0 * v["a"] ** 4)
    z = np.linspace(-3.0, 3.0, 200_001)
    exact = np.log(np.trapezoid(np.exp(-0.5 * z * z - 20.0 * z**4), z) / np.sqrt(2 * np.pi))
    found = laplace_evidence(target, KEY, draws=4096)
    assert abs(found.log_value + found.diagnostics["correction"] - exact) < 4 * found.diagnostics["correction_error"]
    assert "correct it by -1." in found.status


def test_far_mode_is_missed_without_a_sign():
    target, exact = far_peaks()
    found = laplace_evidence(target, KEY)
    assert found.status == ""
    assert found.log_value == pytest.approx(exact - np.log(2.0), abs=1e-3)


@pytest.mark.parametrize(
    ("mode", "check", "words"),
    [
        (MODE, _Check(0.1, 0.05, 300.0, 0.2), ""),
        (MODE._replace(flat=True), _Check(0.0, 0.05, 300.0, 0.2), "no curvature"),
        (MODE, _Check(0.5, 0.05, 300.0, 0.2), "by +0.50 nats"),
        (MODE, _Check(0.0, 0.05, 3.0, 0.2), "far from normal"),
        (MODE, _Check(0.0, 0.05, 300.0, 0.9), "Pareto k 0.90"),
        (MODE, _Check(np.nan, np.nan, 0.0, np.nan), "far from normal"),
    ],
)
def test_complaints(mode, check, words):
    said = "; ".join(_complaints(mode, check, ()))
    assert words in said
    assert bool(words) == bool(said)
