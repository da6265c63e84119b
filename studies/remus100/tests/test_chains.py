"""Tables III and VI: short chains against their own draws, a least-squares fit and the numbers measured elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from seatrial.selection.criterion import MonteCarloValue, PredictiveCriterion, compare
from studies.remus100.tests.studies import TINY, study
from tests.cases import THRUST, U0, X_U, X_UU, naive_rk4, surge_rate
from tests.estimation_cases import SIGMA, golden_motion, golden_noise, naive_doublets, naive_speed

pytestmark = pytest.mark.proof

LONGER = replace(TINY, chains=32, burn_in=1000, draws=2000)
"""Chains in step cost little: some 4 000 effective draws."""


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return study(tmp_path_factory.mktemp("chains")).part("chain-6-reduced")


@pytest.fixture(scope="module")
def longer(tmp_path_factory):
    return study(tmp_path_factory.mktemp("longer"), LONGER)


def deviances(x_u, x_uu, thrust, sigma):
    """-2 log likelihood of the golden trial at many points, T in 1e-2 N/(rev/s)^2, by one loop over time."""
    _, rev_per_s, true = golden_motion()
    measured, speed, squares = true + golden_noise(), np.full(np.shape(x_u), U0), 0.0
    for y, n in zip(measured, rev_per_s, strict=True):
        squares = squares + (y - speed) ** 2
        speed = naive_rk4(lambda u, n=n: surge_rate(u, n, x_u, x_uu, thrust / 100), speed, 0.01)
    return squares / sigma**2 + measured.size * np.log(2 * np.pi * sigma**2)


def shortest_interval(x, share=0.95):
    ordered = np.sort(x)
    inside = int(np.floor(share * x.size))
    width = ordered[inside:] - ordered[:-inside]
    return ordered[width.argmin()], ordered[width.argmin() + inside]


def test_summary_is_that_of_the_draws(short):
    """All draws are kept here, so each number can be had again; of 4 000 draws the interval's ends may be one draw apart."""
    draws = short["draws"].values
    assert draws.shape == (4, 1000, 4)
    assert [str(name) for name in short["parameter"].values] == ["X_u", "X_uabsu", "T_nabsn", "sigma_u"]
    flat = draws.reshape(-1, 4)
    np.testing.assert_allclose(short["mean"], flat.mean(0), rtol=1e-12)
    np.testing.assert_allclose(short["sd"], flat.std(0, ddof=1), rtol=1e-12)
    np.testing.assert_allclose(short["covariance"], np.cov(flat.T), rtol=1e-9)
    for i, sd in enumerate(short["sd"].values):
        ends = short["hpd_low"].values[i], short["hpd_high"].values[i]
        assert ends == pytest.approx(shortest_interval(flat[:, i]), abs=0.05 * sd)
    np.testing.assert_allclose(short["truth"], [-1.21, -2.93, 6.28, 0.0757], rtol=1e-12)


def test_autocorrelations(short):
    """Raw: with the mean left in, so near 1 for a coefficient far from 0. Drawn: of what a straight line leaves."""
    first = short["draws"].values[0, :, 0]
    at = np.arange(first.size)
    rest = first - np.polyval(np.polyfit(at, first, 1), at)
    for lag in (0, 1, 7, 50):
        raw = np.sum(first[lag:] * first[: first.size - lag]) / np.sum(first**2)
        left = np.sum(rest[lag:] * rest[: rest.size - lag]) / np.sum(rest**2)
        assert float(short["raw_acf"][lag, 0]) == pytest.approx(raw, rel=1e-12)
        assert float(short["acf"][lag, 0]) == pytest.approx(left, abs=0.02)
    assert float(short["raw_acf"][50, 0]) > 0.9


def test_trace_begins_at_the_mode_and_ends_with_the_last_draw(short):
    np.testing.assert_allclose(short["trace"][0], short["mode"], rtol=1e-9)
    np.testing.assert_allclose(short["trace"][-1], short["draws"][0, -1], rtol=1e-9)
    assert short["iteration"].values.tolist() == list(range(0, 1501, 100))


def test_criteria_by_their_definitions(short):
    """Eqs. (22) to (27) over the same draws, with deviances by a plain loop, whose data differ by 1e-6 m/s."""
    flat = short["draws"].values.reshape(-1, 4)
    mean_deviance, at_mean = deviances(*flat.T).mean(), deviances(*flat.mean(0))
    p_d = mean_deviance - at_mean
    value = {str(name): float(short["criterion_value"].sel(criterion=name)) for name in short["criterion"].values}
    assert value["Dbar"] == pytest.approx(mean_deviance, abs=0.01)
    assert value["p_D"] == pytest.approx(p_d, abs=0.01)
    assert value["DIC"] == pytest.approx(at_mean + 2 * p_d, abs=0.02)
    assert value["BPIC"] == pytest.approx(mean_deviance + 2 * p_d, abs=0.03)
    assert value["WAIC"] == pytest.approx(float(short["pointwise"][0].sum()), abs=1e-6)


