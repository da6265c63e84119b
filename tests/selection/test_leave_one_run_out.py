"""Leave one run out against the closed form of a vehicle that is linear in its unknowns, quadrature, and exact refits."""

from functools import cache

import jax
import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from seatrial.core.errors import InputError
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import posterior_of_density
from seatrial.estimation.prediction.posterior_by_run import (
    BLOCKS,
    expand_runs,
    marginal_log_likelihoods,
    split_runs,
    weigh_runs,
)
from seatrial.estimation.priors import Normal
from seatrial.sampling.target import evaluate
from seatrial.selection import leave_one_run_out as module
from seatrial.selection.leave_one_run_out import leave_one_run_out
from tests.selection.run_cases import N, drifting_posterior, exact_left_out, linear_runs, posterior_of_runs

KEY = jax.random.key(3)


@cache
def found(count=5, **options):
    return leave_one_run_out(posterior_of_runs(linear_runs(count)), key=KEY, **options)


def test_closed_form():
    """The force per speed and the constant force enter linearly, and so do the runs' own starts."""
    exact = exact_left_out(linear_runs(5))
    left = np.array([run.elpd for run in found().runs])
    errors = np.array([run.error for run in found().runs])
    assert errors.max() < 0.25
    assert np.all(np.abs(left - exact) < 4 * errors + 0.05)
    assert found().k_hat < 0.7
    assert not found().status
    assert found().std_error == pytest.approx(np.sqrt(5) * np.std([run.elpd for run in found().runs], ddof=1))


@pytest.mark.proof
def test_refits_agree(monkeypatch):
    """Draws are weighed by the density of all proposals that they came from, whose shares sum to one however often they are refitted."""
    shares, density = [], module.log_mixture

    def noted(proposals, z):
        shares.append((len(proposals), sum(one.share for one in proposals)))
        return density(proposals, z)

    monkeypatch.setattr(module, "log_mixture", noted)
    again = leave_one_run_out(posterior_of_runs(linear_runs(5)), key=KEY, max_k_hat=-np.inf, draws=256)
    assert max(count for count, _ in shares) > 5
    np.testing.assert_allclose([total for _, total in shares], 1.0, rtol=1e-12)
    assert all(run.refitted for run in again.runs)
    assert not any(run.refitted for run in found().runs)
    for one, other in zip(found().runs, again.runs, strict=True):
        assert one.elpd == pytest.approx(other.elpd, abs=4 * np.hypot(one.error, other.error) + 0.01)


