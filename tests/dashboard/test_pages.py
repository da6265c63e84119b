"""What pages say of results: where to go on, what colours mean, what a column is."""

import asyncio
import re
from contextlib import nullcontext
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.campaign.store.answer_cache import keep
from seatrial.campaign.store.stored_result import Store, write_stamped_json
from seatrial.campaign.store.summary import NextTrial
from seatrial.core.display_units import shown_as_written
from seatrial.core.errors import InputError
from seatrial.core.files import depend_on, watching_files
from seatrial.dashboard.app_context import fill
from seatrial.dashboard.channel_map import files_of
from seatrial.dashboard.logs import Column, Looked
from seatrial.dashboard.map_draft import MapDraft
from seatrial.dashboard.page_layout import VIEWS
from seatrial.dashboard.pages.compare import nothing_beside
from seatrial.dashboard.pages.design import legend_html, what_it_teaches
from seatrial.dashboard.pages.one_axis import (
    OneAxis,
    delay_words,
    lined_up_words,
    panels_of,
    shift_error,
    span_words,
)
from seatrial.dashboard.pages.record_chart import RecordChart, ends_errors
from seatrial.dashboard.pages.records import checks_html
from seatrial.dashboard.pages.results import estimated_html, next_links
from seatrial.dashboard.result_plots import checked, report_sections
from seatrial.dashboard.view_models import AxisAbout, EstimatedStructure, beside
from seatrial.design.results import BestDesign, SweptDesigns
from seatrial.logs.clock_shift import ClockShift
from seatrial.report.page import CONTENTS, write_report
from tests.report.outcomes import make_outcome


def test_after_stop_no_link_leads_to_the_next_trial(tmp_path):
    store = Store(tmp_path)
    schedule = store.schedule(store.next_design)
    schedule.parent.mkdir(parents=True)
    schedule.write_text("time_s,n_rpm\n")
    best = BestDesign("doublet", "n", "rad/s", 0.0, 10.0, 5.0, 1.0, 1.0, {}, {})
    assert next_links("boat", store, NextTrial("run a doublet", False, best)).count("href=") == 2
    assert next_links("boat", store, NextTrial("stop: the goal is met", True, best)) == ""


def test_the_sections_of_a_report_are_shown_as_they_are_written(tmp_path):
    path = write_report(make_outcome(tmp_path, alarms=("chains disagree",)))
    sections = report_sections(path)
    assert list(sections) == ["answer", *CONTENTS]
    html = unescape(path.read_text())
    for section in sections.values():
        assert not {*re.findall(r">([^<>]+)<", unescape(section))} - {*re.findall(r">([^<>]+)<", html)}
    assert sum(section.count("<use ") for section in sections.values()) == html.count("<use ")
    assert sum(section.count("<path ") for section in sections.values()) == html.count("<path ")


@pytest.mark.parametrize(
    ("foreign", "refused"),
    [
        ("<script>alert(1)</script>", "<script>"),
        ('<p onclick="alert(1)">', "<p> with onclick=alert(1)"),
        ('<a href="javascript:alert(1)">', "<a> with href=javascript:alert(1)"),
        ('<img src="data:,">', "<img> with src=data:,"),
        ('<p style="background: url(//elsewhere)">', "<p> with style=background: url(//elsewhere)"),
        ('<p style="background: u\\72l(//elsewhere)">', "<p> with style="),
        ("<style>body { display: none }</style>", "<style>"),
        ("<p></ul>", "</ul> within <p>"),
    ],
)
def test_a_report_with_foreign_markup_is_not_shown(tmp_path, foreign, refused):
    path = tmp_path / "report.html"
    path.write_text(f'<script>outside()</script><section id="summary">{foreign}</section>')
    with pytest.raises(InputError, match=re.escape(refused)):
        report_sections(path)
    path.write_text('<section id="summary"><p>&lt;script&gt;alert(1)&lt;/script&gt;<!-- <script> --></p></section>')
    assert report_sections(path) == {
        "summary": '<section id="summary"><p>&lt;script&gt;alert(1)&lt;/script&gt;</p></section>'
    }


def test_grey_is_explained_where_a_design_breaks_a_limit():
    assert "breaks a limit" in legend_html(np.array([[1.0, np.nan]]))
    assert "grey" not in legend_html(np.array([[1.0, 2.0]]))


def test_a_design_names_the_coefficients_about_which_it_says_nothing():
    names, before = ("X_uabsu", "N_rabsr", "N_ur"), np.array([5.0, 16.0, 6.0])

    def told(after, held=("tau_N",)):
        sd = np.asarray(after)[None, None, None]
        gain = np.ones((1, 1, 1))
        trim = tuple((name, 0.0) for name in ("n", *held))
        found = SweptDesigns(
            *(("step",), "n", trim, np.array([10.0]), np.array([5.0]), gain, gain, gain, sd, gain, names, before),
            *("the priors", {}, (), (), "nat"),
        )
        return what_it_teaches(found, 0, 0, 0, shown_as_written({}))

    assert (
        "The trial says nothing about N_rabsr and N_ur: no measurement changes with them. "
        "To learn about them, move r (<code>together</code> of [design] moves tau_N as well)."
        in told(before * [0.04, 1.0, 0.99999])
    )
    assert "with it. To learn about it, move r and u." in told(before * [0.04, 0.2, 1.0], ())
    assert "says nothing" not in told(before * [0.04, 0.2, 0.9])


