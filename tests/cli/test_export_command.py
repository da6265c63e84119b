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
    "an engine of another target": (["remus100_prestero", "--to", "csv", "--engine", "dart"], ["csv, engine", "gz"]),
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


def test_an_unhealthy_estimate_is_an_alarm(monkeypatch, capsys, tmp_path):
    finished(tmp_path / "c", alarms=["the chains have not met"])
    code, out, _ = run(monkeypatch, capsys, "export", "c", "--to", "csv")
    assert code == Exit.ALARMS
    assert "caution: the chains have not met" in out