@pytest.mark.proof
def test_runs_add_up():
    joint = posterior_of_runs(linear_runs(4))
    runs, mode = split_runs(joint), find_mode(joint, key=0)
    there = expand_runs(runs, mode.z)
    whole = weigh_runs(there, np.ones(4))
    assert whole.value == pytest.approx(mode.log_density, rel=1e-12)
    np.testing.assert_allclose(-whole.hessian, mode.precision, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(whole.gradient, 0.0, atol=1e-4)


def test_a_linear_run_is_integrated_without_error():
    """A linear run is normal in its own start: draws about the ridge all have the same weight, wherever they lie."""
    joint = posterior_of_runs(linear_runs(3))
    runs, mode = split_runs(joint), find_mode(joint, key=0)
    shared = mode.z[runs.shared] + 0.3 * np.random.default_rng(0).normal(size=(4, runs.shared.size))
    one, other = (
        marginal_log_likelihoods(runs, mode, expand_runs(runs, mode.z), shared, np.random.default_rng(seed))
        for seed in (1, 2)
    )
    np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.proof
def test_own_parameters_are_integrated_out():
    """A run's own deviation of its damping is no linear unknown: the mean of many estimates is that by quadrature."""
    joint = posterior_of_runs(linear_runs(3), varying=True)
    runs, mode = split_runs(joint), find_mode(joint, key=0)
    there = expand_runs(runs, mode.z)
    shared = mode.z[runs.shared] + 0.3 * np.random.default_rng(0).normal(size=(3, runs.shared.size))
    many = marginal_log_likelihoods(runs, mode, there, np.repeat(shared, 256, 0), np.random.default_rng(1))
    table = logsumexp(many.reshape(len(shared), 256, -1), 1) - np.log(256)
    one = runs.parts[1]
    assert [name.partition("[")[0] for name in one.names[runs.shared.size :]] == ["dev_X_u"]
    own = np.linspace(-6.0, 6.0, 512)
    for z, expected in zip(shared, table[:, 1], strict=True):
        places = np.column_stack([np.tile(z, (own.size, 1)), own])
        heights = evaluate(one, places) - np.asarray(jax.vmap(one.log_prior)(places)) + stats.norm.logpdf(own)
        assert np.log(np.trapezoid(np.exp(heights - expected), own)) == pytest.approx(0.0, abs=0.1)


@pytest.mark.proof
def test_without_own_parameters():
    """Starts as measured: what a run says of the shared parameters is its likelihood."""
    joint = posterior_of_runs(linear_runs(3), free_start=False)
    runs, mode = split_runs(joint), find_mode(joint, key=0)
    table = marginal_log_likelihoods(runs, mode, expand_runs(runs, mode.z), mode.z[None], np.random.default_rng(0))
    whole = float(joint.log_likelihood(mode.z))
    assert table.shape == (1, 3)
    assert table.sum() == pytest.approx(whole, rel=1e-12)


def test_bands_and_scores():
    assert found().bands["u"].runs == 5
    assert found().mean_score("u", "coverage") == pytest.approx(0.9, abs=0.08)
    assert found().bands["u"].level in ("pass", "unjudged")


def test_fewer_draws_give_the_same_score_and_predict_as_often_as_they_weigh(monkeypatch):
    """Systematic resampling takes each draw its weight's share of times, rounded up or down."""
    wanted = found().elpd
    drawn, taken, draw, predict = [], [], module._draw, module.predict_fold
    monkeypatch.setattr(module, "_draw", lambda *args: drawn.append(draw(*args)) or drawn[-1])
    monkeypatch.setattr(module, "predict_fold", lambda runs, r, z, key: taken.append(z) or predict(runs, r, z, key))
    assert found(draws=256).elpd == pytest.approx(wanted, abs=1.0)
    ((known, (*without, _), _),) = drawn
    for (weights, _), z in zip(without, taken, strict=True):
        times = (z[None] == known.z[:, None]).all(2).sum(1)
        assert times.sum() == len(z) == module.PREDICTION_DRAWS
        assert (np.abs(times - len(z) * np.exp(weights) / np.exp(weights).sum()) < 1).all()


@pytest.mark.parametrize("count", [1, 2])
def test_blocks_of_few_runs_in_closed_form(count):
    """A block given all before and after it: the start is shared by all blocks of a run."""
    runs = linear_runs(count)
    left = leave_one_run_out(posterior_of_runs(runs), key=KEY)
    exact = exact_left_out(runs, blocks=BLOCKS // count)
    assert len(left.runs) == BLOCKS
    assert left.runs[-1].label == f"run {count - 1}, block {BLOCKS // count}"
    for one, value in zip(left.runs, exact, strict=True):
        assert one.elpd == pytest.approx(value, abs=4 * one.error + 0.05)
        assert one.scores["u"].samples == N // (BLOCKS // count)


def test_masked_trials_have_the_density_of_records_without_these_samples():
    """Drifting errors remember across the gap; arrays of all blocks have one shape."""
    joint = drifting_posterior()
    runs = split_runs(joint)
    z = 0.1 * np.arange(joint.dim)
    assert len({str(jax.tree.map(np.shape, part.data)) for part in runs.parts}) == 1
    assert float(runs.parts[-1].log_likelihood(z)) == pytest.approx(float(joint.log_likelihood(z)), rel=1e-12)
    kept = runs.folds[2].inside
    expected = drifting_posterior(np.flatnonzero(kept)).log_likelihood(z)
    assert float(runs.parts[2].log_likelihood(z)) == pytest.approx(float(expected), rel=1e-12)


def test_refusals():
    with pytest.raises(InputError, match="make_posterior"):
        leave_one_run_out(posterior_of_density(lambda values: -(values["a"] ** 2), {"a": Normal(0.0, 1.0)}), key=KEY)
