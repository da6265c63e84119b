"""Verdicts on trials whose errors are known to be right, too large, too small, slow, lopsided, or not there at all."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import stats

from seatrial.core.findings import Finding
from seatrial.estimation.prediction.fit_verdict import judge_fit, worst
from seatrial.estimation.prediction.prediction import within_bounds
from seatrial.estimation.prediction.prediction_scores import DIVERGES, SlowNoise, score_channel
from seatrial.estimation.priors import Normal, Uniform
from seatrial.messages.render import statement

TIME = np.arange(1200) * 0.05
MOTION = np.sin(0.4 * TIME)
NOISE = 0.1


def scored(errors, *, mean=MOTION, motion_sd=0.005, noise=NOISE, **options):
    return score_channel(TIME, MOTION + errors, mean, np.full(TIME.size, motion_sd), noise, **options)


def white(scale=NOISE, seed=0):
    return scale * np.random.default_rng(seed).normal(size=TIME.size)


def slow(tau, scale=NOISE, seed=1):
    """An Ornstein-Uhlenbeck process of correlation time tau, s."""
    rng, rho, e = np.random.default_rng(seed), np.exp(-0.05 / tau), [0.0]
    for _ in range(TIME.size - 1):
        e.append(rho * e[-1] + np.sqrt(1 - rho**2) * rng.normal())
    return scale * np.array(e)


def verdict(score, held_back=False, noise="white", feedback=False) -> Finding:
    return judge_fit(score, "u", held_back, noise, feedback=feedback)


def test_numbers_by_hand():
    errors = white()
    found = scored(errors)
    sd = np.hypot(NOISE, 0.005)
    assert found.rmse == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert found.variance == pytest.approx(np.mean(errors**2) / sd**2)
    assert found.coverage == np.mean(np.abs(errors) <= 1.6448536 * sd)
    assert found.coverage_50 == np.mean(np.abs(errors) <= 0.6744898 * sd)
    measured = MOTION + errors
    assert found.explained == pytest.approx(1 - np.sum(errors**2) / np.sum((measured - measured.mean()) ** 2))
    assert found.nrmse == pytest.approx(1 - np.sqrt(1 - found.explained))
    assert sum(found.pit) == pytest.approx(1.0)
    assert found.samples == 1200
    assert found.missing == ""
    assert repr(found).startswith(f"Score: 1200 samples, worth {found.effective:.0f} independent ones; ")
    assert found._repr_html_().startswith("<pre>Score: ")


def test_false_alarms_are_rare():
    """Of 300 right trials at most 3 % are cautioned, four errors above the 1 % of one test."""
    assert sum(verdict(scored(white(seed=s))).level != "pass" for s in range(300)) <= 9


@pytest.mark.parametrize(
    ("scale", "level", "code"),
    [
        (1.25, "pass", "prediction-agrees"),
        (1.6, "caution", "band-too-narrow"),
        (2.5, "alarm", "errors-beyond-stated"),
        (0.6, "caution", "band-too-wide"),
    ],
)
def test_size_of_the_errors(scale, level, code):
    found = verdict(scored(white(scale * NOISE)), held_back=True)
    assert (found.level, found.code) == (level, code)


def test_white_noise_on_slow_residuals():
    """Half of the variance is white: the correlation of neighbours, 0.45, would say a factor of 1.6, and it is sqrt((1 + 20) / 2) = 3.2."""
    found = verdict(scored(np.sqrt(0.5) * (slow(0.5) + white())))
    assert (found.code, found.remedies) == ("residuals-correlated", ("drifting-noise",))
    assert found.values["factor"] == pytest.approx(3.2, rel=0.3)


def test_an_uncertain_motion_is_one_error_and_not_a_thousand():
    """Off by 2.5 standard deviations of a motion that is common to the trial: no sample inside, yet nothing that could be judged."""
    off = scored(white(0.01) + 0.5, motion_sd=0.2, noise=0.01)
    assert off.coverage < 0.01
    assert off.effective < 1.1
    found = verdict(off, held_back=True)
    assert found.level == "note"
    assert (found.code, found.values["effective"]) == ("samples-too-few", off.effective)
    assert verdict(replace(off, effective=9.97), held_back=True).code == "samples-too-few"
    assert verdict(scored(white(0.01) + 0.5, motion_sd=0.002, noise=0.01), held_back=True).level == "alarm"


def test_slow_residuals():
    """The factor is that of an autoregressive process, sqrt((1 + rho) / (1 - rho)) = 3.2 for 0.25 s in steps of 0.05 s."""
    errors = slow(0.25)
    found = verdict(scored(errors))
    assert found.code == "residuals-correlated"
    assert found.values["factor"] == pytest.approx(3.2, rel=0.2)
    assert found.remedies == ("coloured-noise",)
    assert verdict(scored(errors, slow=SlowNoise(0.25, 1.0)), noise="coloured").level == "pass"
    through = verdict(scored(errors), feedback=True)
    assert through.code == "residuals-biased"
    assert through.remedies == ("filter-error",)
    assert verdict(scored(white()), feedback=True).level == "pass"
    both = np.sqrt(0.5) * (errors + white())
    assert verdict(scored(np.sqrt(0.5) * (slow(2.0) + white()))).remedies == ("drifting-noise",)
    assert verdict(scored(both, slow=SlowNoise(0.25, 0.5)), noise="coloured").level == "pass"
    assert verdict(scored(both, slow=SlowNoise(0.25, 1.0)), noise="coloured").code == "residuals-beyond-model"
    assert verdict(scored(both, slow=SlowNoise(0.25, 1.0)), noise="coloured").remedies[1:] == ("missing-term",)
    assert verdict(scored(both, slow=SlowNoise(0.25, 1.0)), noise="drifting").remedies == ("missing-term",)
    wrong = verdict(scored(errors, slow=SlowNoise(0.01, 1.0)), noise="coloured")
    assert wrong.code == "residuals-beyond-model"
    assert verdict(scored(white() - np.roll(white(), 1), noise=1.4 * NOISE)).code == "residuals-opposite"


def test_a_lopsided_error():
    found = verdict(scored(NOISE * (np.random.default_rng(2).exponential(size=TIME.size) - 0.3)))
    assert found.code == "errors-not-normal"
    assert found.values["side"] > 0.5


def test_little_motion_explained():
    hidden = verdict(scored(white(5.0), noise=5.0))
    assert hidden.code == "noise-hides-motion"
    ignorant = verdict(scored(white(), mean=-MOTION, motion_sd=2.0), held_back=True)
    assert ignorant.level == "note"
    assert ignorant.values["explained"] < 0
    assert (ignorant.values["why"], ignorant.remedies) == ("coefficients-uncertain", ("next-trial",))


def test_the_coefficients_are_blamed_only_where_their_uncertainty_covers_the_errors():
    """Half the motion is missed and the band is wide: by the coefficients, by slow noise of the fit, or by pushes of process noise."""
    missed, wide = 0.1 * MOTION, np.full(TIME.size, 0.8)
    noise = scored(white(), mean=missed, noise=0.6, slow=SlowNoise(1.2, 1.0))
    found = verdict(replace(noise, effective=20.0, noise_share=0.4), held_back=True, noise="coloured")
    assert found.code == "predicted-poorly"
    assert (found.values["noise_sd"], found.values["correlation_time"]) == (0.6, 1.2)
    known = scored(white(), mean=missed, motion_sd=0.8)
    assert verdict(replace(known, effective=20.0), held_back=True).remedies == ("next-trial",)
    pushed = score_channel(TIME, MOTION + white(), missed, wide, NOISE, coefficient_sd=0.01 * wide)
    assert pushed.coefficient_share < 0.001
    assert "next-trial" not in verdict(replace(pushed, effective=20.0), held_back=True).remedies


def test_a_measurement_that_never_changes():
    found = score_channel(TIME, np.full(TIME.size, 0.3), np.full(TIME.size, 0.3), np.zeros(TIME.size), NOISE)
    assert found.explained == found.nrmse == 0.0
    assert found.missing == "the measurement never changes"
    assert found.rmse == 0.0
    assert "signal-constant" in (verdict(found).code, verdict(found).values.get("why"))
    assert verdict(found).level == "note"


def test_a_channel_without_measurements():
    found = score_channel(TIME, np.full(TIME.size, np.nan), MOTION, np.zeros(TIME.size), NOISE)
    assert found.samples == 0
    assert repr(found).startswith("Score: 0 samples; ")
    assert verdict(found, held_back=True) == Finding("channel-not-measured", "note", ("u",), {}, ("check-map",))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_few_measurements(count):
    measured = np.full(TIME.size, np.nan)
    measured[:: TIME.size // count] = (MOTION + white())[:: TIME.size // count]
    found = score_channel(TIME, measured, MOTION, np.full(TIME.size, 0.01), NOISE)
    assert 0 < found.samples <= count + 1
    assert np.isfinite([x for x in vars(found).values() if isinstance(x, float)]).all()
    assert statement(verdict(found))


def test_a_prediction_that_diverges_fails():
    mean = np.where(TIME > 30, np.inf, MOTION)
    found = score_channel(TIME, MOTION, mean, np.zeros(TIME.size), NOISE)
    assert verdict(found).level == "alarm"
    assert verdict(found).code == "prediction-diverges"


def test_the_worst_channel_speaks_for_the_trial():
    levels = [
        Finding("prediction-agrees", "pass"),
        Finding("band-too-wide", "caution"),
        Finding("errors-beyond-stated", "alarm"),
        Finding("prediction-diverges", "alarm"),
    ]
    assert worst(levels) == levels[2]
    assert worst(levels[:2]) == levels[1]


@pytest.mark.parametrize(("inside", "narrow"), [(11, True), (12, False)])
def test_so_few_samples_in_the_band_are_no_chance_by_the_binomial_law(inside, narrow):
    """Of 18 independent samples, each inside with probability 0.9, 11 or fewer are in 0.12 % of trials, 12 or fewer in 0.64 %."""
    assert (stats.binom(18, 0.9).cdf(inside) < 0.00135) == narrow
    score = replace(scored(white()), effective=18.0, coverage=inside / 18, variance=1.0)
    assert (verdict(score).code == "band-too-narrow") == narrow


def changed(**numbers):
    """A right trial's score with some of its numbers set, judged as if worth 400 independent samples."""
    whole = {"effective": 400.0, "coverage": 0.9, "variance": 1.0, "explained": 0.9, "noise_share": 0.1}
    even = {"pit_distance": 0.0, "correlation": 0.0, "white": 1.0, "missing": ""}
    rho = numbers.get("correlation", 0.0)
    even |= {"second": rho**2, "sd_factor": np.sqrt((1 + rho) / (1 - rho))}
    return verdict(replace(scored(white()), **{**whole, **even, **numbers}), held_back=True)


