import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, stats

from seatrial.core.errors import NumericalError
from seatrial.estimation.priors import Normal, Uniform
from seatrial.sampling.tempered_smc import SMCResult, sample_tempered_smc
from seatrial.selection.evidence import EvidenceSettings, combine_runs, smc_evidence
from tests.estimation_cases import (
    GOLDEN_LOG_EVIDENCE,
    golden_posterior,
    posterior,
    short_posterior,
)
from tests.selection.targets import linear


def normal_below(values, data):
    """Normal density of two parameters where their sum is below a limit, 0 elsewhere."""
    centre, sd, limit = data
    c = jnp.stack([values["a"], values["b"]])
    density = jnp.sum(-0.5 * ((c - centre) / sd) ** 2 - jnp.log(sd) - 0.5 * jnp.log(2 * jnp.pi))
    return jnp.where(jnp.sum(c) < limit, density, -jnp.inf)


def unit_square(centre, sd, limit):
    data = tuple(map(jnp.asarray, (centre, sd, limit)))
    return posterior({"a": Uniform(0.0, 1.0), "b": Uniform(0.0, 1.0)}, normal_below, data)


def box():
    """A normal likelihood cut by uniform priors: a product of differences of the error function."""
    centre, sd = np.array([0.9, 0.0]), np.array([0.2, 0.01])
    inside = stats.norm(centre, sd).cdf(1) - stats.norm(centre, sd).cdf(0)
    return unit_square(centre, sd, np.inf), float(np.log(inside).sum())


def half_forbidden():
    """Zero likelihood wherever a + b > 0.6, by quadrature over a."""
    a, b = stats.norm(0.3, 0.01), stats.norm(0.4, 0.3)
    exact, _ = integrate.quad(lambda x: a.pdf(x) * (b.cdf(0.6 - x) - b.cdf(0)), 0.2, 0.4, epsabs=1e-12)
    return unit_square([0.3, 0.4], [0.01, 0.3], 0.6), np.log(exact)


def parabola(width=0.05):
    """A ridge a = b^2 under normal priors, thin beside its bend: evidence by a closed form in a and quadrature in b."""

    def likelihood(values, data):
        return -0.5 * ((values["a"] - values["b"] ** 2) / width) ** 2

    along = stats.norm(0.0, np.hypot(3.0, width))
    exact = np.sqrt(2 * np.pi) * width * integrate.quad(lambda b: along.pdf(b**2) * stats.norm.pdf(b), -8.0, 8.0)[0]
    return posterior({"a": Normal(0.0, 3.0), "b": Normal(0.0, 1.0)}, likelihood), np.log(exact)


def short_surge():
    """Two drag coefficients from a short trial, a ridge of correlation -0.9999, by quadrature on a grid."""
    target = short_posterior("X_u", "X_uabsu")
    axes = [np.linspace(*p.prior.bounds, n) for p, n in zip(target.parameters, (201, 2001), strict=True)]
    a, b = (jnp.asarray(x.ravel()) for x in np.meshgrid(*axes, indexing="ij"))
    logs = jax.jit(jax.vmap(lambda a, b: target.likelihood({"X_u": a, "X_uabsu": b}, target.data)))(a, b)
    top, volume = float(logs.max()), np.prod([np.ptp(x) for x in axes])
    table = np.exp(np.asarray(logs).reshape(201, 2001) - top)
    return target, top + np.log(np.trapezoid(np.trapezoid(table, axes[1]), axes[0]) / volume)


@pytest.mark.parametrize(
    "problem",
    [
        lambda: linear(2),
        pytest.param(lambda: linear(5), marks=pytest.mark.proof),
        box,
        half_forbidden,
    ],
    ids=["linear 2", "linear 5", "box", "half forbidden"],
)
def test_known_evidence(problem):
    target, exact = problem()
    found = smc_evidence(target, jax.random.key(1))
    assert found.status == ""
    assert 0 < found.std_error < 0.2
    assert abs(found.log_value - exact) < 4 * found.std_error


@pytest.mark.proof
def test_golden_evidence():
    """Other methods weigh the other two models in test_importance.py."""
    found = smc_evidence(golden_posterior("M-1"), jax.random.key(1), EvidenceSettings(repeats=2))
    assert found.status == ""
    assert abs(found.log_value - GOLDEN_LOG_EVIDENCE["M-1"]) < min(4 * found.std_error, 0.3)


