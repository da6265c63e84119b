"""Optimal designs that are known in closed form or from elsewhere, found through own models and the public search.

A control that sets the pace of time makes an instant of measurement a design: with s the time of the trial and dt/ds = pace, a state is
seen at s = 1 as it is at the time that the levels add up to.
"""

import jax.numpy as jnp
import numpy as np
import pytest

import seatrial as st

A, B, SD = 1.0, 1.0, 1e-4
LENGTH, STEP = 150.0, 0.25
"""Of the trial of a first-order lag, and its samples, s."""
RATES = np.array([0.2, 0.4, 0.5, A / np.sqrt(3.0), 0.67, 0.8, 1.2])
"""Angular frequencies that are tried, rad/s."""
NARROW = {"a": st.Normal(A, 1e-3), "b": st.Normal(B, 1e-3)}


def lag_rate(params, state, control):
    return (-params["a"] * state[0] + params["b"] * control[0],)


def waved_rate(params, state, control):
    """The control is the angular frequency of a sine of amplitude one."""
    return -params["a"] * state[0] + params["b"] * jnp.sin(state[1]), control[0]


def decay_rate(params, state, control):
    """A first-order reaction from A to B and on."""
    first, second = params["k1"] * state[0], params["k2"] * state[1]
    return -control[0] * first, control[0] * (first - second)


def growth_rate(params, state, control):
    return (control[0] * params["rate"] * (params["asymptote"] - state[0]),)


LAG = st.make_model("lag", lag_rate, {"u": "m/s"}, {"push": "m/s^2"}, {"a": "1/s", "b": "1"})
WAVED = st.make_model("waved lag", waved_rate, {"u": "m/s", "phase": "rad"}, {"n": "rad/s"}, {"a": "1/s", "b": "m/s^2"})
REACTION = st.make_model(
    "reaction", decay_rate, {"first": "1", "second": "1"}, {"pace": "1"}, {"k1": "1/s", "k2": "1/s"}
)
GROWTH = st.make_model("growth", growth_rate, {"grown": "1"}, {"pace": "1"}, {"asymptote": "1", "rate": "1/s"})


def closed_form(rate):
    """det of the information about (a, b) of a sine of unit mean square, per second and unit of noise density."""
    return B**2 * rate**2 / (A**2 + rate**2) ** 4


def naive_information(push, step):
    """Information of u about (a, b), per sample and noise, by midpoint steps of u and its sensitivities, shape (2, 2, waves)."""
    x = np.zeros((3, push(0.0).size))
    total = np.zeros((2, 2, x.shape[1]))

    def rate(x, t):
        return np.stack([-A * x[0] + B * push(t), -A * x[1] - x[0], -A * x[2] + push(t)])

    count = round(LENGTH / step)
    for i in range(count):
        total = total + x[1:, None] * x[None, 1:]
        x = x + step * rate(x + step / 2 * rate(x, i * step), (i + 0.5) * step)
    return total / count


def test_closed_form_against_a_plain_loop():
    found = naive_information(lambda t: np.sqrt(2.0) * np.sin(RATES * t), 0.05)
    det = found[0, 0] * found[1, 1] - found[0, 1] ** 2
    np.testing.assert_allclose(det, closed_form(RATES), rtol=0.04)
    assert np.argmax(det) == np.argmax(closed_form(RATES)) == 3


@pytest.fixture(scope="module")
def waves():
    family = st.Family("n", 0.0, LENGTH, LENGTH, STEP, start=0.0, kind="step")
    problem = st.make_design_problem(WAVED, NARROW, family, RATES, [LENGTH], {"u": SD}, utility="fisher-d")
    return st.design_trial(problem)


def test_the_sweep_finds_the_best_single_sine(waves):
    best = waves.best
    assert best.amplitude[best.best[0]] == pytest.approx(A / np.sqrt(3.0))
    samples = LENGTH / STEP
    expected = 0.5 * np.log(closed_form(RATES)) + np.log(0.5 * samples / SD**2 * 1e-6)  # prior sd 1e-3 squared
    np.testing.assert_allclose(waves.sweeps[0].worth[:, 0], expected, atol=0.05)  # the first wave is not steady


def test_no_wave_has_more_information_than_the_optimum_shares_out():
    """Kiefer and Wolfowitz: tr(M*^-1 M(w)) is two at most, so that no input of that power, of any shape, is better than the single sine."""

    def information(rate):
        slopes = np.array([-B / (1j * rate + A) ** 2, 1.0 / (1j * rate + A)])
        return np.real(np.outer(slopes, slopes.conj()))

    inverse = np.linalg.inv(information(A / np.sqrt(3.0)))
    found = [np.trace(inverse @ information(rate)) for rate in np.linspace(0.01, 5.0, 500)]
    assert 2.0 - 1e-3 < max(found) <= 2.0 + 1e-9


def test_a_free_form_beats_it_at_its_amplitude_and_not_at_its_power(waves):
    """Levels at the bounds have twice the power of a sine between them: log 2 of the D criterion of two coefficients."""
    family = st.Family("push", 0.0, LENGTH, LENGTH, STEP, start=0.0, kind="repeated-doublet")
    problem = st.make_design_problem(
        LAG, NARROW, family, [1.0], [10.0], {"u": SD}, limits=st.Limits(-1.0, 1.0), utility="fisher-d"
    )
    found = st.design_trial(problem, st.FreeFormSearch(30))
    assert found.at_bounds == 1.0
    assert found.utility - np.log(2.0) < float(np.nanmax(waves.sweeps[0].worth)) < found.utility


def test_box_and_lucas():
    """Two measurements of B in A -> B -> C: at 1.23 and 6.86 for rates 0.7 and 0.2 (Biometrika 46, 1959)."""
    belief = {"k1": st.Normal(0.7, 1e-4), "k2": st.Normal(0.2, 1e-4)}
    family = st.Family("pace", 1.0, 2.02, 2.0, 0.02, start=0.0, kind="doublet")
    problem = st.make_design_problem(
        REACTION, belief, family, [0.5], [2.0], {"second": 1e-7}, start={"first": 1.0}, rates={"second": 1.0}, limits=st.Limits(0.0, 8.0),
        utility="fisher-d",
    )  # fmt: skip
    times = np.cumsum(st.design_trial(problem, st.FreeFormSearch(2)).levels)
    np.testing.assert_allclose(times, [1.23, 6.86], atol=0.012)


def test_rooney_and_biegler():
    """As Pyomo.DoE's example: after hours 1, 2, 3, 4, 5 and 7 the seventh is best at the bound, hour 10, with log10 det 6.864795."""

    def slopes(hour):
        return np.array([1.0 - np.exp(-0.5 * hour), 15.0 * hour * np.exp(-0.5 * hour)])

    before = sum(np.outer(slopes(hour), slopes(hour)) for hour in (1, 2, 3, 4, 5, 7)) / 0.1**2
    belief = {"asymptote": st.Normal(15.0, 1e-6), "rate": st.Normal(0.5, 1e-6)}
    family = st.Family("pace", 0.0, 1.01, 1.01, 0.01, start=0.0, kind="step")
    hours = np.arange(0.5, 10.1, 0.5)
    problem = st.make_design_problem(
        GROWTH, belief, family, hours, [1.01], {"grown": 0.1}, rates={"grown": 1.0},
        utility=lambda information: np.linalg.slogdet(before + information)[1] / np.log(10.0),
    )  # fmt: skip
    found = st.design_trial(problem)
    best = found.best
    assert hours[best.best[0]] == 10.0
    assert float(best.worth[best.best]) == pytest.approx(6.864795, abs=1e-5)
