"""Whether a baseline is said to be better: where it is, where it is not, where chance makes it seem so, and where one diverges."""

import numpy as np
import pytest
import scipy

from seatrial.estimation.prediction.baseline_comparison import Predicted, Run, compare
from seatrial.messages.predictions import comparison_text, score_lines

TIME = np.arange(400) * 0.1
MOTION = np.sin(0.5 * TIME)


def runs_of(count=4, seed=0, noise=0.1):
    rng = np.random.default_rng(seed)
    return [Run(TIME, MOTION + noise * rng.normal(size=TIME.size)) for _ in range(count)]


def off(by, sd=0.1, count=4):
    return [Predicted(MOTION + by, np.full(TIME.size, sd)) for _ in range(count)]


def test_scores_are_those_of_all_samples_together():
    runs = runs_of(2)
    runs[0].measured[:100] = np.nan
    found = compare("u", runs, off(0.0, count=2), {"the mean": off(0.3, 0.2, count=2)})
    y = np.concatenate([run.measured[np.isfinite(run.measured)] for run in runs])
    mean = np.concatenate([MOTION[100:], MOTION])
    about = np.concatenate([np.full(300, np.nanmean(runs[0].measured)), np.full(400, runs[1].measured.mean())])
    assert found.ours.explained == pytest.approx(1 - np.sum((y - mean) ** 2) / np.sum((y - about) ** 2))
    assert found.ours.log_score == pytest.approx(scipy.stats.norm.logpdf(y, mean, 0.1).mean())
    grid = np.linspace(-6, 6, 40001)
    cdf = scipy.stats.norm.cdf(grid, mean[7] + 0.3, 0.2)
    by_quadrature = np.trapezoid((cdf - (grid >= y[7])) ** 2, grid)
    one = [Run(TIME[:1], y[7:8])]
    alone = compare(
        "u", one, [Predicted(mean[7:8], np.array([0.2]))], {"the mean": [Predicted(mean[7:8] + 0.3, np.array([0.2]))]}
    )
    assert alone.baselines[0].crps == pytest.approx(by_quadrature, abs=1e-3)


def test_a_model_that_is_best_passes():
    found = compare("u", runs_of(), off(0.0), {"a lag": off(0.2), "the mean": off(1.0)})
    assert found.level == "pass"
    assert found.p_value < 1e-3
    assert [one.words for one in found.baselines] == ["a lag", "the mean"]
    assert "better than every baseline; the best of them is a lag" in comparison_text(found)
    close = compare("u", runs_of(1), off(0.0, count=1), {"a lag": off(0.003, count=1)})
    assert (close.level, close.p_value > 0.05) == ("pass", True)
    assert "better than every baseline, which chance may explain (p = 0." in comparison_text(close)


def test_a_model_that_is_clearly_worse_fails():
    found = compare("u", runs_of(), off(0.4), {"a lag": off(0.0), "the mean": off(1.0)})
    assert found.level == "fail"
    assert found.p_value < 1e-4
    assert comparison_text(found).startswith(
        "held-back runs: a lag predicts u better than the model in 4 of 4 runs, by far (98% against 6"
    )
    assert comparison_text(found).endswith("prefer it, or correct the model")


def test_bands_alone_may_be_why():
    found = compare("u", runs_of(), off(0.0, 1.0), {"a lag": off(0.05, 0.1)})
    assert found.level == "fail"
    assert "bands are too narrow or too wide" in comparison_text(found)


def test_a_little_worse_is_a_caution():
    found = compare("u", runs_of(), off(0.05), {"a lag": off(0.04)})
    assert found.level == "caution"
    assert comparison_text(found).endswith("prefer it, as the simpler model, or correct the model")
    same = compare("u", runs_of(), off(0.05), {"a lag": off(0.04)}, ["a lag"])
    assert same.level == "caution"
    assert comparison_text(same).endswith(
        "it predicts as well, but is no simpler model, because it has the same equations"
    )


