"""The picture of the priors: what it shows, and that it survives priors at the edge."""

import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from seatrial.report.drawing import draw_svg
from seatrial.report.figures.checks import Moved, prior_motions
from seatrial.report.figures.fit import Driven

TIME = np.linspace(0.0, 60.0, 301)
NORMAL = np.random.default_rng(0).normal(size=400)
BANDS = np.array([0.8, 1.1, 1.4, 1.8, 2.4])[:, None] + 0.1 * np.sin(TIME)
CONTROL = [Driven("$n$ [rpm]", 1200 + 200 * np.sign(np.sin(TIME)))]


def labels_of(axes) -> list[str]:
    return [str(artist.get_label()) for artist in (*axes.patches, *axes.lines, *axes.collections)]


def test_the_record_lies_on_the_bands_and_runaways_do_not_set_the_frame():
    single = np.stack([BANDS[1], np.where(TIME < 5, np.exp(TIME), np.nan)])
    measured = np.where(np.arange(TIME.size) % 5 == 0, BANDS[2], np.nan)
    spreads = [("steady speed [m/s]", 1.4 + 0.3 * NORMAL), ("time constant [s]", np.exp(NORMAL))]
    moved = Moved("$u$ [m/s]", BANDS, single, measured)
    figure = prior_motions(TIME, [moved], CONTROL, spreads=spreads, words=["cost $5"])
    motion, driven, speed, settling = figure.axes
    assert {"90 % of draws", "50 %", "median", "single draws", "measured"} <= set(labels_of(motion))
    low, high = motion.get_ylim()
    assert low < BANDS.min() < BANDS.max() < high < 4.0
    assert (motion.get_ylabel(), driven.get_ylabel()) == ("$u$ [m/s]", "$n$ [rpm]")
    assert (speed.get_xlabel(), settling.get_xlabel()) == ("steady speed [m/s]", "time constant [s]")
    assert "cost $5" in draw_svg(figure)


@pytest.mark.parametrize("steady", [np.full(400, np.nan), np.full(400, 1.5), np.where(NORMAL > 1, NORMAL, np.nan)])
def test_priors_without_a_motion_are_drawn_too(steady):
    nothing = np.full((5, TIME.size), np.nan)
    moved = Moved("$u$ [m/s]", nothing, nothing[:2], None)
    figure = prior_motions(TIME, [moved], [*CONTROL, *CONTROL], spreads=[("steady speed [m/s]", steady)] * 2)
    assert ("most draws have none" in draw_svg(figure)) == (np.isnan(steady).mean() > 0.5)


def test_many_channels_and_controls_each_have_a_panel_and_one_legend():
    moved = [Moved(f"${name}$", BANDS, BANDS[:2], None) for name in "uvwpqr"]
    figure = prior_motions(TIME, moved, CONTROL * 8)
    assert len(figure.axes) == 14
    boxes = [one.get_position() for one in figure.axes]
    assert all(upper.y0 > lower.y1 for upper, lower in itertools.pairwise(boxes))
    assert boxes[0].y1 < 1
    assert boxes[-1].y0 > 0
    assert [one.get_legend() is not None for one in figure.axes] == [True] + 13 * [False]


def test_names_of_axes_stay_inside_the_picture_beside_wide_ticks():
    shape = np.linspace(-0.049, 0.05, TIME.size)
    moved = [Moved("r [deg/s]", np.stack([shape * scale] * 5), shape[None] * scale, None) for scale in (1.0, 2e5, 0.0)]
    figure = prior_motions(TIME, moved, CONTROL)
    FigureCanvasAgg(figure).draw()
    assert all(one.yaxis.label.get_window_extent().x0 >= 0 for one in figure.axes)