@pytest.mark.parametrize(("imported", "label"), [(True, "logged"), (False, "commanded")])
def test_a_control_of_a_log_is_not_called_commanded(tmp_path, imported, label):
    chart = RecordChart(SimpleNamespace(), tmp_path, SimpleNamespace(imported=imported), [], SimpleNamespace())  # pyright: ignore[reportArgumentType]
    assert chart._panel("n", "rpm", "control").curves[0].label == label
    assert chart._panel("u", "m/s", "measurement").curves[0].label == "measured"


def test_checks_are_a_table_with_remedies_that_lead_to_their_form(tmp_path):
    def row(level, **more):
        return {
            "code": "direction-reversed",
            "level": level,
            "values": {"correlation": -0.9},
            "message": "u moves <b>",
        } | more

    assert checked(tmp_path) is None
    findings = [
        row("pass", subject=["u"], remedies=[]),
        row("alarm", subject=["v"], remedies=["reverse-sign"], values={"correlation": -0.9, "commanded": [["n"]]}),
        row("pass", subject=["r"], remedies=[]),
    ]
    records = [{"label": "dive 1", "level": "alarm", "findings": findings, "cautions": ["run dive 1, a hole"]}]
    told = {
        "result": {"records": records},
        "files": {"raw plot of dive 1": "/elsewhere/check-dive 1.svg"},
        "cautions": ["c"],
    }
    log = tmp_path / "log.csv"
    log.write_text("t")
    with watching_files() as seen:
        depend_on(log)
    keep(Store(tmp_path).answer("check"), "k", {"told": told}, seen)
    found = checked(tmp_path)
    assert found is not None
    assert found.is_current
    assert found.has_alarms
    assert [one.level for one in found.records[0].rows] == ["alarm", "caution", "pass"]
    assert found.records[0].rows[2].words == "direction of u, r"
    html = checks_html(found, "boat")
    assert '<span class="verdict fail">alarm</span>' in html
    assert 'Set the scale of the channel to -1 in the import form. <a href="#new-log">' in html
    assert "u moves &lt;b&gt;" in html
    assert html.count("check-dive+1.svg") == 1
    log.write_text("another")
    again = checked(tmp_path)
    assert again is not None
    assert not again.is_current
    assert "check the records again" in checks_html(again, "boat")
    write_stamped_json(Store(tmp_path).answer("check"), {"rests_on": {}, "answer": {"told": {"result": {}}}}, "k")
    assert checked(tmp_path) is None  # of another version
    assert "not been checked" in checks_html(None, "boat")


def test_an_error_beside_its_field_names_no_line_of_the_file():
    error = InputError(
        "campaign.toml:31, key a.b", found='unit "kg"', expected='a unit like "m/s"', remedy="correct it"
    )
    assert beside(error) == 'unit "kg": expected a unit like "m/s"; correct it'


def test_estimates_stand_by_structure_before_a_model_is_chosen():
    remark = "X_uabsu: most of the ± is from a force X_u"
    found = (
        EstimatedStructure("M-0", ("X_u",), (("X_u", "X_{u}", "kg/s", -1.25, 0.23, ""),)),
        EstimatedStructure(
            "M-1",
            ("X_uabsu",),
            (("X_uabsu", "X_{u|u|}", "kg/m", -3.92, 0.478, "a force X_u"),),
            ("R-hat of X_uabsu is 1.2",),
            (remark,),
        ),
    )
    html = estimated_html(found, shown_as_written({"X_u": "t/s"}))
    first, second = html.split("<h3>Parameters of ")[1:]
    assert first.startswith("M-0: X_u<")
    assert "−1.25 ± 0.23" in first
    assert "10⁻³ t/s" in first
    assert (
        '<td data-head="Value ± sd">−3.92 ± 0.48</td>' in second
    )  # on a narrow screen, where the head is above each cell
    assert '<small class="cause">a force X_u</small>' in second
    assert "Xu|u|: most of the ± is from a force X_u." in re.sub("<[^>]*>", "", second)
    assert html.index("Do not use these numbers yet") < html.index("M-1: R-hat of") < html.index("<table")


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [("thrust", "dvl_vx", False), ("gyro_z", "rate", True), ("yaw", "yaw", True), ("gyro_z", "dvl_vx", False)],
)
def test_columns_of_two_quantities_are_told(tmp_path, first, second, same):
    channel_map = """[[import.files]]
path = "a.csv"
channels.tau_X = { column = "thrust", unit = "N" }
channels.r = { column = "gyro_z", unit = "rad/s" }
[[import.files]]
path = "b.csv"
channels.u = { column = "dvl_vx", unit = "m/s" }
"""
    columns = [Column(table, name, "", "0 to 1", "") for table, name in (("a", first), ("b", second))]
    quantities = {("b", "rate"): "r"}
    heads: dict[str, str] = {"a": "", "b": ""}
    logs = {f"{one.table}.csv": Looked("CSV", (), (one,), (), heads, (), {}, quantities) for one in columns}
    draft = MapDraft(tmp_path, files=files_of(channel_map), logs=logs)
    axis = OneAxis(SimpleNamespace(), draft, SimpleNamespace(), SimpleNamespace())  # pyright: ignore[reportArgumentType]
    assert (axis._differ(*draft.columns) == "") == same


