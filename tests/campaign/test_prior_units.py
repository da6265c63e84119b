"""A coefficient is shown in the unit in which its prior is written: in the terminal, the tables and the report."""

import csv
import re

import pytest

from seatrial.campaign.store.results import Results
from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_text import written_units
from seatrial.core.display_units import shown_as_written
from seatrial.report.numbers import with_sd
from tests.campaign.small import NO_X_U, write_small
from tests.cli.test_cli import run

UNIT = "N/(rev/s)^2"
PER_REVOLUTION = 39.47841760435743
"""(2 pi)^2: an n of one revolution a second is 2 pi rad/s."""
IN_REVOLUTIONS = (
    "lower = 2.0e-4\nupper = 12.0e-4\n",
    f'lower = {2.0e-4 * PER_REVOLUTION}\nupper = {12.0e-4 * PER_REVOLUTION}\nunit = "{UNIT}"\n',
)


@pytest.mark.proof
def test_value_and_unit_agree_wherever_they_stand(monkeypatch, capsys, tmp_path):
    folder = write_small(tmp_path / "boat", *NO_X_U, IN_REVOLUTIONS, ("points = 4", "points = 3"))
    code, out, _ = run(monkeypatch, capsys, "run", folder, "--quiet")
    assert code == 0
    store = Store(folder)
    (row,) = (one for one in Results(store.folder).summary().coefficients if one.name == "T_nabsn")
    mean, sd = PER_REVOLUTION * row.mean, PER_REVOLUTION * row.sd
    assert row.unit == "kg m/rad^2"
    written = written_units(folder)
    assert written == (("T_nabsn", UNIT),)

    assert re.search(rf"T_nabsn +{mean:.5g} ± {sd:.3g} +{re.escape(UNIT)}", out)
    for path in (store.coefficients, store.quote):
        (line,) = (one for one in csv.DictReader(path.open()) if one["name"] == "T_nabsn")
        assert line["unit"] == UNIT
        assert float(line["mean"]) == pytest.approx(mean, rel=1e-9)
        assert float(line["sd"]) == pytest.approx(sd, rel=1e-9)
    report = (folder / "report.html").read_text()
    assert with_sd(mean, sd) in report
    assert "N/(rev/s)<sup>2</sup>" in report
    assert "kg\u202fm/rad<sup>2</sup>" not in report.replace(" ", "\u202f")

    for command, words in (("prior", UNIT), ("estimate", f"± {sd:.3g}")):
        _, out, _ = run(monkeypatch, capsys, command, folder, "--quiet")
        assert words in out
        assert "kg m/rad^2" not in out


def test_a_unit_of_another_dimension_is_left_aside():
    shown = shown_as_written({"X_u": "N", "T_nabsn": UNIT})
    assert shown("X_u", "kg/s") == (1.0, "kg/s")
    assert shown("X_uabsu", "kg/m") == (1.0, "kg/m")
    factor, unit = shown("T_nabsn[1]", "kg m/rad^2")
    assert (factor, unit) == (pytest.approx(PER_REVOLUTION), UNIT)