def test_chance_alone_rarely_fails():
    """Two predictions of the same size whose slow errors are independent: at most 5 % of 200 fail, and four errors of that share."""
    memory, rng = np.exp(-0.1 / 2.0), np.random.default_rng(3)

    def slow(count):
        white = rng.normal(size=(count, TIME.size + 200)) * np.sqrt(1 - memory**2)
        return 0.3 * scipy.signal.lfilter([1.0], [1.0, -memory], white)[:, 200:]

    failed = 0
    for seed in range(200):
        ours, theirs = ([Predicted(MOTION + e, np.full(TIME.size, 0.3)) for e in slow(3)] for _ in range(2))
        failed += compare("u", runs_of(3, seed), ours, {"a lag": theirs}).level == "fail"
    assert failed <= 200 * (0.05 + 4 * np.sqrt(0.05 * 0.95 / 200))


def test_chance_between_runs_is_the_t_test_of_their_means():
    """Runs of one length that differ by more than the samples within them say."""
    runs, bys = runs_of(), (0.1, 0.2, 0.35, 0.5)
    found = compare("u", runs, [off(by, count=1)[0] for by in bys], {"a lag": off(0.0)})

    def crps(run, by):
        z, norm = (run.measured - MOTION - by) / 0.1, scipy.stats.norm
        return np.mean(0.1 * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi)))

    means = [crps(run, by) - crps(run, 0.0) for run, by in zip(runs, bys, strict=True)]
    assert found.p_value == pytest.approx(scipy.stats.ttest_1samp(means, 0.0, alternative="greater").pvalue)


def test_few_effective_samples_are_no_proof_however_large_the_difference():
    """One run whose error only grows is worth two or three samples."""
    found = compare(
        "u", runs_of(1), off(TIME / 40, count=1), {"a lag": off(0.0, count=1), "the mean": off(1.0, count=1)}
    )
    assert found.ours.crps > 4 * found.baselines[0].crps
    assert found.level == "caution"
    assert "a lag predicts u better than the model in the only run, by far (" in comparison_text(found)
    assert "do not exclude chance (p = " in comparison_text(found)
    assert " for the best of 2 baselines): hold back more or longer runs" in comparison_text(found)


def test_the_runs_in_which_a_baseline_is_better_are_counted():
    """By far in two of nine, though so seldom that chance is not excluded, and worse in seven; no probability of 1 is printed."""
    runs, good, bad = runs_of(9), off(0.0, count=1), off(3.0, count=1)
    ours, theirs = [*bad * 2, *good * 7], off(0.03, count=9)
    found = compare("u", runs, ours, {"a lag": theirs, "the mean": off(1.5, count=9)})
    assert found.level == "caution"
    said = comparison_text(found)
    assert "a lag predicts u better than the model in 2 of 9 runs, by far, and worse in 7 (" in said
    assert "no worse" not in said
    assert "against worse than the runs' own means (-" in said
    capped = compare("u", runs, ours, {"a lag": theirs} | {f"mean {k}": off(1.5, count=9) for k in range(20)})
    assert capped.p_value == 1.0
    assert "(p = " not in comparison_text(capped)


def test_what_diverges_loses():
    gone = [Predicted(np.where(TIME > 30, np.inf, MOTION), np.full(TIME.size, 0.1)) for _ in range(4)]
    found = compare("u", runs_of(), gone, {"a lag": off(0.0)})
    assert (found.level, found.p_value) == ("fail", 0.0)
    assert "the model's u diverges, but a lag does not (9" in comparison_text(found)
    assert "diverges" in score_lines(found)[0]
    assert compare("u", runs_of(), off(0.0), {"a lag": gone}).level == "pass"
    both = compare("u", runs_of(), gone, {"a lag": gone})
    assert (both.level, comparison_text(both)[-17:]) == ("fail", "correct the model")
