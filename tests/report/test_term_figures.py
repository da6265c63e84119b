"""The figures of a selection: bars beside each other, widths that are probabilities, names that do not meet, and their picture."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.report.drawing import draw_svg
from seatrial.report.figure_files import write_select_picture
from seatrial.report.figures.structures import (
    CoefficientPath,
    MotionGap,
    coefficient_paths,
    inclusion_paths,
    model_space,
    structure_gaps,
)
from seatrial.report.sections.models import models_section
from seatrial.report.term_figures import term_figures
from tests.report.outcomes import EVIL, METHODS, make_outcome, make_screened


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    return make_outcome(tmp_path_factory.mktemp("terms"))


def labels_of(axes) -> list[str]:
    artists = (*axes.patches, *axes.lines, *axes.collections, *axes.containers)
    return [str(artist.get_label()) for artist in artists]


def test_screening_and_simulation_have_a_picture_each(outcome):
    drawn = {
        item.name: item.figure.axes[0]
        for item in term_figures(outcome.campaign, outcome.selection, outcome.screened, outcome.contenders)
    }
    said = {name: [text.get_text() for text in drawn[name].texts] for name in ("inclusion", "inclusion-screening")}
    assert said["inclusion-screening"] == ["0.68", "0.30"]
    assert said["inclusion"] == [f"{p:.2f}" for p in sorted(outcome.selection.inclusion.values(), reverse=True)]
    assert [line.get_xdata()[0] for line in drawn["inclusion"].lines[-2:]] == pytest.approx([0.05, 0.95])


def test_columns_are_as_wide_as_their_structures_are_probable():
    member = np.array([[True, True], [True, False]])
    (axes,) = model_space(["$a$", "$b$"], member, np.array([0.6, 0.3]), np.array([1.0, -1.0])).axes
    boxes = {item.get_label(): [path.vertices for path in item.get_paths()] for item in axes.collections[:2]}
    assert [np.ptp(box[:, 0]) for box in boxes["positive"]] == pytest.approx([0.6, 0.3])
    assert [np.ptp(box[:, 0]) for box in boxes["negative"]] == pytest.approx([0.6])
    assert "not shown" in labels_of(axes)


def test_names_at_the_edge_do_not_meet_and_paths_have_their_units():
    scale, inclusion = np.array([0.1, 1.0, 10.0]), np.full((3, 9), 0.99)
    (axes,) = inclusion_paths([f"$x_{i}$" for i in range(9)], scale, inclusion).axes
    places = sorted(text.xyann[1] for text in axes.texts)
    assert np.diff(places).min() > 0.07
    assert places[-1] <= 1.0
    figure = coefficient_paths(scale, [CoefficientPath("$a$", "kg/m", np.array([0.0, 1e-5, 2e-5]))] * 2)
    assert figure.axes[0].get_ylabel() == "$a$\n[10⁻⁵ kg/m]"
    assert draw_svg(coefficient_paths(scale, [CoefficientPath("$a$", "1", np.zeros(3))]))


def test_a_gap_is_shown_with_its_band_and_with_noise_that_is_near():
    time = np.arange(9.0)
    gap = MotionGap("Run $1", time, 1 + time, 0.01 * time, 0.01 * time - 0.01, 0.01 * time + 0.01, (time, 1 + time))
    figure = structure_gaps([gap, gap], 0.05, "$u$ [m/s]")
    above, below = figure.axes[:2]
    assert {"90 % band of both posteriors", "posterior means", "residuals of the fit, sd"} <= set(labels_of(below))
    assert {"measured", "best", "runner-up"} <= set(labels_of(above))
    runner = next(line for line in above.lines if line.get_label() == "runner-up")
    assert runner.get_ydata() == pytest.approx(1 + 0.99 * time)
    assert "Run $1" in draw_svg(figure)
    assert "residuals of the fit, sd" not in labels_of(structure_gaps([gap], float("nan"), "$u$ [m/s]").axes[1])


def test_two_motions_that_would_be_one_line_are_drawn_as_their_difference():
    time = np.arange(9.0)
    gap = MotionGap("Run 1", time, 1 + time, 1e-3 * time, 0 * time, 2e-3 * time, (time, 1 + time))
    (axes,) = structure_gaps([gap], 0.05, "$u$ [m/s]").axes
    assert "posterior means" in labels_of(axes)
    assert "measured" not in labels_of(axes)
    assert axes.get_title("left") == "Run 1"


def test_the_picture_is_one_file_that_stands_alone(outcome):
    path = write_select_picture(outcome.campaign, outcome.selection, outcome.screened, outcome.contenders)
    text = path.read_text()
    root = ElementTree.fromstring(text)
    assert path.name == "select.svg"
    assert len(root.findall("{http://www.w3.org/2000/svg}svg")) == 6
    assert EVIL not in text
    assert "var(--" not in text
    ids = [item.attrib["id"] for item in root.iter() if "id" in item.attrib]
    assert len(ids) == len(set(ids))


def test_the_section_says_what_was_left_out(outcome):
    names = [item.name for item in term_figures(outcome.campaign, outcome.selection, None, outcome.contenders)]
    assert names == ["inclusion", "contenders"]
    without = models_section(replace(outcome, screened=None, contenders=None))
    assert (without["contenders"], without["screening"]) == ({}, {})
    assert "the two agree" in without["agreement"]
    asked = replace(outcome.selection.evidences[1], diagnostics={"methods": {**METHODS, "nested": METHODS["smc"]}})
    some = replace(
        outcome.selection, evidences=[outcome.selection.evidences[0], asked, *outcome.selection.evidences[2:]]
    )
    counted = models_section(replace(outcome, selection=some))["agreement"]
    assert counted.endswith(f"agree on 3 of 4 evidences; nested sampling decided that of {some.structures[1].label}.")
    text = "<b>rows</b> follow one another"
    counted = replace(outcome.summary, cautions=(text,))
    for summary, kind in ((counted, "caution"), (outcome.summary, "finding")):
        doubted = replace(outcome, screened=make_screened(text), summary=summary)
        finding = models_section(doubted)["screening"]["cautions"][-1]
        assert finding["kind"] == kind
        assert "&lt;b&gt;rows&lt;/b&gt; follow one another" in finding["text"]
