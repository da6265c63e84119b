"""Scores against naive twins, and stretches by hand."""

import math

import numpy as np
import pytest
import scipy

from benchmarks.public.method import Problem, with_spread
from benchmarks.public.run import chance_of
from benchmarks.public.scores import binomial_range, pool, score_run
from benchmarks.public.tasks import MOST_STEPS, RUN, SHORT, STEP, leads, stretches
from seatrial.campaign.data.import_logs import Trials
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.prediction.prediction_scores import DIVERGES


def record(u, step=0.5, label="run"):
    u = np.asarray(u, float)
    time = step * np.arange(u.size)
    columns = {"tau_X": np.sin(time), "u": u}
    channels = Channel("tau_X", "N", "control"), Channel("u", "m/s", "measurement")
    return make_record(time, columns, channels, Provenance("test", ""), label)


def test_scores_of_a_run_by_plain_sums():
    random = np.random.default_rng(1)
    n = 60
    time, mean, sd = np.arange(n) * 0.1, random.normal(size=n), random.uniform(0.5, 2.0, n)
    measured = mean + sd * random.normal(size=n)
    measured[[3, 17]] = np.nan
    mean[0] = np.nan
    found = score_run("run", "u", time, measured, mean, sd)
    kept = [k for k in range(n) if k not in (0, 3, 17)]
    average = sum(measured[k] for k in kept) / len(kept)
    sse = sum((measured[k] - mean[k]) ** 2 for k in kept)
    sst = sum((measured[k] - average) ** 2 for k in kept)
    density = [scipy.stats.norm.logpdf(measured[k], mean[k], sd[k]) for k in kept]
    inside = [abs(measured[k] - mean[k]) <= 1.6448536269514722 * sd[k] for k in kept]
    half = [abs(measured[k] - mean[k]) <= 0.6744897501960817 * sd[k] for k in kept]

    def crps(k):
        """By quadrature of its definition."""
        below = scipy.integrate.quad(lambda x: scipy.stats.norm.cdf(x, mean[k], sd[k]) ** 2, -20, measured[k])[0]
        above = scipy.integrate.quad(lambda x: scipy.stats.norm.sf(x, mean[k], sd[k]) ** 2, measured[k], 20)[0]
        return below + above

    assert found.samples == len(kept)
    assert found.explained == pytest.approx(1 - sse / sst, rel=1e-12)
    assert found.log_score == pytest.approx(math.fsum(density) / len(kept), rel=1e-12)
    assert found.crps == pytest.approx(sum(map(crps, kept)) / len(kept), rel=1e-6)
    assert (found.coverage_90, found.coverage_50) == (sum(inside) / len(kept), sum(half) / len(kept))


def test_pooled_scores_are_those_of_all_samples():
    random = np.random.default_rng(2)
    parts = [(random.normal(3 * i, 1, n), random.normal(3 * i, 1, n), np.full(n, 1.3)) for i, n in enumerate((20, 50))]
    scores = [score_run(str(i), "u", np.arange(len(y)) * 1.0, y, mean, sd) for i, (y, mean, sd) in enumerate(parts)]
    found = pool(scores)
    y, mean, sd = (np.concatenate([part[i] for part in parts]) for i in range(3))
    within = sum(float(np.sum((part[0] - part[0].mean()) ** 2)) for part in parts)
    assert found.explained == pytest.approx(1 - float(np.sum((y - mean) ** 2)) / within)
    assert found.log_score == pytest.approx(float(scipy.stats.norm.logpdf(y, mean, sd).mean()))
    assert found.coverage_90 == pytest.approx(float(np.mean(np.abs(y - mean) < 1.6448536 * sd)))
    assert found.effective == pytest.approx(sum(score.effective for score in scores))


def test_one_run_that_diverges_leaves_no_pooled_number():
    good = score_run("a", "u", np.arange(9.0), np.arange(9.0), np.arange(9.0) + 0.1, np.ones(9))
    bad = score_run("b", "u", np.arange(9.0), np.arange(9.0), np.full(9, np.inf), np.ones(9))
    assert bad.missing == DIVERGES
    found = pool([good, bad])
    assert (found.failed, found.crps, found.coverage_90, found.holds) == (1, None, None, None)


def test_the_range_of_a_coverage():
    assert binomial_range(9.9, 0.9) is None
    low, high = binomial_range(100.4, 0.9)
    inside = sum(scipy.stats.binom.pmf(k, 100, 0.9) for k in range(round(100 * low), round(100 * high) + 1))
    assert 0.95 <= inside < 0.98


def test_chance_is_that_of_a_paired_test_of_runs():
    ours, theirs = np.array([1.0, 1.3, 0.9, 1.6]), np.array([0.9, 1.1, 1.0, 1.2])
    expected = scipy.stats.ttest_rel(ours, theirs, alternative="greater").pvalue
    assert chance_of(ours - theirs, np.full(4, 50.0)) == pytest.approx(expected, rel=1e-12)
    assert chance_of(np.array([0.1, 0.1, 0.1]), np.ones(3)) < 1e-12


def test_stretches_begin_where_everything_is_measured():
    u = np.linspace(0.0, 1.0, 41)
    u[[0, 10, 11]] = np.nan
    one = record(u)
    assert stretches(RUN, one, ["u"], 5.0) == [(1, 40)]
    assert stretches(SHORT, one, ["u"], 5.0) == [(1, 12), (12, 21), (21, 31), (31, 40)]
    steps = stretches(STEP, one, ["u"], 5.0)
    assert (9, 12) in steps
    assert len(steps) == 37
    long = stretches(STEP, record(np.sin(np.arange(4000.0))), ["u"], 5.0)
    assert MOST_STEPS / 2 < len(long) <= MOST_STEPS
    assert leads([(1, 3), (5, 6)], 8).tolist() == [0, 0, 1, 2, 0, 0, 1, 0]


def test_spread_of_a_method_that_knows_only_means():
    """A random walk that is held: its error grows as the root of the lead."""
    random = np.random.default_rng(4)
    walk = [record(np.cumsum(random.normal(size=4000)), label=str(i)) for i in range(4)]

    def hold(one, pieces):
        found = np.full((one.time.size, 1), np.nan)
        for begin, end in pieces:
            found[begin + 1 : end + 1, 0] = one.channel("u")[begin]
        return found

    class Campaign:
        channels = ("u",)

    fitted = with_spread(Problem(Campaign(), Trials(tuple(walk), (), ""), None), hold, {})
    pieces = [(begin, begin + 20) for begin in range(0, 3000, 20)]
    sd = fitted.predict(walk[0], pieces).sd[1:21, 0]
    expected = np.sqrt(np.arange(1, 21))
    # Of 4 runs of 200 stretches the root mean square has a relative error of 1 / sqrt(2 * 800) = 2.5 %.
    np.testing.assert_allclose(sd, expected, rtol=0.1)
