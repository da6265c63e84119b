from dataclasses import replace
from functools import cache
from math import comb

import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError, NumericalError
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.noise_from_differences import MAX_ORDER, _relative_error, noise_from_high_pass
from seatrial.filters.run import run_filter
from seatrial.filters.tuning import LEVEL, TuningReport, _band, _findings, check_tuning
from seatrial.messages.render import sentence
from tests.cases import X_U, naive_rk4, surge_rate
from tests.estimation_cases import golden_motion
from tests.filters.surge_trial import MEASUREMENT_SD, TRUE_STATE, surge_space

N = 1500
PRIOR_SD = np.array([0.05, 0.3, 0.005])
PROCESS_SD = np.array([0.003, 1e-6, 1e-8])
SEEDS = range(4)


@cache
def trial(seed, n=N):
    """Truth drawn from the prior, moved with process noise, and measured; random steps of 2.5 s."""
    rng = np.random.default_rng(seed)
    truth = TRUE_STATE + PRIOR_SD * rng.normal(size=3)
    rev_per_s, u, measured, speed = np.repeat(rng.uniform(8, 17, n // 25), 25), truth[0], [], []
    for rev in rev_per_s:
        speed.append(u)
        measured.append(np.array([u, surge_rate(u, rev, X_U, *truth[1:])]) + MEASUREMENT_SD * rng.normal(size=2))
        u = naive_rk4(lambda x, rev=rev: surge_rate(x, rev, X_U, *truth[1:]), u, 0.1) + PROCESS_SD[0] * rng.normal()
    return 2 * np.pi * rev_per_s[:, None], np.array(measured), np.full(n, 0.1), np.array([speed[-1], *truth[1:]])


def report(seed, p=1.0, q=1.0, r=1.0, n=N, gaps=None):
    """Report on a filter whose P_0, Q and R are wrong by these factors."""
    control, measured, step, truth = trial(seed, n)
    measured = measured if gaps is None else np.where(np.arange(n)[:, None] % np.array(gaps) == 0, measured, np.nan)
    sds = (sd * np.sqrt(factor) for sd, factor in ((PRIOR_SD, p), (PROCESS_SD, q), (MEASUREMENT_SD, r)))
    space = surge_space(TRUE_STATE, *sds)
    return check_tuning(run_filter(ExtendedKalmanFilter(), space, control, measured, step), space, truth)


def changes_of(findings):
    """What each finding changes, and in which direction."""
    return [(finding.values["what"], finding.values["direction"]) for finding in findings]


@pytest.mark.parametrize("gaps", [None, (3, 4)], ids=["complete", "two rates"])
@pytest.mark.parametrize("seed", SEEDS)
def test_well_tuned(seed, gaps):
    found = report(seed, gaps=gaps)
    assert found.findings == ()
    assert found.nis_band[0] < found.nis < found.nis_band[1]
    assert found.moved_band[0] < found.moved < found.moved_band[1]
    assert found.nees_band[0] < found.nees < found.nees_band[1]
    assert (found.whiteness > 0.001).all()
    assert found.settling == pytest.approx(np.sqrt(0.75), abs=0.08)
    assert (found.erratic < 1.5).all()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("factors", "change", "words"),
    [
        ({"r": 100}, ("R", "down"), ["smaller than R alone", "u to a standard deviation of 0.02", "udot"]),
        ({"r": 0.01}, ("R", "up"), ["chases the noise", "Raise R of u", "udot to a standard deviation of 0.0"]),
        ({"q": 1e4}, ("Q", "down"), ["though not smaller than R", "chases the noise", "Lower Q of u"]),
        ({"q": 1e-4}, ("Q", "up"), ["are correlated in time", "Raise Q of u"]),
        ({"p": 1e6}, ("P", "down"), ["P_0 expects the constants to move", "Lower P_0 of X_uabsu and T_nabsn"]),
        ({"p": 1e-3}, ("P", "up"), ["Raise P_0 of X_uabsu and T_nabsn, then check again"]),
    ],
    ids=lambda x: str(x) if isinstance(x, dict) else "",
)
def test_the_wrong_matrix_is_named(factors, change, words, seed):
    findings = report(seed, **factors).findings
    assert changes_of(findings) == [change]
    assert all(word in sentence(findings[0]) for word in words)


def test_one_wrong_channel_is_named():
    (finding,) = report(0, r=np.array([1.0, 100.0])).findings
    assert finding.code == "r-too-large"
    assert finding.subject == ("udot",)
    assert finding.values["sds"][0] == pytest.approx(0.05, rel=0.1)


def test_noise_that_moves_the_constants_is_no_fault_of_p():
    """Measured noise taken for motion of u pushes a constant further than P_0 allows; small innovations tell it from a small P_0."""
    found = report(1, p=0.01, q=np.array([1e6, 1.0, 1.0]))
    assert found.moved > found.moved_band[1]
    assert changes_of(found.findings) == [("Q", "down")]


def test_constants_that_may_drift_are_erratic():
    findings = report(0, q=np.array([1.0, 1e9, 1e9])).findings
    assert set(changes_of(findings)) == {("Q", "down")}
    assert any((finding.code, finding.subject) == ("estimate-erratic", ("X_uabsu",)) for finding in findings)


def test_trial_that_is_too_short_has_not_settled():
    """The first 2.5 s hold one propeller speed: the second step brings most of what is known."""
    control, measured, step, _ = trial(0)
    control = np.where(np.arange(100)[:, None] < 80, control[0], control[0] + 40)
    space = surge_space(TRUE_STATE, 100 * PRIOR_SD, PROCESS_SD, MEASUREMENT_SD)
    found = check_tuning(run_filter(ExtendedKalmanFilter(), space, control, measured[:100], step[:100]), space)
    assert ("trial", "longer") in changes_of(found.findings)
    assert found.settling.min() < 0.75
    assert np.isnan(found.nees)


def test_numbers_by_hand():
    control, measured, step, truth = trial(1)
    space = surge_space(TRUE_STATE, PRIOR_SD, PROCESS_SD, MEASUREMENT_SD)
    trace = run_filter(ExtendedKalmanFilter(), space, control, measured, step)
    found, e = check_tuning(trace, space, truth), np.asarray(trace.innovations)[N // 2 :]
    assert found.nis == pytest.approx(np.asarray(trace.nis)[N // 2 :].mean() / 2, rel=1e-12)
    assert found.spread == pytest.approx((e**2).mean(0) / MEASUREMENT_SD**2, rel=1e-12)
    assert found.correlation == pytest.approx([np.corrcoef(x[1:], x[:-1])[0, 1] for x in e.T], abs=0.005)
    error, moved = np.asarray(trace.final.mean) - truth, np.asarray(trace.final.mean)[1:] - TRUE_STATE[1:]
    assert found.nees == pytest.approx(error @ np.linalg.solve(trace.final.cov, error) / 3, rel=1e-9)
    gained = np.diag(PRIOR_SD[1:] ** 2 + N * PROCESS_SD[1:] ** 2) - np.asarray(trace.final.cov)[1:, 1:]
    assert found.moved == pytest.approx(moved @ np.linalg.solve(gained, moved) / 2, rel=1e-6)


def test_wrong_truth_is_noticed():
    control, measured, step, truth = trial(0)
    space = surge_space(TRUE_STATE, PRIOR_SD, PROCESS_SD, MEASUREMENT_SD)
    trace = run_filter(ExtendedKalmanFilter(), space, control, measured, step)
    (finding,) = check_tuning(trace, space, truth + 8 * np.asarray(trace.sds)[-1]).findings
    assert finding.code == "states-beyond-stated"


def test_traces_that_cannot_be_judged():
    control, measured, step, _ = trial(0)
    space = surge_space(TRUE_STATE, PRIOR_SD, PROCESS_SD, MEASUREMENT_SD)
    trace = run_filter(ExtendedKalmanFilter(), space, control, measured, step)
    with pytest.raises(NumericalError, match="failed at 3 samples"):
        check_tuning(trace._replace(failures=np.array(3)), space)
    with pytest.raises(InputError, match="longer record"):
        report(0, n=50, gaps=(1, 3))


SIGNALS = {
    "nothing": (np.arange(1000) * 0.1, np.zeros(1000), 0.05),
    "golden speed": (golden_motion()[0], golden_motion()[2], 0.0757),
    "coarse speed": (golden_motion()[0][::20], golden_motion()[2][::20], 0.02),
    "fast sine": (np.arange(2000) * 0.05, np.sin(np.arange(2000) * 0.1), 0.01),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_noise_is_within_its_stated_error(name):
    """Root mean square of 100 errors over what is stated is 1 with an error of 0.07, of which 4 are allowed."""
    time, signal, sd = SIGNALS[name]
    found = [
        noise_from_high_pass(time, signal + sd * np.random.default_rng(i).normal(size=time.size)) for i in range(100)
    ]
    scores = np.array([(estimate.sd - sd) / estimate.std_error for estimate in found])
    assert np.sqrt((scores**2).mean()) == pytest.approx(1, abs=0.28)
    assert np.abs(scores).max() < 4
    assert max(estimate.std_error for estimate in found) < 0.15 * sd


def test_outliers_steps_and_gaps_do_not_matter():
    """One sample in 200 is off by 50 sds, the signal jumps, and a third is missing in one stretch of alternate samples."""
    rng = np.random.default_rng(3)
    time, sd = np.arange(4000) * 0.05, 0.02
    measured = np.where(time > 90, 1.0, 0.0) + sd * rng.normal(size=4000)
    measured[rng.integers(0, 4000, 20)] += 1.0
    measured[1000:2000:2] = np.nan
    found = noise_from_high_pass(time, measured)
    assert abs(found.sd - sd) < 4 * found.std_error
    assert found.std_error < 0.05 * sd


def test_unit_carries_over():
    rng = np.random.default_rng(0)
    time, measured = np.arange(500) * 0.1, rng.normal(size=500)
    one, other = noise_from_high_pass(time, measured), noise_from_high_pass(60 * time, 1e3 * measured)
    assert other == pytest.approx((1e3 * one.sd, 1e3 * one.std_error, one.order))


@pytest.mark.parametrize(
    ("measured", "words"),
    [
        (np.full(1000, np.nan), "0 differences"),
        (np.arange(30.0), "at least 50"),
        (np.round(np.arange(1000) / 100), "steps"),
        (np.random.default_rng(2).integers(0, 3, 1000) / 10, "steps"),
        (np.cumsum(np.where(np.arange(1000) % 5 == 0, np.random.default_rng(2).normal(size=1000), 0.0)), "steps"),
    ],
    ids=["nothing", "few", "quantised", "three steps", "seldom anew"],
)
def test_data_without_visible_noise_are_refused(measured, words):
    with pytest.raises(InputError, match=words):
        noise_from_high_pass(np.arange(measured.size) * 0.1, measured)


@pytest.mark.parametrize("freedom", [1, 10, 400])
def test_band_leaves_out_as_much_on_either_side(freedom):
    low, high = _band(freedom)
    law = stats.chi2(freedom)
    assert law.cdf(low * freedom) == pytest.approx(LEVEL / 2)
    assert law.sf(high * freedom) == pytest.approx(LEVEL / 2)


def test_order_of_the_differences_is_the_first_that_is_enough():
    """White noise about a level needs first differences, about a steep line second ones."""
    noise, time = 0.1 * np.random.default_rng(4).normal(size=4000), 0.1 * np.arange(4000)
    assert noise_from_high_pass(time, noise).order == 1
    assert noise_from_high_pass(time, noise + 50.0 * time).order == 2


@pytest.mark.parametrize("order", [1, 2, 4, 7])
def test_error_of_a_median_of_correlated_differences_by_bivariate_normals(order):
    """Twice the sum of what P(|x| < m, |y| < m) exceeds 1/4 by, over all lags, beside the 1/4 of a sample alone."""
    weights = np.array([(-1) ** i * comb(order, i) for i in range(order + 1)], float)
    m = stats.norm.ppf(0.75)
    variance = 0.25
    for lag in range(1, order + 1):
        rho = (weights[lag:] @ weights[:-lag]) / (weights @ weights)
        law = stats.multivariate_normal(cov=[[1, rho], [rho, 1]])
        box = law.cdf([m, m]) - law.cdf([m, -m]) - law.cdf([-m, m]) + law.cdf([-m, -m])
        variance += 2 * (box - 0.25)
    assert _relative_error(order) == pytest.approx(np.sqrt(variance) / (2 * stats.norm.pdf(m) * m), rel=2e-4)


@pytest.mark.parametrize(("samples", "judged"), [(50, False), (51, True)])
def test_fifty_differences_are_enough(samples, judged):
    """Of the first order; the higher ones have as many in a record longer by six."""
    measured = np.random.default_rng(5).normal(size=samples + 6)
    if judged:
        assert noise_from_high_pass(np.arange(samples + 6.0), measured).sd == pytest.approx(1.0, abs=0.5)
    else:
        with pytest.raises(InputError, match="49 differences of order 7"):
            noise_from_high_pass(np.arange(samples + 6.0) * 0.1, measured[: samples + 6])


def test_steps_that_are_a_tenth_longer_are_not_even():
    """Only differences over even steps count: here those of every third stretch of samples."""
    rng = np.random.default_rng(6)
    step = np.where(np.arange(3000) // 100 % 3 == 0, 1.0, np.where(np.arange(3000) % 2 == 0, 0.88, 1.12))
    time = np.cumsum(step)
    stretched = np.where(np.arange(3000) // 100 % 3 == 0, 0.1, 5.0) * rng.normal(size=3000)
    assert noise_from_high_pass(time, stretched).sd == pytest.approx(0.1, rel=0.1)
    near = np.cumsum(np.where(np.arange(3000) % 2 == 0, 1.0, 1.08))
    assert noise_from_high_pass(near, rng.normal(size=3000)).std_error < 0.05


SPACE = surge_space(TRUE_STATE, PRIOR_SD, PROCESS_SD, MEASUREMENT_SD)
TUNED = TuningReport(
    nis=1.0,
    nis_band=(0.95, 1.05),
    correlation=np.zeros(2),
    whiteness=np.ones(2),
    spread=np.ones(2),
    moved=1.0,
    moved_band=(0.01, 7.0),
    settling=np.array([0.9, 0.9]),
    erratic=np.ones(2),
    nees=1.0,
    nees_band=(0.1, 5.0),
)


@pytest.mark.parametrize(
    ("numbers", "changes"),
    [
        ({}, []),
        ({"moved": 6.9}, []),
        ({"moved": 7.1}, [("P", "up")]),
        ({"moved": 7.1, "nis": 0.91}, [("P", "up")]),
        ({"moved": 7.1, "nis": 0.89}, [("Q", "down")]),
        ({"moved": 7.1, "nis": 0.8, "nis_band": (0.7, 1.3)}, [("P", "up")]),
        ({"moved": 7.1, "nis": 0.69, "nis_band": (0.7, 1.3)}, [("Q", "down")]),
        ({"moved": 0.02}, []),
        ({"moved": 0.009}, [("P", "down")]),
        ({"nis": 1.09}, []),
        ({"nis": 1.11}, [("R", "up")]),
        ({"nis": 0.91}, []),
        ({"nis": 0.89}, [("Q", "down")]),
        ({"nis": 1.2, "nis_band": (0.7, 1.3)}, []),
        ({"nis": 0.8, "nis_band": (0.7, 1.3)}, []),
        ({"spread": np.array([1.0, 0.89])}, [("R", "down")]),
        ({"spread": np.array([1.0, 0.91])}, []),
        ({"correlation": np.array([0.0, 0.11]), "whiteness": np.array([1.0, 0.0009])}, [("Q", "up")]),
        ({"correlation": np.array([0.0, 0.09]), "whiteness": np.array([1.0, 0.0009])}, []),
        ({"correlation": np.array([0.0, 0.5]), "whiteness": np.array([1.0, 0.0011])}, []),
        ({"correlation": np.array([0.0, -0.11]), "whiteness": np.array([1.0, 0.0009])}, [("Q", "down")]),
        ({"correlation": np.array([0.0, -0.09]), "whiteness": np.array([1.0, 0.0009])}, []),
        ({"nis": 1.2, "correlation": np.array([0.2, 0.0]), "whiteness": np.zeros(2)}, [("Q", "up")]),
        ({"nis": 1.2, "correlation": np.array([-0.2, 0.0]), "whiteness": np.zeros(2)}, [("R", "up")]),
        ({"erratic": np.array([1.9, 1.0])}, []),
        ({"erratic": np.array([2.1, 1.0])}, [("Q", "down")]),
        ({"erratic": np.array([2.1, 1.0]), "nis": 1.2}, [("R", "up")]),
        ({"settling": np.array([0.9, 1.09])}, []),
        ({"settling": np.array([0.9, 1.11])}, [("Q", "down")]),
        ({"settling": np.array([0.76, 0.9])}, []),
        ({"settling": np.array([0.74, 0.9])}, [("trial", "longer")]),
        ({"nees": 4.9}, []),
        ({"nees": 5.1}, [("Q", "up")]),
        ({"nees": 0.09}, [("Q", "down")]),
        ({"nees": 0.11}, []),
        ({"nees": 5.1, "moved": 0.009}, [("P", "down")]),
        ({"nees": float("nan")}, []),
    ],
)
def test_each_finding_from_both_sides_of_its_limit(numbers, changes):
    found = _findings(replace(TUNED, **numbers), SPACE, [5000, 5000])
    assert changes_of(found) == changes


def test_what_the_findings_say_in_numbers():
    def words(**numbers):
        (finding,) = _findings(replace(TUNED, **numbers), SPACE, [5000, 5000])
        return sentence(finding)

    assert "moved 4 times as far" in words(moved=16.0)
    assert "20 times as far as they did" in words(moved=0.0025)
    assert "of T_nabsn grew by 20%" in words(settling=np.array([0.9, 1.2]))
    assert "of X_uabsu still fell by 40%" in words(settling=np.array([0.6, 0.9]))
    assert "NIS 1.5 for each" in words(nis=1.5, spread=np.array([1.0, 4.0]))
    assert f"Raise R of udot to a standard deviation of {2 * MEASUREMENT_SD[1]:.2g} or" in words(
        nis=1.5, spread=np.array([1.05, 4.0])
    )
    assert f"Lower R of u to a standard deviation of {0.5 * MEASUREMENT_SD[0]:.2g} or" in words(
        spread=np.array([0.25, 1.0])
    )
    assert "of udot are correlated in time (-0.30)" in words(correlation=np.array([0.2, -0.3]), whiteness=np.zeros(2))


def test_settling_and_travel_of_the_constants_by_hand():
    """A constant that zigzags by 0.1 with the deviation 1 / (k + 1): 49 steps in the second half, 0.1 net, and a walk's travel."""
    control, measured, step, _ = trial(0)
    trace = run_filter(ExtendedKalmanFilter(), SPACE, control[:100], measured[:100], step[:100])
    k = np.arange(100)
    means, sds = np.array(trace.means), np.array(trace.sds)
    means[:, 1], means[:, 2] = 0.1 * (k % 2), 0.02 * k
    sds[:, 1], sds[:, 2] = 1 / (k + 1), 0.5 + 0.01 * k
    found = check_tuning(trace._replace(means=means, sds=sds), SPACE)
    assert found.settling == pytest.approx([76 / 100, 1.49 / 1.25])
    walks = [np.sqrt(2 * 50 / np.pi) * sd for sd in (1 / 51, 1.49)]
    assert found.erratic == pytest.approx([4.9 / (0.1 + walks[0]), 0.98 / (0.98 + walks[1])])
    e = np.asarray(trace.innovations)[50:, 0]
    mean = e.mean()
    rho = [sum((e[i] - mean) * (e[i - lag] - mean) for i in range(lag, 50)) for lag in range(1, 11)] / (50 * e.var())
    statistic = 50 * 52 * sum(r**2 / (50 - lag) for lag, r in enumerate(rho, 1))
    assert found.correlation[0] == pytest.approx(rho[0])
    assert found.whiteness[0] == pytest.approx(stats.chi2.sf(statistic, 10))


@pytest.mark.parametrize(("measured_in_half", "judged"), [(19, False), (20, True)])
def test_twenty_measurements_in_the_second_half_are_enough(measured_in_half, judged):
    control, measured, step, _ = trial(0)
    gappy = np.where((np.arange(100) < 50 + measured_in_half)[:, None], measured[:100], np.nan)
    trace = run_filter(ExtendedKalmanFilter(), SPACE, control[:100], gappy, step[:100])
    if judged:
        assert np.isfinite(check_tuning(trace, SPACE).nis)
    else:
        with pytest.raises(InputError, match="19 measurements"):
            check_tuning(trace, SPACE)


@pytest.mark.parametrize(("counts", "found"), [([5000, 50], []), ([50, 5000], [("R", "down")])])
def test_small_innovations_of_few_measurements_may_be_chance(counts, found):
    """A mean of 50 squares is below 0.7 by chance too often to tell, one of 5000 never is."""
    findings = _findings(replace(TUNED, spread=np.array([1.0, 0.7])), SPACE, counts)
    assert changes_of(findings) == found


def test_a_signal_that_no_order_removes_counts_at_the_highest():
    """A sine of eight samples a period is 0.77 times smaller in each difference, by more than a median of 4000 errs."""
    time = 0.1 * np.arange(4000)
    found = noise_from_high_pass(time, np.sin(2 * np.pi / 8.1 * np.arange(4000)))
    assert found.order == MAX_ORDER
    gain = (2 * np.sin(np.pi / 8.1)) ** MAX_ORDER / np.sqrt(comb(2 * MAX_ORDER, MAX_ORDER))
    assert found.sd == pytest.approx(gain * np.sqrt(0.5) / stats.norm.ppf(0.75), rel=0.02)