@pytest.mark.parametrize(
    ("numbers", "code"),
    [
        ({"coverage": 0.81}, "prediction-agrees"),
        ({"coverage": 0.79}, "band-too-narrow"),
        ({"coverage": 0.61}, "band-too-narrow"),
        ({"coverage": 0.59}, "errors-beyond-stated"),
        ({"coverage": 0.59, "effective": 2.0}, "samples-too-few"),
        ({"variance": 1.95}, "prediction-agrees"),
        ({"variance": 2.05}, "band-too-narrow"),
        ({"variance": 3.95}, "band-too-narrow"),
        ({"variance": 4.05}, "errors-beyond-stated"),
        ({"variance": 2.05, "effective": 2.0}, "samples-too-few"),
        ({"variance": 0.55, "coverage": 0.99}, "prediction-agrees"),
        ({"variance": 0.45, "coverage": 0.99}, "band-too-wide"),
        ({"variance": 0.45, "coverage": 0.97}, "prediction-agrees"),
        ({"variance": 0.45, "coverage": 0.99, "effective": 5.0}, "samples-too-few"),
        ({"variance": 0.45, "coverage": 0.99, "missing": "the measurement never changes"}, "signal-constant"),
        ({"effective": 10.0}, "prediction-agrees"),
        ({"effective": 9.9}, "samples-too-few"),
        ({"effective": 1.0, "variance": 10.2}, "samples-too-few"),
        ({"effective": 1.0, "variance": 10.4}, "errors-beyond-stated"),
        ({"explained": 0.51}, "prediction-agrees"),
        ({"explained": 0.49}, "predicted-poorly"),
        ({"explained": 0.49, "noise_share": 0.49}, "predicted-poorly"),
        ({"explained": 0.49, "noise_share": 0.51}, "noise-hides-motion"),
        ({"correlation": 0.11, "white": 0.001}, "residuals-correlated"),
        ({"correlation": -0.11, "white": 0.001}, "residuals-opposite"),
        ({"correlation": 0.09, "white": 0.001}, "prediction-agrees"),
        ({"correlation": -0.09, "sd_factor": 0.5, "white": 0.001}, "prediction-agrees"),
        ({"correlation": 0.5, "white": 0.02}, "prediction-agrees"),
        ({"pit_distance": 0.11}, "errors-not-normal"),
        ({"pit_distance": 0.09}, "prediction-agrees"),
        ({"pit_distance": 0.16, "effective": 100.0}, "prediction-agrees"),
        ({"pit_distance": 0.17, "effective": 100.0}, "errors-not-normal"),
    ],
)
def test_each_departure_counts_from_where_it_matters_and_is_no_chance(numbers, code):
    """Errors 1.4 times those stated, half the variance, a tenth of a correlation; 1.63 over the root of the samples is chance."""
    found = changed(**numbers)
    assert (found.code, found.level == "pass") == (code, code == "prediction-agrees")


