"""Every figure of the paper's study on made-up results: what is drawn is what was computed, and every axis says what it is."""

import sys

import numpy as np
import pytest

from studies.remus100.evidence import PRINTED_PROBABILITIES
from studies.remus100.figures import FIGURES
from studies.remus100.filters import BOUND_SHARE
from studies.remus100.reading import RPM
from studies.remus100.registry import ENTRIES
from studies.remus100.tests.made_up import FILTERS, METHODS, InMemory, change, made_up_study
from studies.remus100.tests.studies import A


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    p = np.array([0.0, 0.01, 0.02, 0.5, 0.5, 0.5, 0.99, 1.0, 1.0, 1.0])
    at_random = change("probability", lambda _: np.column_stack([p, 1 - p]))
    listings = {f"listing-{table}": at_random for table in (4, 5)}
    return made_up_study(listings, folder=tmp_path_factory.mktemp("paper"))


@pytest.fixture(scope="module")
def drawn(study):
    """Every figure, each from the parts that its item rests on, and no other."""
    figures = {}
    for key, figure in FIGURES.items():
        parts = {name: part for name, part in study.parts.items() if name in ENTRIES[key].parts}
        figures[key] = figure.draw(InMemory(study.folder, study.reading, study.sizes, parts))
    return figures


def line(axes, label: str):
    return next(one for one in axes.lines if one.get_label() == label)


def heights(axes, label: str) -> np.ndarray:
    return np.asarray(line(axes, label).get_ydata(), float)


def assert_shown(axes, label: str, time, values) -> None:
    """Samples of the curve stand at their instants; long ones are drawn with fewer of them."""
    x, y = line(axes, label).get_data()
    np.testing.assert_allclose(y, np.interp(x, time, values), rtol=1e-6)


def names(ticks) -> bool:
    """Whether an axis says by its ticks what it is of."""
    return any(tick.get_text()[:1].isalpha() for tick in ticks)


@pytest.mark.parametrize("key", FIGURES)
def test_every_axis_is_labelled_and_nothing_leaves_the_figure(drawn, key):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = drawn[key]
    FigureCanvasAgg(figure).draw()
    framed = [axes for axes in figure.axes if axes.axison]
    for axes in framed:
        below = [other for other in framed if abs(other.get_position().x0 - axes.get_position().x0) < 1e-6]
        assert axes.get_ylabel() or names(axes.get_yticklabels()) or not any(axes.get_yticklabels())
        assert not axes.get_xticks().size or any(
            other.get_xlabel() or names(other.get_xticklabels()) for other in below
        )
    ends = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert min(ends.x0, ends.y0) > -0.02
    assert ends.x1 < width + 0.02
    assert ends.y1 < height + 0.02