def test_campaigns_that_were_not_run_are_named_with_a_link(tmp_path):
    alone = nothing_beside([], tmp_path)
    assert "Serve a folder that contains several" in alone
    html = nothing_beside(["W2", "W3"], tmp_path)
    assert "has results of <code>seatrial run</code> yet" in html
    assert html.count('href="/run?campaign=W') == 2
    assert "Serve a folder" not in html


@pytest.mark.parametrize(
    ("start", "end", "wrong"),
    [
        (0.0, 359.9, (None, None)),
        (0.0, 900.0, (None, "at most 359.9 s: the whole record is 359.9 s long")),
        (5.0, 4.0, ("has to be before the end", None)),
        (-1.0, 20.0, ("a number of seconds, 0 or more", None)),
        (
            None,
            None,
            ("a number of seconds, 0 or more", "a number of seconds; the whole record is 359.9 s long"),
        ),
    ],
)
def test_the_ends_of_a_run_are_inside_it(start, end, wrong):
    assert ends_errors(start, end, 359.9) == wrong
    assert ends_errors(0.0, 359.9, 359.899996) == (None, None)  # as it was printed


def test_a_shift_says_how_sharp_its_peak_is():
    found = ClockShift(1.6004, 0.97, None, -0.4, 3.1)
    words = lined_up_words(found, "logs/b.csv")
    assert words == (
        "Correlation 0.970 with logs/b.csv shifted by 1.6004 s. Between -0.4 and 3.1 s it is at least 99% of that."
    )
    assert "Between 1.594 and 1.612 s" in lined_up_words(found._replace(lower=1.594, upper=1.612), "b")
    assert "not the same quantity" in delay_words("thrust", "dvl_vx")
    epoch = found._replace(shift=1_792_310_400.0, rival=1_792_310_441.12, lower=1_792_310_399.9, upper=1_792_310_400.1)
    assert " 41.1 s later fits almost as well, because the motion repeats" in lined_up_words(epoch, "b")
    assert " 1230 s earlier fits almost as well" in lined_up_words(epoch._replace(rival=1_792_309_166.0), "b")


@pytest.mark.parametrize(("shift", "is_wrong"), [(None, True), (1e300, True), (-1795772417.702, False), (0.0, False)])
def test_a_shift_is_a_number_of_seconds_that_clocks_may_differ_by(shift, is_wrong):
    assert (shift_error(shift) is not None) == is_wrong


def test_what_is_compared_stands_in_one_panel_above_the_channels():
    names, logs = ("yaw · a.csv", "gyro · b.csv", "u", "n"), ("a.csv", "b.csv", "b.csv", "a.csv")
    roles = ("compared", "compared", "measurement", "control")
    about = AxisAbout(names, ("", "", "m/s", "rpm"), roles, logs, ((0.0, 9.0), (2.0, 8.00000001)) * 2, (0.0, 8.0))
    above, *below = panels_of(about)
    assert [(one.name, one.colour) for one in above.curves] == [("yaw · a.csv", "blue"), ("gyro · b.csv", "orange")]
    assert [(one.label, one.curves[0].kind, one.curves[0].colour) for one in below] == [
        ("u", "line", "orange"),
        ("n", "steps", "blue"),
    ]
    words = span_words(about)
    assert "b.csv: 0 s to 9 s" in words
    assert "The record: 0 s to 8 s, with all controls and a measurement." in words


def test_of_two_answers_for_one_part_of_a_page_the_last_is_shown():
    built = []

    class Part(nullcontext):
        is_deleted = False

        def clear(self):
            built.clear()

    async def later(seconds, what):
        await asyncio.sleep(seconds)
        return what

    async def both():
        part = Part()
        await asyncio.gather(
            fill(part, later(0.02, "first"), built.append, patience=9.0),
            fill(part, later(0.01, "second"), built.append, patience=9.0),
        )

    asyncio.run(both())
    assert built == ["second"]


def test_every_view_stands_in_its_documentation():
    text = (Path(__file__).parents[2] / "docs" / "how-to" / "dashboard.md").read_text()
    assert [name for name in VIEWS.values() if f"\n| {name} |" not in text] == []
