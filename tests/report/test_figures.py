"""Every figure on small made-up data: what it shows, what it is called, and that it survives data at the edge."""

import numpy as np
import pytest

from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import Schedule
from seatrial.report.drawing import draw_svg, schedule_figure
from seatrial.report.figures.fit import DrawnChannel, Driven, autocorrelation, record_fit, record_residuals
from seatrial.report.figures.parameters import Traced, belief_rows, chain_rows, corner
from seatrial.report.figures.posterior import PriorShape, draw_marginal, draw_pair
from seatrial.report.figures.records import controls_over_time, covered
from seatrial.report.figures.structures import probability_bars
from seatrial.report.figures.style import NARROW, new_figure, thin, thin_steps
from seatrial.report.figures.surface import design_surface
from seatrial.report.numbers import Digits

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


def channel(label="$u$ [m/s]") -> DrawnChannel:
    measured = np.sin(TIME) + 0.1 * np.random.default_rng(0).normal(size=TIME.size)
    measured[::4] = np.nan
    return DrawnChannel(label, measured, np.sin(TIME), np.full(TIME.size, 0.1))


def test_the_surface_marks_the_best_design_and_hatches_what_is_forbidden():
    gain = np.add.outer(np.arange(5.0), np.arange(6.0))
    free = design_surface(np.arange(6.0), np.arange(5.0), gain, (4, 5), ("period [s]", "amplitude [rpm]"))
    gain[4, :3] = np.nan
    bound = design_surface(np.arange(6.0), np.arange(5.0), gain, (4, 5), ("period [s]", "amplitude [rpm]"))
    (axes,) = bound.axes
    (bar,) = axes.child_axes
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
    (axes,) = figure.axes
    assert "entropy reduction [nat]" in "".join(one.get_ylabel() for one in (axes, *axes.child_axes))
    draw_svg(figure)


def test_a_control_shows_only_the_limits_that_are_near():
    (axes,) = controls_over_time(TIME, [(np.sign(np.sin(TIME)), "$n$ [rpm]", (-1.2, 50.0))]).axes
    assert labels_of(axes).count("limit") == 1
    assert axes.get_ylabel() == "$n$ [rpm]"


def test_probabilities_are_bars_with_errors_inside_zero_and_one():
    (axes,) = probability_bars(["M-0", "M-1"], [0.97, 0.03], [0.28, 0.28]).axes
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
    one = Traced("$X_{u}$", -3.0 + sd, sd, -1.0, -3.0, -3.01)
    (axes,) = belief_rows(TIME, [one, one], [20.0]).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["$X_{u}$"] * 2
    assert [line.get_xdata()[0] for line in axes.lines if len(set(line.get_xdata())) == 1] == [20.0]
    means = [line.get_ydata() for line in axes.lines if len(line.get_xdata()) > 2]
    assert all(abs(mean + row).max() < 0.5 for row, mean in enumerate(means))
    targets = [item for item in axes.collections if item.get_linewidth()[0] == 1.3]
    assert len(targets) == 4, "sampler and truth in each row; the prior's mean lies outside"


def test_the_chains_that_lie_farthest_apart_are_drawn():
    draws = np.random.default_rng(6).normal(size=(9, 500, 2))
    draws[7] += 2.0
    (axes,) = chain_rows(draws, ["$a$", "$b$"]).axes
    drawn = [line.get_ydata() for line in axes.lines]
    assert len(drawn) == 8
    assert max(y.mean() for y in drawn[:4]) > 0.15
    assert all(abs(y + 1).max() < 0.5 for y in drawn[4:])


