"""What charts of results show: curves, legends and designs, and no foreign markup."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

from seatrial.campaign.store.estimates import Estimate, StoredCoefficient
from seatrial.campaign.store.stored_result import StoredResult
from seatrial.core.dataset import Dataset
from seatrial.core.errors import InputError
from seatrial.dashboard import model_queries, result_charts, result_plots
from seatrial.dashboard.charts import Curve, Panel, TimeChart, _series, legend_lines
from seatrial.dashboard.downsample import Envelope
from seatrial.dashboard.pages.compare import joint_difference, side_by_side
from seatrial.design.results import SweptDesigns
from seatrial.selection.structures import Structure
from tests.export.finished import finished


@pytest.fixture
def shown(monkeypatch):
    """Options of charts, without a page."""
    monkeypatch.setattr(result_charts, "chart", lambda options, title, height: options)


def test_a_posterior_with_other_fields_is_said_in_words(tmp_path):
    data = Dataset({"mean": ("parameter", np.array([-2.9]))}, {"parameter": ["X_u"]})
    StoredResult(tmp_path / "M-0.nc", "key", Estimate).write(Estimate(Structure("M-0", ("X_u",)), data))
    with pytest.raises(InputError, match="a result with other fields") as said:
        result_plots.estimated((tmp_path / "M-0.nc",))
    assert "seatrial estimate" in said.value.remedy


def test_a_held_control_is_drawn_as_steps_however_many_samples_a_column_has():
    least, greatest = np.array([-1.0, -1.0, 1.0, -1.0, -1.0]), np.array([-1.0, 1.0, 1.0, 1.0, -1.0])
    drawn = _series(Curve("n", "logged", "ink", "steps"), Envelope(np.arange(5.0), least, greatest))
    assert drawn["step"] == "end"
    assert [row[1] for row in drawn["data"]] == [-1, -1, -1, 1, 1, 1, 1, -1, -1, -1]
    assert _series(Curve("u", "measured"), Envelope(np.arange(5.0), least, greatest))["step"] is False


def test_the_surface_leaves_out_what_breaks_a_limit_and_shows_no_foreign_markup(shown):
    gain = np.array([[[1.0, 2.0], [np.nan, 3.0]]])
    found = SweptDesigns(
        *(("doublet",), "n", (("n", 0.0),), np.array([10.0, 20.0]), np.array([5.0, 10.0]), gain, gain, gain),
        *(np.ones((1, 2, 2, 1)), gain, ("<b>X_u",), np.ones(1), "the priors", {}, (), (), "nat"),
    )
    options = result_charts.surface_chart(found, 0, "gain", (0, 0))
    cells = options["series"][0]["data"]
    assert [cell[:3] for cell in cells] == [[0, 0, 1.0], [1, 0, 2.0], [1, 1, 3.0]]
    assert "<b>X_u" not in json.dumps(options)
    assert options["series"][1]["data"] == [[1, 1]]


def test_two_campaigns_differ_by_their_joint_standard_deviation():
    blank = dict.fromkeys(list(StoredCoefficient.__dataclass_fields__)[3:], 0.0)

    def row(mean, unit="kg/s", sd=0.1):
        return StoredCoefficient("X_u", unit, "", **{**blank, "mean": mean, "sd": sd})

    ours = row(-1.0)
    assert joint_difference(ours, row(-1.5)) == pytest.approx(0.5 / np.hypot(0.1, 0.1))  # 3.5: a contradiction
    assert joint_difference(ours, row(-1.5, sd=0.4)) == pytest.approx(0.5 / np.hypot(0.1, 0.4))  # 1.2
    assert joint_difference(ours, row(-1.5, "1/s")) is None  # of a campaign whose mass is unknown


def test_compare_prints_why_a_probability_means_nothing():
    def side(*alarms):
        structure = SimpleNamespace(label="M-0", probability=0.99)
        about = {
            "chosen": "M-0",
            "terms": ("X_u",),
            "structures": (structure,),
            "next_trial": SimpleNamespace(best=None),
        }
        return SimpleNamespace(quote=(), alarms=alarms, choice_alarms=alarms, cautions=(), **about)

    html = side_by_side(side("residuals of u are <correlated>"), side(), "a", "b")
    assert "residuals of u are &lt;correlated&gt;" in html
    assert "alarms about it" in html
    assert "alarms about it" not in side_by_side(side(), side(), "a", "b")


def test_only_targets_that_can_hold_the_vehicle_are_offered(tmp_path):
    folder = str(finished(tmp_path / "c"))
    alone = {one.name: one for one in model_queries.export_targets(folder, "") if not one.is_trial}
    assert [name for name, one in alone.items() if not one.refusal] == [
        "casadi",
        "fmu",
        "mjcf",
        "json",
        "csv",
        "control",
        "draws",
    ]
    assert "v w p q r" in alone["gz"].refusal
    rests = model_queries.export_rests(folder)
    assert "remus100_hall_anstee" in rests
    assert "bluerov2_heavy" not in rests
    whole = {one.name: one for one in model_queries.export_targets(folder, "remus100_hall_anstee") if not one.is_trial}
    assert whole["gz"].refusal == ""
    assert any("K_nabsn" in term for term in whole["gz"].unsupported)
    trials = [one for one in model_queries.export_targets(folder, "") if one.is_trial]
    assert all("no schedule" in one.refusal for one in trials)


def test_a_legend_has_as_many_lines_as_its_width_needs():
    labels = ["90 % band", "measured", "predicted", "90 % of residuals", "residual"]
    assert [legend_lines(labels, width) for width in (800, 340, 200, 100)] == [1, 2, 4, 5]
    curves = tuple(Curve(label, label, "blue") for label in labels)
    panels = (Panel("u", "m/s", curves[:3], 200), Panel("residual", "sd", curves[3:], 110))
    drawn = {one.name: Envelope(*3 * [np.linspace(0.0, 1.0, 3)]) for one in curves}
    options = TimeChart(panels, None, (0.0, 1.0), "u")._options(drawn)
    assert "type" not in options["legend"]  # it never pages
    wide, *layouts = (one["option"] for one in options["media"])
    assert wide["legend"]["left"] == "30%"
    for one in layouts:
        first, second = one["grid"]
        assert first["top"] + first["height"] < second["top"]
        assert second["top"] + second["height"] == pytest.approx(wide["grid"][1]["top"] + wide["grid"][1]["height"])
    narrow = next(one["option"] for one in options["media"][1:] if one["query"]["maxWidth"] == 380)
    assert narrow["grid"][0]["top"] >= wide["grid"][0]["top"] + 40


def test_curves_of_a_legend_differ_by_more_than_colour():
    """Dots, bands, steps and three predicted lines: no two icons are alike, and a line has the dashes of its icon."""
    curves = (
        *(
            Curve("a", "measured", "dots", "dots"),
            Curve("b", "band", "blue", "band"),
            Curve("c", "told", "ink", "steps"),
        ),
        *(Curve(shade, shade, shade) for shade in ("blue", "orange", "purple")),
    )
    chart = TimeChart((Panel("u", "m/s", curves),), None, (0.0, 1.0), "u")
    drawn = {one.name: Envelope(*3 * [np.linspace(0.0, 1.0, 3)]) for one in curves}
    options = chart._options(drawn)
    icons = [one["icon"] for one in options["legend"]["data"]]
    assert len(set(icons)) == len(curves)
    assert [one["lineStyle"]["type"] for one in options["series"][3:]] == ["solid", "dashed", "dotted"]
    assert [icon.count("M") for icon in icons[3:]] == [1, 3, 7]
