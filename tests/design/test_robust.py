"""Utilities under uncertain coefficients, on a decay u' = c n u seen once at its end, whose information is a formula."""

import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.robust import information_table, utility_table
from tests.design.test_expected_gain import DECAY_SD, N_DECAY, decay_plan, decay_slope

PUSH = np.linspace(0.2, 3.0, 29)
CONTROLS = np.tile(PUSH[:, None, None], (1, N_DECAY, 1))
DRAWS = np.random.default_rng(3).normal(-1.0, 0.3, size=(40, 1))
PRIOR = np.array([[0.09]])


def exact(values):
    """0.5 ln(1 + P0 F) of every design at every draw."""
    slope = decay_slope(np.asarray(values)[None, :, 0], PUSH[:, None]) / DECAY_SD
    return 0.5 * np.log1p(PRIOR[0, 0] * slope**2)


def test_table_against_the_formula():
    table = utility_table(decay_plan(), CONTROLS, DRAWS, find_criterion("fisher-d", PRIOR))
    expected = exact(DRAWS)
    np.testing.assert_allclose(table, expected, rtol=1e-9)


def test_best_local_design_is_the_known_one():
    """T exp(-T) is largest at T = 1: the information of a decay, seen once, when the signal has fallen to 1/e."""
    local = utility_table(decay_plan(), CONTROLS, np.array([[-1.0]]), find_criterion("fisher-d", PRIOR))[:, 0]
    np.testing.assert_allclose(local, exact([[-1.0]])[:, 0], rtol=1e-9)
    assert PUSH[np.argmax(local)] == pytest.approx(1.0, abs=0.051)


def test_draws_that_diverge_are_counted():
    draws = np.vstack([DRAWS, [[800.0], [900.0]]])
    with pytest.raises(NumericalError, match=r"diverges for 2 of 42 draws .* in \d+ of 29 designs.*X_u = 800"):
        utility_table(decay_plan(200), np.repeat(CONTROLS[:, :1], 200, 1), draws, find_criterion("fisher-d", PRIOR))


@pytest.mark.parametrize(
    ("controls", "draws", "words"),
    [(CONTROLS[0], DRAWS, "controls"), (CONTROLS[:, 1:], DRAWS, "controls"), (CONTROLS, DRAWS[:, 0], "draws")],
)
def test_shapes_that_do_not_fit(controls, draws, words):
    with pytest.raises(InputError, match=words):
        utility_table(decay_plan(), controls, draws, find_criterion("fisher-d", PRIOR))


def test_which_draws_and_designs_diverge_is_told():
    """A decay at -1 never does; growth at 800 and 900 does in 200 samples under a push of 1 or 2, and none does without one."""
    controls = np.array([0.0, 1.0, 0.0, 2.0])[:, None, None] * np.ones((1, 200, 1))
    draws = np.array([[-1.0], [800.0], [-2.0], [900.0]])
    with pytest.raises(NumericalError) as caught:
        utility_table(decay_plan(200), controls, draws, find_criterion("fisher-d", PRIOR))
    said = str(caught.value)
    assert "diverges for 2 of 4 draws of the coefficients in 2 of 4 designs, most often in design 1;" in said
    assert "the first is X_u = 800 (SI)" in said


def test_information_of_each_design_at_each_draw():
    controls = np.array([0.5, 1.5])[:, None, None] * np.ones((1, N_DECAY, 1))
    found = information_table(decay_plan(), controls, DRAWS[:3])
    slopes = decay_slope(DRAWS[None, :3, 0], np.array([[0.5], [1.5]])) / DECAY_SD
    np.testing.assert_allclose(found[..., 0, 0], slopes**2, rtol=1e-9)
