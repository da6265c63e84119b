"""Weights of the stack against a general optimiser, and the choice of the simplest model that predicts about as well."""

import numpy as np
import pytest
from scipy.optimize import minimize

from seatrial.selection.stack import NEAR_BEST, SMALL, mixture_score, paired, simplest, stacking_weights


def by_optimiser(log_density):
    """Weights by scipy, on the logits of all but one."""
    count = log_density.shape[1]

    def weights_at(free):
        raised = np.exp(np.append(free, 0.0) - max(free.max(), 0.0))
        return raised / raised.sum()

    starts = np.random.default_rng(1).normal(size=(5, count - 1))
    ends = [minimize(lambda free: -mixture_score(log_density, weights_at(free)), one, method="BFGS") for one in starts]
    return weights_at(min(ends, key=lambda end: end.fun).x)


@pytest.mark.parametrize("scale", [0.3, 3.0, 300.0])
@pytest.mark.parametrize("seed", range(3))
def test_weights_against_an_optimiser(scale, seed):
    log_density = scale * np.random.default_rng(seed).normal(size=(7, 4)) - 5000.0
    weights = stacking_weights(log_density)
    assert weights.sum() == pytest.approx(1.0)
    assert weights.min() >= 0.0
    other = mixture_score(log_density, by_optimiser(log_density))
    assert mixture_score(log_density, weights) > other - NEAR_BEST
    assert mixture_score(log_density, weights) >= log_density.sum(0).max() - NEAR_BEST


def test_one_model_that_is_best_everywhere_has_all_weight():
    log_density = np.array([[-10.0, -900.0], [-20.0, -21.0], [-30.0, -2000.0]])
    np.testing.assert_allclose(stacking_weights(log_density), [1.0, 0.0], atol=2e-3)


def test_each_of_two_that_is_best_in_half_of_the_runs_has_half():
    log_density = np.array([[0.0, -500.0], [-500.0, 0.0], [0.0, -900.0], [-80.0, 0.0]])
    np.testing.assert_allclose(stacking_weights(log_density), [0.5, 0.5], atol=1e-3)


def test_fewest_terms_within_one_standard_error():
    """The second is better by 6 ± 9 nats, which is no difference; the third is worse by 60 ± 9."""
    runs = np.array([[0.0, 5.0, -20.0], [0.0, -3.0, -25.0], [0.0, 4.0, -15.0]])
    assert paired(runs[:, 1], runs[:, 0]).delta == 6.0
    assert simplest(runs, ["", "", ""], [3, 4, 2]) == 0
    assert simplest(runs, ["", "", ""], [4, 4, 2]) == 1


def test_less_than_four_nats_is_no_difference():
    runs = np.array([[0.0, 1.0], [0.0, 1.1], [0.0, 1.05]])
    assert paired(runs[:, 1], runs[:, 0]).delta < SMALL
    assert simplest(runs, ["", ""], [2, 3]) == 0


def test_another_model_of_the_error_hides_no_structure():
    """Against another model of the error all structures lie within its large error; the bad one stays excluded under its own."""
    runs = np.array([[300.0, 0.0, -70.0], [-250.0, 0.0, -60.0], [10.0, 0.0, -65.0]])
    assert simplest(runs, ["drifting", "", ""], [3, 3, 2]) == 1
    assert simplest(runs + np.array([[900.0, 0.0, 0.0]]), ["drifting", "", ""], [3, 3, 2]) == 0
