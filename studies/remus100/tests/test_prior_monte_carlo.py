import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.priors import Normal
from studies.remus100.prior_monte_carlo import (
    _pool,
    _refusal,
    draw_by_name,
    listing_one,
    prior_evidence,
)
from tests.estimation_cases import (
    GOLDEN_LOG_EVIDENCE,
    golden_posterior,
    linear_gaussian,
    posterior,
)

KEY = jax.random.key(1)
PAIR = linear_gaussian(2)


@pytest.mark.proof
def test_listing_one_is_noise():
    """The paper's setting with a fifth of its draws: one or two draws carry everything, tens of nats too low."""
    models = [golden_posterior("M-0 narrow"), golden_posterior("M-1")]
    found = listing_one(models, KEY, draws=20_000, repeats=20)
    assert found.status.startswith("no verdict")
    assert found.probability.sum(1) == pytest.approx(1.0)
    for evidence, model in zip(found.evidences, ("M-0 narrow", "M-1"), strict=True):
        assert np.median(evidence.diagnostics["ess"]) < 10
        assert np.mean(evidence.diagnostics["log_values"]) < GOLDEN_LOG_EVIDENCE[model] - 30
        assert evidence.diagnostics["spread"] > 10
    assert np.mean((found.probability[:, 0] < 0.01) | (found.probability[:, 0] > 0.99)) > 0.7


def test_known_evidence():
    """An easy problem: a likelihood a tenth of the prior wide is met by hundreds of draws."""
    easy = PAIR._replace(sd=3.0)
    found = prior_evidence(easy.posterior, KEY, draws=20_000, repeats=4)
    assert found.status == ""
    assert min(found.diagnostics["ess"]) > 400
    assert abs(found.log_value - easy.log_evidence) < 4 * found.std_error < 0.2


def test_average_by_hand():
    """Likelihoods 1 and 3 by the sign of the draw, shifted by a thousand nats: their mean, and (sum L)^2 / sum L^2."""
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: 1000.0 + jnp.where(v["a"] > 0, jnp.log(3.0), 0.0))
    above = int((draw_by_name(target, jax.random.fold_in(jax.random.fold_in(KEY, 0), 0), 500)[:, 0] > 0).sum())
    found = prior_evidence(target, KEY, draws=500)
    total, squares = 500 + 2 * above, 500 + 8 * above
    assert found.log_value - 1000 == pytest.approx(np.log(total / 500), abs=1e-9)
    assert found.diagnostics["ess"] == [pytest.approx(total**2 / squares)]
    assert found.std_error == pytest.approx(np.sqrt(squares / total**2 - 1 / 500))


def test_shared_draws_cancel():
    """The same model twice: shared draws cannot tell them apart, independent draws can by chance."""
    target = PAIR.posterior
    shared, free = (listing_one([target, target], KEY, draws=200, repeats=5, shared=s) for s in (True, False))
    assert shared.probability == pytest.approx(0.5, abs=1e-12)
    assert np.abs(free.probability - 0.5).max() > 0.01
    assert shared.status.startswith("no verdict")


def test_a_parameter_keeps_its_draws_beside_others():
    one, two = posterior({"a": Normal(0, 1)}, None), posterior({"b": Normal(0, 1), "a": Normal(0, 1)}, None)
    first, second = (np.asarray(draw_by_name(target, KEY, 100)) for target in (one, two))
    assert (first[:, 0] == second[:, 1]).all()
    assert abs(np.corrcoef(second.T)[0, 1]) < 0.4


def test_no_draw_can_be_simulated():
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: jnp.full((), -jnp.inf))
    with pytest.raises(NumericalError, match="Narrow the prior"):
        prior_evidence(target, KEY, draws=100)


@pytest.mark.parametrize("given", [{"draws": 0}, {"repeats": 0}])
def test_bad_settings(given):
    with pytest.raises(InputError, match="Listing 1"):
        listing_one([PAIR.posterior] * 2, KEY, **given)


def test_repeats_are_pooled_by_hand():
    """Mean of the likelihoods; the larger of the error that the weights have and of that the repeats show."""
    draws, ess = 1000, np.array([500.0, 800.0, 450.0])
    near, far = np.log([1.0, 1.001, 1.002]), np.log([1.0, 2.0, 3.0])
    within = np.sqrt(np.mean([1 / e - 1 / draws for e in ess]) / 3)
    one, other = (_pool(logs, ess, draws) for logs in (near, far))
    assert one.log_value == pytest.approx(np.log(1.001))
    assert one.std_error == pytest.approx(within)
    assert other.log_value == pytest.approx(np.log(2.0))
    assert other.std_error == pytest.approx(np.std(far, ddof=1) / np.sqrt(3))
    assert other.diagnostics["spread"] == pytest.approx(np.std(far, ddof=1))
    assert other.diagnostics["log_values"] == far.tolist()
    assert other.diagnostics["ess"] == ess.tolist()
    assert other.status == ""
    single = _pool(far[:1], ess[:1], draws)
    assert single.diagnostics["spread"] == 0.0
    assert single.std_error == pytest.approx(np.sqrt(1 / 500 - 1 / 1000))


@pytest.mark.parametrize(("least", "refused"), [(399.0, True), (400.0, False)])
def test_no_verdict_is_given_on_fewer_than_400_effective_draws(least, refused):
    said = _refusal(np.array([[900.0, least], [800.0, 1000.0]]), 5000)
    assert bool(said) == refused
    assert not refused or "of 5000 prior draws only 399.0 count (median over repeats 850.0" in said


def test_repeats_and_models_draw_by_themselves():
    """Evidence of a model does not depend on what stands beside it, and repeats differ."""
    pair = listing_one([PAIR.posterior, PAIR.posterior], KEY, draws=50, repeats=3)
    alone = listing_one([PAIR.posterior], KEY, draws=50, repeats=3)
    assert pair.evidences[0] == alone.evidences[0]
    values = [evidence.diagnostics["log_values"] for evidence in pair.evidences]
    assert len({round(x, 9) for row in values for x in row}) == 6
    assert pair.probability == pytest.approx(
        np.array([np.exp(row) / np.exp(row).sum() for row in np.array(values).T - np.max(values)])
    )