def test_regions_of_a_pair_hold_their_shares_and_numbers_are_those_of_the_table():
    """Of a normal distribution 95 % lie within 2.45 standard deviations of the mean, 50 % within 1.18."""
    draws = np.random.default_rng(7).normal([3.0, 6e-4], [0.1, 1e-5], (20000, 2))
    digits = [Digits.of(float(mean), float(sd)) for mean, sd in zip(draws.mean(0), draws.std(0), strict=True)]
    (axes,) = corner(draws, ["$a$", "$b$"], ["kg", ""], digits, [flat(0.0, 6.0), flat(0.0, 1e-3)], [2.9, None]).axes
    lines = {item.get_label(): np.concatenate(item.get_segments()) for item in axes.collections[1:]}
    for label, radius in (("95 % of the draws", 2.45), ("50 % of the draws", 1.18)):
        away = np.linalg.norm(lines[label] - [0.5, 0.5 - 1.07], axis=1) * 8.4
        assert np.median(away) == pytest.approx(radius, rel=0.08)
    said = [text.get_text() for text in axes.texts]
    assert {"2.80", "3.20", "$a$ [kg]", "$b$ [10⁻⁴]"} <= set(said)


def test_a_posterior_shows_prior_interval_and_truth_and_pulls_out_powers_of_ten():
    draws = np.random.default_rng(2).normal(6e-4, 1e-5, 4000)
    figure, (axes,) = new_figure(NARROW, [128], left=14, right=14, bottom=38)
    draw_marginal(
        axes,
        draws,
        "$T_{n|n|}$",
        "kg m/rad^2",
        prior=flat(2e-4, 12e-4),
        interval=(5.8e-4, 6.2e-4),
        normal=(6e-4, 3e-6),
        truth=6.3e-4,
    )
    (axes,) = figure.axes
    assert axes.get_xlabel() == "$T_{n|n|}$ [10⁻⁴ kg m/rad²]"
    assert {"posterior draws", "prior", "normal approximation", "95 % interval", "true value"} <= set(labels_of(axes))
    assert axes.get_xlim()[0] < 6.3 < axes.get_xlim()[1]
    curves = [line.get_ydata() for line in axes.lines if line.get_label() in ("prior", "normal approximation")]
    assert max(map(np.max, curves)) > 3.0
    assert axes.get_ylim()[1] > max(map(np.max, curves))


def test_a_prior_is_drawn_between_its_points_and_ends_at_its_bounds():
    assert UNIFORM.is_bounded
    np.testing.assert_allclose(UNIFORM.density(np.array([-7.0, -3.0, 1.0])), [0.0, 1 / 6, 0.0])
    value = np.linspace(0.0, 8.0, 200)
    half = PriorShape(0.0, np.inf, 1.6, 1.2, False, value, 0.4 * np.exp(-0.125 * value**2))
    assert not half.is_bounded
    assert half.density(np.array([-1.0, 2.0, 9.0])) == pytest.approx(
        [0.0, 0.4 * np.exp(-0.5), 0.4 * np.exp(-8.0)], abs=1e-3
    )


def test_a_pair_is_drawn():
    x, noise = np.random.default_rng(3).normal(size=(2, 3000))
    figure, (axes,) = new_figure(NARROW, [190], left=50)
    draw_pair(axes, x, -x + 0.3 * noise, ("$X_{u}$", r"$X_{u|u|}$"), ("kg/s", "kg/m"), truth=(0.1, -0.1))
    assert figure.axes[0].get_xlabel() == "$X_{u}$ [kg/s]"
    assert {"draws", "mean", "true value"} <= set(labels_of(figure.axes[0]))


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


def test_every_control_of_a_schedule_has_a_panel_and_its_own_limits():
    time = np.arange(100) * 0.1
    both = Schedule(time, {"n": 125 + np.sin(time), "delta_r": 0.1 * np.cos(time)})
    rpm, rudder = schedule_figure(both, {"delta_r": Limits(-0.12, 0.12)}).axes
    assert [len(axes.lines) for axes in (rpm, rudder)] == [1, 3]
    np.testing.assert_allclose(rudder.lines[1].get_ydata(), np.rad2deg(-0.12))
    np.testing.assert_allclose(np.ptp(rpm.lines[0].get_ydata()), np.ptp(both.controls["n"]) * 30 / np.pi, rtol=1e-6)