@pytest.mark.proof
def test_stated_errors_are_honest():
    """Of 40 errors, 2 should exceed 1.96 of what is stated: 7 or more would be a chance of 0.3 %."""
    target, exact = linear(2)
    found = [smc_evidence(target, jax.random.key(100 + i)) for i in range(40)]
    errors = np.array([evidence.log_value - exact for evidence in found])
    stated = np.array([evidence.std_error for evidence in found])
    assert (np.abs(errors) > 1.96 * stated).sum() < 7
    assert np.sqrt((errors**2).mean() / (stated**2).mean()) == pytest.approx(0.7, abs=0.3)


def test_no_finite_likelihood():
    with pytest.raises(NumericalError, match="Narrow the prior"):
        smc_evidence(unit_square([0.5, 0.5], [0.1, 0.1], -1.0), jax.random.key(0))


def test_progress_runs_once_over_all_repeats():
    seen = []
    target, _ = linear(2)
    smc_evidence(target, jax.random.key(0), EvidenceSettings(repeats=2), lambda done, total: seen.append(done / total))
    assert seen == sorted(seen)
    assert seen[-1] == 1


def runs(*logs, acceptance=0.3, alive=1.0, expected_variance=0.0):
    temperatures, accepted = np.array([0.1, 1.0]), np.array([0.4, acceptance])
    return [SMCResult(log, np.empty((9, 1)), temperatures, accepted, alive, expected_variance) for log in logs]


def test_combination_by_hand():
    """Z of 2, 3 and 7: mean 4, variance 7; Student's t of 2 degrees is 4.303 at 97.5 %, the normal 1.960."""
    found = combine_runs(runs(*np.log([2.0, 3.0, 7.0])))
    assert found.log_value == pytest.approx(np.log(4.0), abs=1e-12)
    assert found.std_error == pytest.approx(np.sqrt(7 / 3) / 4 * 4.302653 / 1.959964, rel=1e-6)
    assert found.diagnostics["temperatures"] == [2, 2, 2]


def test_repeats_that_agree_by_chance_do_not_shrink_the_error():
    """Two equal runs, each of expected variance 0.01: pooled 4 x 0.01 / 5 over two repeats, t of 5 degrees 2.571."""
    found = combine_runs(runs(1.0, 1.0, expected_variance=0.01))
    assert found.std_error == pytest.approx(np.sqrt(0.008 / 2) * 2.570582 / 1.959964, rel=1e-6)


@pytest.mark.proof
def test_expected_variance_is_near_the_measured_one():
    """Of 40 runs of a well-behaved problem: the ratio of variances has a standard error of 22 %."""
    target, _ = linear(2)
    found = [sample_tempered_smc(target, jax.random.key(i), EvidenceSettings().smc) for i in range(40)]
    measured = np.var([run.log_evidence for run in found], ddof=1)
    assert 0.3 < np.mean([run.expected_variance for run in found]) / measured < 3.0


@pytest.mark.parametrize("shift", [-7000.0, 7000.0])
def test_combination_of_extreme_logs(shift):
    base, shifted = combine_runs(runs(0.1, 0.3, 0.2)), combine_runs(runs(*(shift + np.array([0.1, 0.3, 0.2]))))
    assert shifted.log_value - shift == pytest.approx(base.log_value, abs=1e-9)
    assert shifted.std_error == pytest.approx(base.std_error, rel=1e-9)


@pytest.mark.parametrize("given", [runs(), runs(1.0)])
def test_one_run_has_no_error(given):
    with pytest.raises(NumericalError, match="set repeats to 2 or more"):
        combine_runs(given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (runs(0.0, 1.40), ""),
        (runs(0.0, 1.43), "repeats differ by 1.0 nats: use more particles, or narrower priors"),
        (runs(1.0, 4.0, acceptance=0.02), "; "),
        (runs(1.0, 1.1, acceptance=0.051), ""),
        (runs(1.0, 1.1, acceptance=0.049), "accepted only 5% of the time: use more particles, or narrower priors"),
        (runs(1.0, 1.1, alive=0.051), ""),
        (runs(1.0, 1.1, alive=0.049), "only 4.9% of the prior can be simulated"),
    ],
)
def test_status_from_both_sides(given, words):
    found = combine_runs(given)
    assert words in found.status
    assert bool(words) == bool(found.status)
    logs = [run.log_evidence for run in given]
    assert found.diagnostics["log_values"] == logs
    assert found.diagnostics["spread"] == pytest.approx(np.std(logs, ddof=1))
    assert found.diagnostics["lowest_acceptance"] == min(given[0].acceptance)
    assert found.diagnostics["alive"] == given[0].alive