@pytest.mark.parametrize(("pit", "side"), [((0.1, 0.1, 0.4, 0.4), 0.8), ((0.7, 0.0, 0.1, 0.2), 0.7)])
def test_the_side_to_which_errors_lie_is_reported(pit, side):
    assert changed(pit_distance=0.3, pit=pit).values["side"] == pytest.approx(side)
    assert changed(pit_distance=0.3, pit=(0.45, 0.0, 0.1, 0.45)).values["side"] == 0.0


def test_a_bad_fit_is_told_otherwise_than_a_bad_prediction():
    poor = replace(scored(white()), explained=0.3, pit_distance=0.0)
    assert verdict(poor).code == "fitted-poorly"
    assert verdict(scored(white(2.5 * NOISE))).remedies == ("look-at-residuals",)
    assert verdict(scored(white(2.5 * NOISE)), held_back=True).remedies == ("look-at-trial",)
    assert verdict(scored(white(1.6 * NOISE)), held_back=True).remedies == ("more-trials",)
    assert verdict(scored(white(1.6 * NOISE))).remedies == ("outliers-or-term",)


def test_samples_that_a_trial_is_worth():
    """White errors of the sensor alone are worth all; where half of each variance is motion's, which is common, about four."""
    independent = scored(white(), motion_sd=0.0).effective
    assert independent == pytest.approx(1200, rel=0.2)
    assert scored(white(), motion_sd=NOISE).effective == pytest.approx(1 / (0.25 + 0.75 / independent), rel=1e-12)