def test_both_starts_arrive(tmp_path):
    """From half the truth the density is 10 000 nats too low; the posterior mode needs no burn-in."""
    height = study(tmp_path).part("starts")["height"]
    half, mode = (height.sel(start=start).values for start in ("half the truth", "posterior mode"))
    assert half[0].max() < -1e4
    assert mode[0] == pytest.approx(0.0, abs=1e-6)
    assert mode.min() > -20
    assert half[-1].min() > -20


GOLDEN = {
    "chain-6-reduced": ([-1.133, -2.962, 6.249], [0.103, 0.068, 0.044]),
    "chain-6-full": ([-1.683, -2.590, 6.231, -8.7], [0.38, 0.256, 0.045, 5.84]),
}
CRITERIA = {
    "chain-6-reduced": {"DIC": -13934.1, "p_D": 3.98, "WAIC": -13933.9, "PSIS-LOO": -13933.9},
    "chain-6-full": {"DIC": -13934.2, "p_D": 4.98, "WAIC": -13933.8, "PSIS-LOO": -13933.7},
}


@pytest.mark.proof
@pytest.mark.parametrize("part", GOLDEN)
def test_golden_posterior_and_criteria(longer, part):
    """Means within .1 sd, sds within 3 %, criteria within .5 and p_D within .15, as asked, and four Monte Carlo errors besides.

    The full model's golden mean of X_du3 is printed to .1, and its sds to two digits, 1 %.
    """
    data, (mean, sd) = longer.part(part), map(np.array, GOLDEN[part])
    k = mean.size
    assert float(data["r_hat"].max()) < 1.01
    assert (np.abs(data["mean"].values[:k] - mean) < 0.1 * sd + 4 * data["mcse"].values[:k]).all()
    error = 4 / np.sqrt(2 * data["ess"].values[:k])
    assert (np.abs(data["sd"].values[:k] / sd - 1) < 0.03 + 0.01 + error).all()
    for name, golden in CRITERIA[part].items():
        one = data.sel(criterion=name)
        tolerance = 0.15 if name == "p_D" else 0.5
        assert float(one["criterion_value"]) == pytest.approx(golden, abs=tolerance)
        assert float(one["criterion_error"]) < tolerance
    bpic = float(data["criterion_value"].sel(criterion="BPIC"))
    assert bpic == pytest.approx(CRITERIA[part]["DIC"] + CRITERIA[part]["p_D"], abs=0.5)


@pytest.mark.proof
@pytest.mark.parametrize("method", ["WAIC", "PSIS-LOO"])
def test_criteria_cannot_tell_the_golden_models_apart(longer, method):
    full, reduced = (longer.part(part)["pointwise"].sel(predictive=method).values for part in GOLDEN)
    found = compare(
        *(PredictiveCriterion(method, MonteCarloValue(x.sum(), 0.0), 1, 1, x, np.empty(0), "") for x in (full, reduced))
    )
    assert abs(found.delta) < 0.5
    assert "do not separate the predictions" in found.verdict


@pytest.mark.proof
def test_table_3_by_least_squares(longer):
    """The posterior is nearly normal: mean and sd of a least-squares fit by plain loops, plus the chain's own errors."""
    time = np.arange(6000) * 0.01
    rev_per_s, step = naive_doublets(time, 200, 10), np.full(6000, 0.01)
    measured = naive_speed(rev_per_s, step) + golden_noise()
    truth = np.array([X_U, X_UU, 100 * THRUST])

    def speeds(c):
        return naive_speed(rev_per_s, step, start=np.full(c.shape[1], U0), x_u=c[0], x_uu=c[1], thrust=c[2] / 100)

    def slopes(c):
        size = 1e-5 * np.abs(truth)
        moved = speeds(c[:, None] + np.hstack([np.diag(size), -np.diag(size)]))
        return (moved[:, :3] - moved[:, 3:]) / (2 * size)

    fit = least_squares(lambda c: speeds(c[:, None])[:, 0] - measured, truth, slopes)
    sd = SIGMA * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    data = longer.part("chain-3").isel(parameter=slice(3))
    assert (np.abs(data["mean"] - fit.x) < 0.05 * sd + 4 * data["mcse"]).all()
    assert (np.abs(data["sd"] / sd - 1) < 0.03 + 4 / np.sqrt(2 * data["ess"])).all()


@pytest.mark.proof
def test_plain_metropolis_agrees(longer):
    """Metropolis-Hastings draws from the same posterior, far more slowly: differences in units of both Monte Carlo errors."""
    ours, rival = longer.part("chain-3"), longer.part("chain-3-metropolis")
    gap = np.abs(ours["mean"] - rival["mean"]) / np.hypot(ours["mcse"], rival["mcse"])
    assert float(gap.max()) < 4
    assert float(ours["ess"].min()) > 3 * float(rival["ess"].min())
