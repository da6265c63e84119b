import jax
import numpy as np
import pytest

from seatrial.estimation.mode import Mode
from seatrial.estimation.priors import Normal, Uniform
from seatrial.selection.laplace import _Check, _complaints, active_bounds, laplace_evidence
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


@pytest.mark.parametrize(
    ("check", "words"),
    [
        (_Check(0.29, 0.05, 300.0, 0.2), ""),
        (_Check(0.31, 0.05, 300.0, 0.2), "by +0.31 nats"),
        (_Check(-0.31, 0.05, 300.0, 0.2), "by -0.31 nats"),
        (_Check(0.21, 0.0, 300.0, 0.2), "by +0.21 nats"),
        (_Check(0.0, 0.05, 19.0, 0.2), "19 count"),
        (_Check(0.0, 0.05, 21.0, 0.69), ""),
        (_Check(0.0, 0.05, 21.0, 0.71), "Pareto k 0.71"),
        (_Check(0.5, 0.05, 19.0, 0.2), "19 count"),
    ],
)
def test_complaints_from_both_sides(check, words):
    """A correction counts from 0.2 nats and two of its errors on."""
    said = _complaints(MODE, check, ())
    assert len(said) == bool(words)
    assert words in "".join(said)


@pytest.mark.parametrize(("place", "named"), [(0.85, True), (0.75, False), (-0.85, True), (-0.75, False), (0.0, False)])
def test_a_posterior_runs_into_a_bound_that_two_deviations_nearly_reach(place, named):
    """In a box from -1 to 1 about a mode at 0.5: less than a tenth of the way to the bound is left after two deviations."""
    box = posterior({"a": Uniform(-1.0, 1.0), "b": Normal(0.0, 1.0)}, lambda v, data: 0.0)
    z = np.asarray(box.unconstrain(np.array([0.5 * np.sign(place), 0.0])))
    end = float(
        np.asarray(box.unconstrain(np.array([0.5 * np.sign(place) + (abs(place) + 0.1) * 0.5 * np.sign(place), 0.0])))[
            0
        ]
    )
    sd = abs(end - z[0]) / 2 if place else 0.1
    mode = MODE._replace(z=z, cov=np.diag([sd**2, 1.0]), values=np.asarray(box.constrain(z)))
    assert active_bounds(box, mode) == (("a",) if named else ())


def test_diagnostics_are_those_of_the_check():
    """With the mode given nothing is searched for; the correction is what importance draws find beyond the approximation."""
    target, _ = linear(2)
    found = laplace_evidence(target, KEY, draws=2000)
    assert found.diagnostics["correction"] == pytest.approx(0.0, abs=4 * found.diagnostics["correction_error"])
    assert 0 < found.diagnostics["correction_error"] < 0.05
    assert 1000 < found.diagnostics["ess"] <= 2000
    assert found.diagnostics["k_hat"] < 0.5
    assert found.diagnostics["flat"] is False