def test_scores_of_the_whole_distribution_by_hand():
    """Continuous ranked probability score of a normal prediction in closed form (Gneiting and Raftery, 2007), and the noise's share."""
    found, sd = scored(white(), motion_sd=NOISE), NOISE * np.sqrt(2)
    z = white() / sd
    each = sd * (z * (2 * stats.norm.cdf(z) - 1) + 2 * stats.norm.pdf(z) - 1 / np.sqrt(np.pi))
    assert found.crps == pytest.approx(each.mean())
    assert found.log_score == pytest.approx(stats.norm.logpdf(white() + MOTION, MOTION, sd).mean())
    assert found.noise_share == pytest.approx(NOISE**2 / (MOTION + white()).var())
    assert scored(white(), noise=5.0).noise_share == 1.0


@pytest.mark.parametrize("factor", [57.3, 60.0, 1000.0])
@pytest.mark.parametrize("samples", [3, 1200])
def test_a_run_in_other_units_fails_however_short(factor, samples):
    rate = np.radians(5) * np.cos(0.4 * TIME[:samples])
    found = score_channel(TIME[:samples], factor * rate, rate, np.full(samples, 0.002), 0.005)
    judged = judge_fit(found, "r", held_back=True, noise="white")
    assert (judged.level, judged.remedies) == ("alarm", ("look-at-trial",))


