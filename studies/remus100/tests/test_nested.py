import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import NumericalError
from seatrial.estimation.priors import Normal
from seatrial.sampling.nested import NestedRun, _integrate, batch_of, sample_nested
from studies.remus100 import nested
from studies.remus100.nested import nested_evidence
from tests.estimation_cases import GOLDEN_LOG_EVIDENCE, golden_posterior, linear_gaussian, posterior
from tests.selection.test_evidence import box, half_forbidden

pytestmark = pytest.mark.proof

KEY = jax.random.key(1)
PAIR = linear_gaussian(2)


@pytest.mark.parametrize(
    "problem",
    [lambda: (PAIR.posterior, PAIR.log_evidence), box, half_forbidden],
    ids=["linear 2", "box", "half forbidden"],
)
def test_known_evidence(problem):
    target, exact = problem()
    found = nested_evidence(target, KEY)
    assert found.status == ""
    assert 0.02 < found.std_error < 0.3
    assert abs(found.log_value - exact) < 4 * found.std_error


@pytest.mark.proof
def test_golden_evidence():
    """Of 500 live points, the other two models take two minutes more and agree as well: +0.24 and -0.14, errors 0.20 and 0.14."""
    model = "M-1"
    found = nested_evidence(golden_posterior(model), KEY, live=150)
    assert found.status == ""
    assert found.std_error < 0.5
    assert found.log_value == pytest.approx(GOLDEN_LOG_EVIDENCE[model], abs=0.6)


@pytest.mark.proof
def test_stated_error_of_one_run_is_honest():
    """Over 30 runs, errors in units of sqrt(H / live): mean 0 within 4 of its errors, root mean square 1 +- 13 %."""
    runs = [sample_nested(PAIR.posterior, jax.random.key(i)) for i in range(30)]
    scores = np.array([(run.log_evidence - PAIR.log_evidence) / np.sqrt(run.information / 500) for run in runs])
    assert abs(scores.mean()) < 4 / np.sqrt(30)
    assert np.sqrt((scores**2).mean()) == pytest.approx(1.0, abs=0.5)


def test_information_of_a_normal_posterior():
    """H is the divergence of posterior from prior, in closed form; a run's H scatters as its log Z does."""
    mean, cov = PAIR.moments
    shift = (mean - PAIR.prior_mean) / PAIR.prior_sd
    ratio = cov / PAIR.prior_sd**2
    exact = 0.5 * (np.trace(ratio) + shift @ shift - 2 - np.log(np.linalg.det(ratio)))
    assert sample_nested(PAIR.posterior, KEY).information == pytest.approx(exact, abs=4 * np.sqrt(exact / 500))


def test_draws_are_those_of_the_posterior():
    """Moments within 4 errors of as many independent draws as the shares amount to."""
    run = sample_nested(PAIR.posterior, KEY)
    values = np.asarray(PAIR.posterior.constrain(jnp.asarray(run.draws(4000, KEY))))
    mean, cov = PAIR.moments
    count = 1.0 / (run.share**2).sum()
    assert (np.abs(values.mean(0) - mean) < 4 * np.sqrt(np.diag(cov) / count)).all()
    assert np.diag(np.cov(values.T)) == pytest.approx(np.diag(cov), rel=4 * np.sqrt(2 / count))
    assert run.draws(4000, KEY).tobytes() == run.draws(4000, KEY).tobytes()


def test_integration_of_a_known_shrinkage():
    """L(X) = exp(-50 X) over the prior mass X, points at their expected mass: Z = (1 - exp(-50)) / 50."""
    live, batch, steps = 400, 50, 80
    log_mass = np.cumsum(np.tile(-1.0 / np.arange(live, live - batch, -1), steps))
    dead = list(-50 * np.exp(log_mass).reshape(steps, batch))
    last = -50 * np.exp(log_mass[-1]) * (np.arange(live) + 0.5) / live
    log_evidence, information, _ = _integrate(dead, last)
    assert log_evidence == pytest.approx(np.log(1 / 50), abs=1 / live)
    assert information == pytest.approx(np.log(50) - 1, abs=0.02)


def test_likelihood_that_says_nothing_is_one():
    log_evidence, information, _ = _integrate([np.zeros(10)] * 5, np.zeros(80))
    assert log_evidence == pytest.approx(0.0, abs=1e-12)
    assert information == pytest.approx(0.0, abs=1e-12)


def test_one_run_cannot_be_judged():
    with pytest.raises(NumericalError, match="set repeats to 2"):
        nested_evidence(PAIR.posterior, KEY, repeats=1)


def test_no_draw_can_be_simulated():
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: jnp.where(v["a"] > 100.0, 0.0, -jnp.inf))
    with pytest.raises(NumericalError, match="Narrow the prior"):
        sample_nested(target, KEY, live=16)


def test_end_not_reached():
    with pytest.raises(NumericalError, match="did not end"):
        sample_nested(PAIR.posterior, KEY, max_steps=1)


def canned(monkeypatch, logs, *, information=8.0, alive=1.0, stuck=0.0):
    """Evidence from runs that are given."""
    runs = [
        NestedRun(log, information + 2 * i, 100 + i, alive, stuck * i, np.zeros((1, 1)), np.ones(1))
        for i, log in enumerate(logs)
    ]
    waiting = iter(runs)
    monkeypatch.setattr(nested, "sample_nested", lambda *_, **__: next(waiting))
    return nested_evidence(PAIR.posterior, KEY, repeats=len(logs), live=400)


def test_error_is_that_expected_of_removing_points_in_batches(monkeypatch):
    """Each removal from n points scatters log X by 1 / n and lowers it by as much; a prior half dead counts its draws, too."""
    batch = [1 / (400 - i) for i in range(batch_of(400))]
    ratio = sum(fall**2 for fall in batch) / sum(batch)
    found = canned(monkeypatch, [1.0, 1.0], information=8.0, alive=0.5)
    assert found.std_error == pytest.approx(np.sqrt((9.0 * ratio + 1.0 / 400) / 2))
    assert found.log_value == 1.0
    assert found.diagnostics["information"] == 9.0
    assert (found.diagnostics["alive"], found.diagnostics["removed"]) == (0.5, [100, 101])
    alike = canned(monkeypatch, [1.0, 1.0, 1.0, 1.0], information=6.0)
    assert alike.std_error == pytest.approx(np.sqrt(9.0 * ratio / 4))
    apart = canned(monkeypatch, [0.0, 1.0], information=8.0)
    assert apart.std_error == pytest.approx(np.sqrt(0.5) / np.sqrt(2))
    assert apart.diagnostics["spread"] == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize(("errors", "complains"), [(3.9, False), (4.1, True)])
def test_repeats_that_differ_by_more_than_four_errors_are_told(monkeypatch, errors, complains):
    expected = canned(monkeypatch, [0.0, 0.0]).std_error * np.sqrt(2)
    found = canned(monkeypatch, [0.0, errors * expected * np.sqrt(2)])
    assert ("repeats differ" in found.status) == complains


@pytest.mark.parametrize(("stuck", "complains"), [(0.04, False), (0.06, True)])
def test_moves_that_find_nothing_are_told(monkeypatch, stuck, complains):
    """Of the worst repeat."""
    found = canned(monkeypatch, [0.0, 0.0], stuck=stuck)
    assert ("found no new point" in found.status) == complains
    assert found.diagnostics["stuck"] == stuck