def test_figures_are_drawn_without_a_display(study, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for key in ("figure-1", "figure-3", "odds"):
        FIGURES[key].draw(study)


def test_figures_are_in_the_order_of_their_items():
    assert [key for key in ENTRIES if key in FIGURES] == list(FIGURES)


@pytest.mark.parametrize("key", FIGURES)
def test_captions_explain(study, key):
    caption = FIGURES[key].caption(study)
    assert len(caption) > 100
    assert caption.endswith(".")


@pytest.mark.parametrize(("key", "names"), [("figure-1", FILTERS[:3]), ("figure-2", FILTERS[2:])])
def test_filters_are_drawn_as_they_ran(study, drawn, key, names):
    data, grid = study.part("filters"), np.array(drawn[key].axes[:9]).reshape(3, 3)
    np.testing.assert_allclose(np.unique(heights(grid[0, 0], "n")), np.unique(data["n"].values / RPM))
    for name in names:
        one = data.sel(filter=name)
        assert_shown(grid[1, 0], name, data["time"], one["u"])
        assert_shown(grid[2, 0], name, data["time"], one["udot"])
        for row in range(3):
            assert_shown(grid[row, 1], name, data["time"], one["mean"][:, row])
            assert_shown(grid[row, 2], name, data["time"], one["sd"][:, row])
    for row, truth in enumerate(study.reading.printed_truth.values()):
        assert set(heights(grid[row, 1], "true")) == {truth}
        assert grid[row, 2].get_yscale() == "log"


def test_clipping_and_the_first_second_stand_below(study, drawn):
    data, axes = study.part("filters"), drawn["figure-2"].axes
    clipped = data["clipped"].sel(filter="SRUKF-C").values / data.sizes["seed"]
    steps = axes[9].patches[0].get_data()
    assert np.sum(steps.values * 10) == pytest.approx(clipped.sum())
    early = data["time"].values <= 1.0
    for name in ("SRUKF", "SRUKF-C"):
        np.testing.assert_array_equal(heights(axes[10], name), data["udot"].sel(filter=name).values[early])
    bounds = {float(one.get_ydata()[0]) for one in axes[1].lines if one.get_label() == "bound"}
    truth = study.reading.printed_truth["X_u"]
    assert bounds == {truth * (1 - BOUND_SHARE), truth * (1 + BOUND_SHARE)}


def test_the_chosen_doublet_is_drawn_with_its_quiet_tail(study, drawn):
    data, grid = study.part("chosen-doublet"), np.array(drawn["figure-4"].axes).reshape(3, 3)
    for axes, label, values in (
        (grid[1, 0], "SRUKF", data["u"]),
        (grid[2, 0], "true", data["true"][:, 1]),
        (grid[1, 1], "SRUKF", data["mean"][:, 1]),
        (grid[2, 2], "SRUKF", data["sd"][:, 2]),
    ):
        assert_shown(axes, label, data["time"], values)


def test_the_sweep_is_a_surface_and_contours_and_the_ridges_have_three_windows(study, drawn):
    surface, contour, _, ridges = drawn["figure-3"].axes
    gain = study.part("sweep-short")["gain"].values
    assert surface.name == "3d"
    assert surface.get_zlabel() == "entropy reduction [nat]"
    assert surface.collections[0].get_array().size == (gain.shape[0] - 1) * (gain.shape[1] - 1)
    levels = contour.collections[0].levels
    assert levels[0] <= gain.min()
    assert levels[-1] >= gain.max()
    for window in ("short", "medium", "long"):
        np.testing.assert_array_equal(heights(ridges, window), study.part(f"sweep-{window}")["gain"].values[-1])


def test_the_relay_marks_the_best_and_hatches_what_never_reverses(study, drawn):
    data, axes = study.part("relay"), drawn["relay"].axes
    star = line(next(panel for panel in axes if panel.get_ylabel() == "control amplitude [rpm]"), "best")
    assert star.get_xdata()[0] == data.attrs["best_threshold"]
    assert star.get_ydata()[0] == pytest.approx(data.attrs["best_amplitude"] / RPM)
    hatched = [one for panel in axes for one in panel.collections if one.get_label() == "fewer than two switches"]
    assert len(hatched[0].get_paths()) == int((data["switches"].values < 2).sum())
    responses = next(panel for panel in axes if panel.get_ylabel() == "$u$ [m/s]")
    assert_shown(responses, "self-oscillating", data["time"], data["u"])
    doublet = study.part("chosen-doublet")
    assert_shown(responses, "doublets of 10 s", doublet["time"], doublet["true"][:, 0])


@pytest.mark.parametrize(("key", "part"), [("figure-6", "chain-3"), ("figure-7", "chain-6-full")])
def test_a_chain_has_a_row_for_each_parameter(study, drawn, key, part):
    data = study.part(part)
    names = [str(name) for name in data["parameter"].values]
    plain = [axes for axes in drawn[key].axes if axes.get_ylabel() != "z"]
    scores = [axes for axes in drawn[key].axes if axes.get_ylabel() == "z"]
    grid = np.array(plain).reshape(len(names), 3)
    for row, name in enumerate(names):
        one = data.sel(parameter=name)
        np.testing.assert_allclose(heights(grid[row, 0], "trace"), one["trace"].values / float(one["truth"]))
        np.testing.assert_array_equal(heights(scores[row], "Geweke"), one["geweke"].values)
        np.testing.assert_array_equal(heights(grid[row, 1], "detrended")[1::3], one["acf"].values)
        steps = grid[row, 2].patches[-1].get_data()
        inside = (one["draws"].values >= steps.edges[0]) & (one["draws"].values <= steps.edges[-1])
        assert np.sum(steps.values * np.diff(steps.edges)) == pytest.approx(inside.mean())
        for label in ("true", "mean"):
            assert line(grid[row, 2], label).get_xdata()[0] == float(one["truth" if label == "true" else label])
    assert line(grid[0, 0], "end of burn-in").get_xdata()[0] == study.sizes.burn_in / 1000


def test_listing_1_shows_its_spread_beside_what_agrees(study, drawn):
    for axes, table in zip(drawn["listing-1"].axes, (4, 5), strict=True):
        p = study.part(f"listing-{table}")["probability"].values[:, 0]
        steps = axes.patches[0].get_data()
        share = steps.values - steps.baseline
        np.testing.assert_allclose(share / share.sum(), np.histogram(p, steps.edges)[0] / p.size, atol=1e-12)
        assert [text.get_text() for text in axes.texts][:2] == ["30 %", "40 %"]
        assert line(axes, "printed").get_xdata()[0] == PRINTED_PROBABILITIES[table]
        log_value = study.part(f"evidence-{table}")["log_value"].values
        points = [container for container in axes.containers if container.get_label() in METHODS]
        for point, (full, reduced) in zip(points, log_value, strict=True):
            assert point.lines[0].get_xdata()[0] == pytest.approx(1 / (1 + np.exp(reduced - full)))


def test_the_odds_show_every_trial_and_the_mean(study, drawn):
    p, (axes,) = study.part("odds")["probability"].values, drawn["odds"].axes
    trials = [one.get_ydata() for one in axes.lines if one.get_label() == "trials"]
    np.testing.assert_array_equal(trials, p)
    np.testing.assert_allclose(heights(axes, "mean"), p.mean(1))
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0.1", "1", "−20", "−60"]


def test_the_iteration_shows_promise_and_outcome(study, drawn):
    data = study.part("iteration")
    one = data.sel(coefficient=study.reading.doubted)
    candidates = next(axes for axes in drawn["iteration"].axes if axes.patches)
    np.testing.assert_allclose([bar.get_width() for bar in candidates.patches], one["both"].values)
    np.testing.assert_allclose(line(candidates, "alone").get_xdata(), one["alone"].values)
    sds = next(axes for axes in drawn["iteration"].axes if axes.get_ylabel().startswith("sd"))
    for name in map(str, data["coefficient"].values):
        sd = data["full_sd"].sel(coefficient=name).values
        np.testing.assert_allclose(heights(sds, name), sd / sd[0])
    odds = next(axes for axes in drawn["iteration"].axes if axes.get_ylabel().startswith("probability"))
    np.testing.assert_allclose(odds.containers[0].lines[0].get_ydata(), data["probability"].values)
    assert study.reading is A
