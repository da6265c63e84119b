"""`seatrial export` as a user meets it."""

import pytest

from seatrial.cli.running import Exit
from seatrial.export import manoeuvre
from seatrial.export.reading import read_exported
from tests.cli.test_cli import results, run
from tests.export.finished import finished

MISTAKES = {
    "no target": (
        ["remus100_prestero"],
        ["--to", "one of gz, stonefish, fossen, casadi, fmu, mjcf, holoocean, json, csv, control, draws"],
    ),
    "unknown target": (["remus100_prestero", "--to", "gazeebo"], ['"gazeebo"', "gz"]),
    "unknown vehicle": (
        ["remus100_presterro", "--to", "gz"],
        ["neither a folder", 'did you mean "remus100_prestero"?'],
    ),
    "a rest for a published one": (
        ["remus100_prestero", "--to", "gz", "--fill-from", "mariner"],
        ["--fill-from", "leave --fill-from out"],
    ),
    "a schedule without --trial": (["remus100_prestero", "--to", "gz", "--schedule", "next"], ["--schedule"]),
    "a trial of a published one": (["remus100_prestero", "--trial"], ["--trial", "no folder", "has no trials"]),
    "a structure with --trial": (["c", "--trial", "--structure", "M-1"], ["--structure", "--trial"]),
    "an engine of another target": (["remus100_prestero", "--to", "csv", "--engine", "dart"], ["csv, --engine", "gz"]),
    "draws of another target": (["remus100_prestero", "--to", "gz", "--draws", "9"], ["gz, --draws", "control, draws"]),
    "a decimal comma": (
        ["remus100_prestero", "--to", "control", "--speeds", "1,5 m/s"],
        ["--speeds", "separate speeds by spaces, or by commas with a space, and write 1.5"],
    ),
    "speeds without a unit": (
        ["remus100_prestero", "--to", "control", "--speeds", "1, 1.5"],
        ["--speeds", 'write "1, 1.5 m/s"'],
    ),
    "a speed astern": (
        ["remus100_prestero", "--to", "control", "--speeds", "-1 m/s"],
        ["--speeds", "0 m/s or more", 'write "1 m/s"'],
    ),
    "draws of another target into a folder": (
        ["remus100_prestero", "--to", "json", "--draws", "9", "--out", "there"],
        ["json, --draws", "control, draws"],
    ),
    "a density without unit": (["remus100_prestero", "--to", "gz", "--density", "1025"], ["--density", "kg/m^3"]),
    "part of a vehicle": (
        ["remus100_surge", "--to", "gz"],
        ["nothing about v w p q r", "--fill-from remus100_hall_anstee"],
    ),
    "no campaign": (["c", "--to", "gz"], ["c"]),
}


@pytest.fixture(autouse=True)
def brief(monkeypatch, tmp_path):
    monkeypatch.setattr(manoeuvre, "DURATION", 1.0)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_said_and_nothing_is_written(monkeypatch, capsys, tmp_path, name):
    arguments, words = MISTAKES[name]
    code, out, err = run(monkeypatch, capsys, "export", *arguments)
    assert (code, out) == (Exit.BAD_INPUT, "")
    for word in ("error:", "remedy", *words):
        assert word in err
    assert results(tmp_path) == []


def test_a_published_vehicle_by_name(monkeypatch, capsys, tmp_path):
    code, out, _ = run(monkeypatch, capsys, "export", "remus100_hall_anstee", "--to", "gz", "--density", "1000 kg/m^3")
    assert code == Exit.OK
    assert "not supported: K_nabsn" in out
    assert "loss in predicted motion" in out
    made = tmp_path / "export" / "remus100_hall_anstee" / "gz"
    assert results(made) == ["model.config", "model.sdf", "world.sdf"]
    assert "<uniform_fluid_density>1000.0<" in (made / "world.sdf").read_text()


def test_campaign_is_exported_as_json_and_to_a_simulator(monkeypatch, capsys, tmp_path):
    finished(tmp_path / "c")
    code, out, err = run(monkeypatch, capsys, "export", "c", "--to", "json", "--out", "elsewhere")
    assert (code, err) == (Exit.OK, "")
    assert "X_uabsu = " in out
    assert " ± " in out
    assert "loss in predicted motion (1.54 m/s ahead, a doublet of 20 % in n, in still water): none" in out
    vehicle, _ = read_exported(tmp_path / "elsewhere" / "vehicle.json")
    assert vehicle.estimated.names == ("X_uabsu", "T_nabsn", "X_u")
    code, out, _ = run(monkeypatch, capsys, "export", "c", "--to", "fossen", "--fill-from", "remus100_hall_anstee")
    assert code == Exit.OK
    assert results(tmp_path / "c" / "export") == ["fossen/remus_100_surge.py"]


def test_linear_models_of_another_vehicle_leave_no_plot(monkeypatch, capsys, tmp_path):
    """Each speed once, however its unit is written; what an export of this vehicle lacks and an earlier one left goes, the rest stays."""
    for name in ("bode_yaw.svg", "bode_roll.svg"):
        (tmp_path / name).write_text("of another vehicle")
    command = ["export", "remus100_surge", "--to", "control", "--out", str(tmp_path), "--speeds", "1 m/s, 1 m/s 1.5m/s"]
    code, out, _ = run(monkeypatch, capsys, *command)
    assert code == Exit.OK
    assert [line.split(",")[0] for line in out.splitlines() if line.startswith("at ")] == ["at 1 m/s", "at 1.5 m/s"]
    assert "loss in predicted motion: none of first order about each trim" in out
    assert {path.name for path in tmp_path.iterdir() if path.suffix == ".svg"} == {"bode_surge.svg", "bode_roll.svg"}


def test_an_unhealthy_estimate_is_an_alarm(monkeypatch, capsys, tmp_path):
    finished(tmp_path / "c", alarms=["the chains have not met"])
    code, out, _ = run(monkeypatch, capsys, "export", "c", "--to", "csv")
    assert code == Exit.ALARMS
    assert "caution: the chains have not met" in out
