import re

import numpy as np

from seatrial.report.drawing import draw, draw_svg
from seatrial.report.figures.records import controls_over_time
from seatrial.report.figures.style import PALETTE


def figure(label="$n$ [rpm]"):
    time = np.arange(100) * 0.1
    return controls_over_time(time, [(np.sin(time) * 1.23456, label, (-1.3, 1.3))])


def test_a_whole_file_is_the_same_each_time_and_names_no_date():
    text = draw_svg(figure())
    assert text == draw_svg(figure())
    assert text.startswith("<?xml")
    assert "metadata" not in text
    assert not re.search(r'[ "]-?\d+\.\d{3,}', text)


def test_an_inline_figure_follows_the_colours_of_the_page():
    svg = draw(figure(), "input", "Control & time", "what <it> shows").svg
    assert svg.startswith("<svg viewBox=")
    assert '<title id="input-title">Control &amp; time</title>' in svg
    assert "what &lt;it&gt; shows" in svg
    assert "var(--blue)" in svg
    assert not any(light in svg for light, _ in PALETTE.values())
    assert "<style" not in svg
    assert "width=" not in svg[: svg.index(">")]


def test_two_figures_on_a_page_share_no_id():
    ids = [set(re.findall(r'\sid="([^"]*)"', draw(figure(), name, "a title").svg)) for name in ("first", "second")]
    assert ids[0]
    assert not ids[0] & ids[1]


def test_tick_labels_keep_their_digits():
    time = np.linspace(0, 1, 50)
    values = 0.0725 + 0.0005 * np.sign(np.sin(40 * time))
    svg = draw(controls_over_time(time, [(values, "u", (None, None))]), "digits", "t").svg
    assert re.search(r">0\.072\d<", svg)


def test_names_in_labels_are_escaped():
    assert "<b>" not in draw(figure("<b>bold</b>"), "evil", "t").svg
