"""The picture of the priors: what it shows, and that it survives priors at the edge."""

import numpy as np
import pytest

from seatrial.report.drawing import draw_svg
from seatrial.report.figures.checks import prior_motions
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
    figure = prior_motions(
        TIME,
        BANDS,
        single,
        CONTROL,
        measured=measured,
        steady=1.4 + 0.3 * NORMAL,
        settling=np.exp(NORMAL),
        words=["cost $5"],
    )
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
    figure = prior_motions(TIME, nothing, nothing[:2], [*CONTROL, *CONTROL], steady=steady, settling=steady)
    assert ("most draws have none" in draw_svg(figure)) == (np.isnan(steady).mean() > 0.5)