def test_a_run_of_three_samples_is_unjudged():
    found = score_channel(TIME[:3], MOTION[:3] + np.array([0.1, -0.1, 0.05]), MOTION[:3], np.full(3, 0.01), NOISE)
    assert verdict(found, held_back=True).level == "note"


def test_a_run_that_leaves_the_fitted_range_is_told_to_be_fitted_too():
    judged = judge_fit(scored(white(2.5 * NOISE)), "u", True, "white", outside=True)
    assert judged.remedies == ("fit-as-far", "look-at-trial")


def test_gaps_are_left_out():
    gappy = np.where(np.arange(TIME.size) % 3 == 0, MOTION + white(), np.nan)
    found = score_channel(TIME, gappy, MOTION, np.full(TIME.size, 0.005), NOISE)
    third = score_channel(TIME[::3], gappy[::3], MOTION[::3], np.full(400, 0.005), NOISE)
    assert found == third
    assert found.samples == 400
    assert found.interval == pytest.approx(0.15)


def test_what_a_run_draws_of_its_own_stays_inside_the_prior_of_its_coefficient():
    """X_u = -1 with a spread of 2 has its bound 0 at half a spread: the normal that is cut there, and no other draw is changed."""
    count = 4000
    known = {"X_u": np.full(count, -1.0), "spread_X_u": np.full(count, 2.0)}
    priors, key = {"X_u": Uniform(-50.0, 0.0)}, jax.random.key(2)
    drawn = Normal(0.0, 1.0).draw(key, (count,))
    cut = within_bounds("dev_X_u[any]", drawn, known, priors, key)
    inside = np.asarray(drawn) < 0.5
    assert np.array_equal(cut[inside], np.asarray(drawn)[inside])
    assert stats.kstest(cut, stats.truncnorm(-24.5, 0.5).cdf).pvalue > 0.01
    assert within_bounds("bias_u[any]", drawn, known, priors, key) == pytest.approx(np.asarray(drawn))
    at_bound = within_bounds("dev_X_u[any]", drawn, {**known, "X_u": np.full(count, -1e-15)}, priors, key)
    assert np.isfinite(at_bound).all()
    assert (at_bound <= 1e-12).all()


@pytest.mark.parametrize(("far", "missing"), [(1e3, ""), (1e7, DIVERGES), (3.6e50, DIVERGES), (np.inf, DIVERGES)])
def test_a_prediction_that_goes_far_beyond_what_was_measured_diverges(far, missing):
    """Also where its band is as wide, so that all measurements lie inside."""
    time = np.arange(40.0)
    measured = np.sin(time)
    for mean, sd in ((far, 0.1), (0.0, far)):
        score = score_channel(time, measured, np.full(40, mean), np.full(40, sd), noise_sd=0.1)
        assert score.missing == missing
    assert (judge_fit(score, "u", True, "white").level == "alarm") == bool(missing)
