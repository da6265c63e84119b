"""Leave-future-out against the closed form of a linear-Gaussian series, exact refits, and records of a surge vehicle."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.pointwise import pointwise_log_likelihood
from seatrial.estimation.priors import Normal, Uniform
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.selection.criteria import mean_error
from seatrial.selection.importance import ImportanceSettings, importance_evidence, importance_sample
from seatrial.selection.leave_future_out import _complaints, block_edges, compare_futures, leave_future_out, past_of
from tests.cases import TRUTH, U0, paper_model
from tests.estimation_cases import make_trial, naive_doublets, naive_speed, posterior

N, SD, PRIOR_SD = 120, 0.5, 2.0
EDGES = np.append(np.arange(20, N, 5), N)
"""Twenty blocks of five rows, after twenty that are never predicted."""
KEY = jax.random.key(0)


def series(d: int):
    """Rows of a slowly changing design, so that later blocks teach something new, and what was measured."""
    rng = np.random.default_rng(9)
    t = np.linspace(0, 1, N)
    design = np.stack([np.ones(N), t, np.sin(9 * t), t**2][:d], 1)
    full = np.stack([np.ones(N), t, np.sin(9 * t), t**2], 1)
    return design, full @ [0.5, -1.0, 0.8, 1.5] + SD * rng.normal(size=N)


def masked_log_likelihood(values, data):
    design, measured, present = data
    residual = (measured - design @ jnp.stack(list(values.values()))) / SD
    return jnp.sum(present * (-0.5 * residual**2 - jnp.log(SD) - 0.5 * jnp.log(2 * jnp.pi)))


def past_of_series(d: int):
    design, measured = map(jnp.asarray, series(d))

    def past(time):
        data = (design, measured, (jnp.arange(N) < time).astype(float))
        return posterior({f"c{i}": Normal(0.0, PRIOR_SD) for i in range(d)}, masked_log_likelihood, data)

    return past


def exact_blocks(d: int):
    """Log density of each block given all rows before it, from the joint normal of all rows."""
    design, measured = series(d)
    joint = stats.multivariate_normal
    cov = PRIOR_SD**2 * design @ design.T + SD**2 * np.eye(N)
    upto = [float(joint(np.zeros(n), cov[:n, :n]).logpdf(measured[:n])) for n in EDGES]
    return np.diff(upto)


@cache
def predicted(d: int, max_k_hat=0.7, seed=0):
    return leave_future_out(past_of_series(d), EDGES, jax.random.key(seed), max_k_hat=max_k_hat)


@pytest.mark.proof
@pytest.mark.parametrize("d", [2, 4])
def test_closed_form(d):
    found, exact = predicted(d), -2 * exact_blocks(d)
    assert 0 < found.criterion.value.error < 0.5
    assert abs(found.criterion.value.value - exact.sum()) < 4 * found.criterion.value.error
    np.testing.assert_allclose(found.criterion.pointwise, exact, atol=0.5)
    assert found.criterion.std_error == pytest.approx(np.sqrt(20) * exact.std(ddof=1), rel=0.05)
    assert found.criterion.k_hat.max() <= 0.7
    assert found.criterion.status == ""


@pytest.mark.proof
def test_refits_happen_only_when_needed():
    """The posterior of the right model shrinks, that of the wrong one also moves: the draws it had soon count no more."""
    assert predicted(4).refits[0] == 20.0
    assert 1 < len(predicted(4).refits) < len(predicted(2).refits) < 10


@pytest.mark.proof
def test_exact_refits_agree():
    often, seldom = predicted(4, -np.inf), predicted(4)
    assert often.refits == tuple(map(float, EDGES[:-1]))
    np.testing.assert_allclose(often.criterion.pointwise, -2 * exact_blocks(4), atol=0.1)
    difference = often.criterion.value.value - seldom.criterion.value.value
    assert abs(difference) < 4 * np.hypot(often.criterion.value.error, seldom.criterion.value.error)


@pytest.mark.proof
def test_the_monte_carlo_error_is_honest():
    """Root mean square of 24 errors over what is stated is 1 with an error of 0.14, of which 4 are allowed."""
    exact = -2 * exact_blocks(4).sum()
    small = ImportanceSettings(draws=2048, pilot=1024)
    found = [leave_future_out(past_of_series(4), EDGES, jax.random.key(s), small).criterion.value for s in range(24)]
    assert np.abs(np.sqrt(np.mean([((x.value - exact) / x.error) ** 2 for x in found])) - 1) < 0.58


def test_difference_of_two_models():
    """The parabola is needed, and its error comes from the differences of the blocks."""
    found, exact = compare_futures(predicted(4), predicted(2)), -2 * (exact_blocks(4) - exact_blocks(2))
    assert found.delta == pytest.approx(exact.sum(), abs=1.0)
    assert found.std_error == pytest.approx(np.sqrt(20) * exact.std(ddof=1), rel=0.1)
    assert "first model predicts better: leave-future-out differs by" in found.verdict
    with pytest.raises(InputError, match="the same blocks"):
        compare_futures(predicted(2), leave_future_out(past_of_series(2), EDGES[:5], KEY))


def test_what_cannot_be_predicted_is_said():
    few = leave_future_out(past_of_series(2), EDGES[:4], KEY)
    assert "only 3 blocks" in few.criterion.status
    for edges in ([0.0, 5.0], [0.0, 5.0, 5.0]):
        with pytest.raises(InputError, match="three increasing times"):
            leave_future_out(past_of_series(2), edges, KEY)

    def past(time):
        def only_early(values, data):
            return jnp.where(data[2].sum() > 20, -jnp.inf, masked_log_likelihood(values, data))

        return posterior(
            {p.name: p.prior for p in past_of_series(2)(time).parameters}, only_early, past_of_series(2)(time).data
        )

    with pytest.raises(NumericalError, match="measured after 20 s"):
        leave_future_out(past, EDGES, KEY)


@cache
def trials():
    """Two surge trials of 0.1 s steps, 16 and 12 s long, the second with a hole."""
    rng, made = np.random.default_rng(11), []
    for label, n in (("a", 160), ("b", 120)):
        time = np.arange(n) * 0.1
        rev = naive_doublets(time, 300, 4, active=12)
        speed = naive_speed(rev, np.full(n, 0.1)) + 0.03 * rng.normal(size=n)
        if label == "b":
            speed[60:85] = np.nan
        made.append(make_trial(time, rev, label, u=speed))
    return tuple(made)


def surge_posterior(records, sensor="u", **more):
    likelihood, data = output_error(paper_model(), records, [sensor], [[U0]] * len(records))
    priors = {name: Uniform(*sorted((0.2 * x, 3 * x))) for name, x in TRUTH.items()} | {"sigma_u": Uniform(0.0, 0.2)}
    return posterior(priors | more, likelihood, data)


def test_blocks_of_records():
    """Clocks run side by side; a block in which nothing was measured joins the next."""
    edges = block_edges(trials(), 4.0, 1.0)
    np.testing.assert_allclose(edges[:-1], np.arange(4, 16))
    assert 15.9 < edges[-1] < 15.91
    np.testing.assert_allclose(block_edges(trials()[1:], 4.0, 1.0)[:5], [4, 5, 6, 9, 10])
    np.testing.assert_allclose(block_edges(trials(), 0.5, 0.25)[:3], [0.5, 0.75, 1.0])
    for first, block in ((0.0, 1.0), (4.0, 0.0), (15.0, 5.0)):
        with pytest.raises(InputError, match="at least two blocks"):
            block_edges(trials(), first, block)


def test_cut_records_keep_their_controls_and_parameters():
    past = past_of(surge_posterior, trials())
    assert past(4.0).names == past(99.0).names
    draws = np.array([[[*TRUTH.values(), 0.03]]])
    whole, early = (pointwise_log_likelihood(past(t), draws)[0, 0] for t in (99.0, 4.0))
    assert early.size == 80
    np.testing.assert_allclose(early, np.concatenate([whole[:40], whole[160:200]]), rtol=1e-12)


@pytest.mark.proof
def test_blocks_of_a_vehicle_add_up_to_evidence():
    """The sum is the log evidence of all less that of the first stretch, each found by itself."""
    past = past_of(surge_posterior, trials())
    found = leave_future_out(past, block_edges(trials(), 4.0, 1.0), KEY)
    whole, early = (importance_evidence(past(t), jax.random.key(1)) for t in (99.0, 4.0))
    expected = -2 * (whole.log_value - early.log_value)
    error = np.hypot(found.criterion.value.error, 2 * np.hypot(whole.std_error, early.std_error))
    assert abs(found.criterion.value.value - expected) < 4 * error
    assert found.criterion.pointwise.size == 12
    assert error < 0.5


@pytest.mark.proof
def test_long_chains_and_weights_agree():
    """The first block averaged over draws of the first stretch, resampled from its importance weights in twenty batches."""
    past, edges = past_of(surge_posterior, trials()), block_edges(trials(), 4.0, 2.0)
    drawn = importance_sample(past(4.0), jax.random.key(5))
    chosen = np.random.default_rng(0).choice(
        drawn.z.shape[0], 4000, p=np.exp(drawn.smoothed) / np.exp(drawn.smoothed).sum()
    )
    draws = np.asarray(past(4.0).constrain(jnp.asarray(drawn.z[chosen])))[None]
    block = pointwise_log_likelihood(past(float(edges[1])), draws).sum(2) - pointwise_log_likelihood(
        past(4.0), draws
    ).sum(2)
    scale = block.max()
    mean, error = np.exp(block - scale).mean(), mean_error(np.exp(block - scale))
    found = leave_future_out(past, edges, KEY).criterion.pointwise[0]
    assert abs(found + 2 * (np.log(mean) + scale)) < 5 * 2 * error / mean + 0.02


@pytest.mark.proof
def test_coloured_residuals_remember_across_the_edge():
    """The block's density is conditional on the last residual before it: evidence again tells."""

    coloured = partial(surge_posterior, sensor=Sensor("u", "coloured"), tau_u=Uniform(0.01, 2.0))
    past = past_of(coloured, trials()[:1])
    found = leave_future_out(past, block_edges(trials()[:1], 5.0, 1.0), KEY)
    whole, early = (importance_evidence(past(t), jax.random.key(1)) for t in (99.0, 5.0))
    expected = -2 * (whole.log_value - early.log_value)
    error = np.hypot(found.criterion.value.error, 2 * np.hypot(whole.std_error, early.std_error))
    assert abs(found.criterion.value.value - expected) < 4 * error


@pytest.mark.parametrize(
    ("k_hat", "most", "said"),
    [
        (np.full(10, 0.69), 0.7, ""),
        (np.full(9, 0.5), 0.7, "only 9 blocks"),
        (np.append(np.full(9, 0.5), 0.71), 0.7, "predictions of 1 of 10 blocks depend"),
        (np.append(np.full(9, 0.5), 0.71), 0.5, "k-hat up to 0.71"),
        (np.append(np.full(9, 0.5), 0.71), 0.75, ""),
        (np.append(np.full(9, 0.5), np.nan), 0.7, "1 of 10"),
    ],
)
def test_complaints_from_both_sides(k_hat, most, said):
    found = _complaints(k_hat, most)
    assert len(found) == bool(said)
    assert said in "".join(found)
