"""Every figure on small made-up data: what it shows, what it is called, and that it survives data at the edge."""

import numpy as np
import pytest

from seatrial.report.drawing import draw_svg
from seatrial.report.figures.fit import Driven, Predicted, autocorrelation, record_fit, record_residuals
from seatrial.report.figures.posterior import PriorShape, correlations, marginal, pair
from seatrial.report.figures.records import control_over_time, covered
from seatrial.report.figures.structures import probability_bars
from seatrial.report.figures.style import thin, thin_steps
from seatrial.report.figures.surface import design_surface
from seatrial.report.figures.traces import coefficient_trace

TIME = np.arange(400) * 0.1


def flat(lower, upper):
    """A uniform prior as stored."""
    value = np.linspace(lower, upper, 11)
    return PriorShape(
        lower, upper, 0.5 * (lower + upper), (upper - lower) / 12**0.5, False, value, np.full(11, 1 / (upper - lower))
    )


UNIFORM = flat(-6.0, 0.0)


def labels_of(axes) -> list[str]:
    return [str(artist.get_label()) for artist in (*axes.patches, *axes.lines, *axes.collections)]


def channel(label="$u$ [m/s]") -> Predicted:
    measured = np.sin(TIME) + 0.1 * np.random.default_rng(0).normal(size=TIME.size)
    measured[::4] = np.nan
    return Predicted(label, measured, np.sin(TIME), np.full(TIME.size, 0.1))


def test_the_surface_marks_the_best_design_and_hatches_what_is_forbidden():
    gain = np.add.outer(np.arange(5.0), np.arange(6.0))
    free = design_surface(np.arange(6.0), np.arange(5.0), gain, (4, 5), ("period [s]", "amplitude [rpm]"))
    gain[4, :3] = np.nan
    bound = design_surface(np.arange(6.0), np.arange(5.0), gain, (4, 5), ("period [s]", "amplitude [rpm]"))
    axes, bar = bound.axes
    assert axes.get_ylabel() == "amplitude [rpm]"
    assert "entropy reduction [nat]" in bar.get_ylabel()
    star = next(line for line in axes.lines if line.get_label() == "best design")
    assert (star.get_xdata()[0], star.get_ydata()[0]) == (5.0, 4.0)
    assert "breaks a limit" in labels_of(axes)
    assert "breaks a limit" not in labels_of(free.axes[0])


@pytest.mark.parametrize("shape", [(1, 5), (5, 1), (1, 1), (2, 2)])
def test_the_surface_of_a_thin_or_flat_grid_is_drawn(shape):
    figure = design_surface(
        np.arange(shape[1]) + 1.0,
        np.arange(shape[0]) + 1.0,
        np.full(shape, 2.0),
        (0, 0),
        ("period [s]", "amplitude [N]"),
    )
    assert "entropy reduction [nat]" in "".join(axes.get_ylabel() for axes in figure.axes)
    draw_svg(figure)


def test_a_control_shows_only_the_limits_that_are_near():
    (axes,) = control_over_time(TIME, np.sign(np.sin(TIME)), "$n$ [rpm]", (-1.2, 50.0)).axes
    assert labels_of(axes).count("limit") == 1
    assert axes.get_ylabel() == "$n$ [rpm]"


def test_probabilities_are_bars_with_errors_inside_zero_and_one():
    (axes,) = probability_bars(["M-0", "M-1"], [0.97, 0.03], [0.28, 0.28], 0).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["M-0", "M-1"]
    assert len(axes.patches) == 2
    segments = np.concatenate(axes.collections[0].get_segments())
    assert 0 <= segments[:, 0].min() <= segments[:, 0].max() <= 1


def test_a_fit_has_a_panel_for_each_channel_and_control():
    figure = record_fit(
        TIME, [channel(), channel("$v$ [m/s]")], [Driven("$n$ [rpm]", np.sin(TIME))], held_back=True, most=100
    )
    assert [axes.get_ylabel() for axes in figure.axes] == ["$u$ [m/s]", "$v$ [m/s]", "$n$ [rpm]"]
    assert {"measured", "predicted", "90 % band"} <= set(labels_of(figure.axes[0]))
    assert figure.axes[-1].get_xlabel() == "time [s]"


def test_residuals_are_in_standard_deviations_beside_their_autocorrelation():
    figure = record_residuals(TIME, [channel()])
    assert [axes.get_ylabel() for axes in figure.axes] == ["residual [sd]", "autocorr."]
    assert figure.axes[0].get_ylim()[1] >= 4


def test_autocorrelation_is_that_of_the_samples_present():
    residual = np.random.default_rng(1).normal(size=2000)
    residual[1::2] = residual[::2]
    lag, correlation, count = autocorrelation(np.arange(2000) * 0.5, residual)
    assert lag[0] == 0.5
    assert count == 2000
    assert correlation[0] == pytest.approx(0.5, abs=0.05)
    assert abs(correlation[1]) < 0.07
    assert autocorrelation(TIME, np.full(TIME.size, np.nan))[0].size == 0


