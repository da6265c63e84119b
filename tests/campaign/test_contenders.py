"""Two contenders: what separates them on a trial, against a refit by SciPy, and the sentences that say so."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from seatrial.campaign.selection.runner_up import absorbed, contending
from seatrial.messages.structures import change_words, difference_words, one_design, trial_words, undecided_words
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle
from tests.report.outcomes import make_contenders, make_outcome

TIME = np.arange(120) * 0.25
CONTROL = np.where(np.sin(TIME / 2) > 0, 16.0, 10.0)[:, None]
NOISE = 0.01


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    return make_outcome(tmp_path_factory.mktemp("contenders"))


def test_what_refitting_cannot_absorb_is_what_a_refit_leaves():
    hull = Hull("made up", 30.0, fixed={"X_udot": -1.0}, trim={"u": 1.5, "n": 120.0})
    small = whole_vehicle(hull, ("X_uabsu", "X_tau_X"), moves=("u",))
    large = whole_vehicle(hull, ("X_uabsu", "X_tau_X", "X_u"), moves=("u",))
    step, start = jnp.full(TIME.size, 0.25), jnp.array([1.5])

    def speed(model, values):
        names = [term.text for term in model.coefficients]
        return simulate(model, dict(zip(names, values, strict=True)), CONTROL, step, start)[:, 0] / NOISE

    made_by = speed(large, jnp.array([-5.0, 1.0, -0.15]))
    follow = jax.jit(lambda values: speed(small, values))
    slopes = jax.jit(jax.jacfwd(follow))
    fitted = least_squares(
        lambda x: np.asarray(follow(x) - made_by), [-5.0, 1.0], lambda x: np.asarray(slopes(x)), xtol=1e-12
    )
    near = jnp.array([-5.0, 1.0]) + 0.3 * (fitted.x - jnp.array([-5.0, 1.0]))
    rest = absorbed(made_by - follow(near), slopes(near))
    assert 0.5 * float(rest @ rest) == pytest.approx(fitted.cost, rel=0.05)
    assert fitted.cost < 0.2 * 0.5 * float(((made_by - follow(jnp.array([-5.0, 1.0]))) ** 2).sum())


def test_the_projection_is_least_squares_and_counts_what_says_the_same_once():
    random = np.random.default_rng(4)
    difference, columns = random.normal(size=50), random.normal(size=(50, 4)) * [1e-6, 1.0, 1e4, 1.0]
    columns[:, 3] = 2.0 * columns[:, 1]
    columns = np.column_stack([columns, np.zeros(50)])
    expected = difference - columns[:, :3] @ np.linalg.lstsq(columns[:, :3], difference, rcond=1e-15)[0]
    np.testing.assert_allclose(absorbed(difference, jnp.asarray(columns)), expected, atol=1e-10)


def test_the_runner_up_is_named_by_what_it_does_otherwise(outcome):
    best, runner = contending(outcome.selection)
    assert (best.label, runner.label) == ("M-0", "M-1")
    assert change_words(("a", "b"), ("a",)) == "without b"
    assert change_words(("a",), ("a", "b", "c")) == "with b and c"
    assert change_words(("a", "b"), ("a", "c")) == "with c, without b"
    words = difference_words(outcome.contenders)
    assert f"M-1, {change_words(best.terms, runner.terms)}" in words
    assert "at most 0.03 m/s (rms 0.021) in the next trial and 0.02 m/s" in words
    assert "residuals of the fit are 0.02 m/s" in words


def test_the_trial_that_decides_is_inside_the_limits_or_there_is_none(outcome):
    campaign, selection = outcome.campaign, outcome.selection
    doubtful = replace(selection, probability=np.array([0.5, 0.4, 0.05, 0.05]), inclusion={"X_u": 0.5, "X_uabsu": 0.99})
    one = outcome.contenders
    assert one.decisive == (3, 3)
    assert one.nats == pytest.approx(np.nanmax(one.expected_nats))
    assert trial_words(one, doubtful).startswith("to decide between M-0 and M-1, run a repeated doublet of")
    assert one_design("random steps of ±20 N") == "random steps of ±20 N"
    weak = make_contenders(campaign, selection, nats=0.5)
    assert trial_words(weak, doubtful).startswith("no design of this family would decide between M-0 and M-1")
    sure = replace(selection, probability=np.array([0.97, 0.01, 0.01, 0.01]))
    assert "these data decide between M-0 and M-1" in trial_words(one, sure)
    in_doubt = tuple(replace(one, status="in doubt") for one in selection.evidences)
    shaken = replace(selection, evidences=in_doubt, alarms=("x",), probability=np.array([0.96, 0.04, 0.0, 0.0]))
    assert trial_words(one, shaken).startswith("first make the evidence reliable, to decide between M-0 and M-1: ")
    noisy = replace(
        sure, probability_error=np.array([0.1, 0.1, 0.0, 0.0]), inclusion={"X_u": 0.97}, inclusion_error={"X_u": 0.1}
    )
    assert "to decide between M-0 and M-1: raise `particles`" in trial_words(one, noisy)
    assert undecided_words(noisy).endswith(": X_u (0.97)")
    assert undecided_words(doubtful) == ("not decided (with the probability that the term is needed): X_u (0.50)")
    assert "every optional term" in undecided_words(replace(selection, inclusion={"X_u": 0.999}))
