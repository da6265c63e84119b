import subprocess
import sys

import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy import signal, stats

from seatrial.messages.render import sentence
from seatrial.sampling.diagnostics import (
    ChainHealth,
    asks_for_more,
    chain_findings,
    diagnose,
    geweke_score,
)


def autoregressive(rho, shape, seed=0):
    """Stationary chains of unit variance, x_k = rho x_{k-1} + e_k."""
    noise = np.random.default_rng(seed).normal(size=(*shape[:-1], shape[-1] + 500))
    return signal.lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise, axis=-1)[..., 500:]


def naive_r_hat(chains):
    """Rank-normalised split R-hat of Vehtari et al. (2021), the larger of that of the draws and of their distances."""

    def one(x):
        halves = np.concatenate([x[:, : x.shape[1] // 2], x[:, x.shape[1] // 2 :]])
        z = stats.norm.ppf((stats.rankdata(halves).reshape(halves.shape) - 0.375) / (halves.size + 0.25))
        n = z.shape[1]
        within, between = z.var(axis=1, ddof=1).mean(), n * z.mean(axis=1).var(ddof=1)
        return np.sqrt(((n - 1) / n * within + between / n) / within)

    return max(one(chains), one(np.abs(chains - np.median(chains))))


def test_layout_and_agreement_with_arviz():
    draws = np.random.default_rng(3).normal(size=(4, 500, 2)) * [1.0, 1e-4] + [0.0, 7.0]
    health = diagnose(draws)
    assert health.r_hat[1] == array_stats.rhat(draws[:, :, 1])
    assert health.ess_bulk[0] == array_stats.ess(draws[:, :, 0], method="bulk")
    assert health.ess_tail[1] == array_stats.ess(draws[:, :, 1], method="tail", prob=(0.05, 0.95))


@pytest.mark.parametrize("offset", [0.0, 0.3, 3.0])
def test_r_hat(offset):
    chains = np.random.default_rng(0).normal(size=(4, 500)) + offset * np.array([1, 0, 0, 0])[:, None]
    assert diagnose(chains[:, :, None]).r_hat[0] == pytest.approx(naive_r_hat(chains), rel=1e-6)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_effective_sample_size(rho):
    """An autoregression of n draws is worth n (1 - rho) / (1 + rho) independent ones; its estimate scatters by 5 %."""
    chains = autoregressive(rho, (8, 4000))
    expected = chains.size * (1 - rho) / (1 + rho)
    health = diagnose(chains[:, :, None])
    assert health.ess_bulk[0] == pytest.approx(expected, rel=0.15)
    assert health.mcse[0] == pytest.approx(1 / np.sqrt(expected), rel=0.1)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_geweke_is_standard_normal_for_stationary_chains(rho):
    """The variance of 400 normal scores is 1 with an error of 0.07, of which 4 are allowed."""
    scores = np.array([geweke_score(chain) for chain in autoregressive(rho, (400, 20_000))])
    assert abs(scores.mean()) < 4 / np.sqrt(400)
    assert scores.var() == pytest.approx(1, abs=4 * np.sqrt(2 / 400))
    assert stats.kstest(scores, stats.norm.cdf).pvalue > 0.01


@pytest.mark.parametrize(("first", "last"), [(0.1, 0.5), (0.25, 0.25)])
def test_geweke_of_independent_draws_by_hand(first, last):
    chain = np.random.default_rng(5).normal(size=2000)
    early, late = chain[: int(first * 2000)], chain[-int(last * 2000) :]
    plain = (early.mean() - late.mean()) / np.sqrt(early.var() / early.size + late.var() / late.size)
    assert geweke_score(chain, first, last) == pytest.approx(plain, rel=0.1)


HEALTHY = {"r_hat": 1.001, "ess_bulk": 900.0, "ess_tail": 800.0, "geweke": 0.9, "mcse": 0.1}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, []),
        ({"r_hat": 1.02}, ["the chains disagree about X_u", "R-hat 1.020, at most 1.01", "Double warm-up"]),
        ({"r_hat": np.nan}, ["X_u never moved", "Check the prior"]),
        (
            {"ess_bulk": 120.0},
            ["too few independent draws of X_u", "120 effective, at least 400", "Ask for more draws"],
        ),
        ({"ess_tail": 399.0}, ["399 effective"]),
    ],
    ids=str,
)
def test_complaints(change, words):
    bad = {**HEALTHY, **change}
    health = ChainHealth(**{name: np.array([HEALTHY[name], bad[name]]) for name in HEALTHY})
    said = list(map(sentence, chain_findings(("T_nabsn", "X_u"), health)))
    assert len(said) == bool(words)
    assert all(word in said[0] for word in words)
    assert asks_for_more(health) == (bool(words) and not np.isnan(bad["r_hat"])), "chains that never moved gain nothing"


def test_chains_of_twenty_draws_are_judged():
    """Of two draws at the begin the autoregression has an order of one at most."""
    health = diagnose(np.random.default_rng(0).normal(size=(4, 20, 1)))
    assert np.isfinite([health.r_hat, health.ess_bulk, health.geweke]).all()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(("stuck", "code"), [(4, "chains-still"), (1, "chains-disagree")])
def test_stuck_chains_are_noticed(stuck, code):
    chains = np.random.default_rng(0).normal(size=(4, 1000, 1))
    chains[:stuck] = np.arange(stuck)[:, None, None]
    (finding,) = chain_findings(("X_u",), diagnose(chains))
    assert finding.code == code


def test_slow_chains_are_noticed():
    (finding,) = chain_findings(("X_u",), diagnose(autoregressive(0.999, (4, 2000))[:, :, None]))
    assert finding.subject == ("X_u",)


def test_arviz_stats_is_loaded_in_part_and_later_as_a_whole():
    code = (
        "import sys; from seatrial.sampling.diagnostics import load_array_stats; load_array_stats().rhat\n"
        "assert not {'xarray', 'pandas', 'arviz_stats'} & sys.modules.keys()\n"
        "import arviz_stats; arviz_stats.loo, arviz_stats.base.array.array_stats.rhat"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