def test_autocorrelation_across_gaps_is_that_of_samples_so_far_apart():
    random = np.random.default_rng(7)
    series = np.zeros(3000)
    for k in range(1, series.size):
        series[k] = 0.9 * series[k - 1] + random.normal()
    bursts = np.where(np.arange(series.size) % 30 < 10, series, np.nan)
    lag, correlation, _ = autocorrelation(np.arange(series.size) * 0.1, bursts)
    assert lag.max() == pytest.approx(6.0)
    assert not ((lag > 0.95) & (lag < 2.05)).any()
    centred = bursts - np.nanmean(bursts)
    for at in (0.1, 0.5, 2.5):
        k = round(at / 0.1)
        naive = np.nanmean(centred[k:] * centred[:-k]) / np.nanmean(centred**2) * (1 - k / 2980)
        assert correlation[np.argmin(abs(lag - at))] == pytest.approx(naive, abs=1e-3)


def test_a_trace_shows_where_records_begin_and_what_it_should_reach():
    sd = 1.0 / (1.0 + TIME)
    figure = coefficient_trace(
        TIME, -3.0 + sd, sd, "$X_{u}$", "kg/s", starts=[20.0], prior_mean=-1.0, posterior_mean=-3.0, truth=-3.01
    )
    (axes,) = figure.axes
    assert {"filter mean", "± 2 sd", "prior mean", "posterior mean", "true value"} <= set(labels_of(axes))
    assert axes.get_ylabel() == "$X_{u}$ [kg/s]"
    assert axes.get_ylim()[0] < -3.01 < axes.get_ylim()[1]


def test_a_posterior_shows_prior_interval_and_truth_and_pulls_out_powers_of_ten():
    draws = np.random.default_rng(2).normal(6e-4, 1e-5, 4000)
    figure = marginal(
        draws,
        "$T_{n|n|}$",
        "kg m/rad^2",
        prior=flat(2e-4, 12e-4),
        interval=(5.8e-4, 6.2e-4),
        normal=(6e-4, 1e-5),
        truth=6.3e-4,
    )
    (axes,) = figure.axes
    assert axes.get_xlabel() == "$T_{n|n|}$ [10⁻⁴ kg m/rad²]"
    assert {"posterior draws", "prior", "normal approximation", "95 % interval", "true value"} <= set(labels_of(axes))
    assert axes.get_xlim()[0] < 6.3 < axes.get_xlim()[1]


def test_a_prior_is_drawn_between_its_points_and_ends_at_its_bounds():
    assert UNIFORM.is_bounded
    np.testing.assert_allclose(UNIFORM.density(np.array([-7.0, -3.0, 1.0])), [0.0, 1 / 6, 0.0])
    value = np.linspace(0.0, 8.0, 200)
    half = PriorShape(0.0, np.inf, 1.6, 1.2, False, value, 0.4 * np.exp(-0.125 * value**2))
    assert not half.is_bounded
    assert half.density(np.array([-1.0, 2.0, 9.0])) == pytest.approx(
        [0.0, 0.4 * np.exp(-0.5), 0.4 * np.exp(-8.0)], abs=1e-3
    )


def test_a_pair_and_all_correlations_are_drawn():
    x, noise = np.random.default_rng(3).normal(size=(2, 3000))
    figure = pair(x, -x + 0.3 * noise, ("$X_{u}$", r"$X_{u|u|}$"), ("kg/s", "kg/m"), truth=(0.1, -0.1))
    assert figure.axes[0].get_xlabel() == "$X_{u}$ [kg/s]"
    assert {"draws", "mean", "true value"} <= set(labels_of(figure.axes[0]))
    matrix = np.array([[1.0, -0.95, 0.1], [-0.95, 1.0, np.nan], [0.1, np.nan, 1.0]])
    (axes,) = correlations(matrix, ["$a$", "$b$", "$c$"]).axes
    assert [text.get_text() for text in axes.texts] == ["−0.95", "+0.10"]


def test_coverage_shows_both_kinds_of_records():
    figure = covered(
        [(np.arange(9.0), np.arange(9.0))], [(np.arange(5.0), np.full(5, np.nan))], ("$n$ [rpm]", "$u$ [m/s]")
    )
    assert {"fitted", "held back"} <= set(labels_of(figure.axes[0]))
    assert "fitted" in labels_of(covered([(np.arange(9.0), np.arange(9.0))], [], ("a", "b")).axes[0])


def test_thinning_keeps_ends_and_edges():
    assert thin(10, 100).tolist() == list(range(10))
    kept = thin(100_000, 1500)
    assert kept[0] == 0
    assert kept[-1] == 99_999
    assert kept.size <= 1500
    doublet = np.where(np.arange(9000) % 3000 < 1500, 1.0, -1.0)
    assert np.abs(np.interp(np.arange(9000), thin_steps(doublet), doublet[thin_steps(doublet)]) - doublet).max() == 0
    noisy = np.random.default_rng(4).normal(size=50_000)
    noisy[31_234] = 99.0
    kept = thin_steps(noisy, 1000)
    assert 31_234 in kept
    assert kept.size <= 1002
