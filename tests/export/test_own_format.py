"""The package's own JSON and CSV: everything goes out and comes back, and what is no vehicle is refused."""

import csv
import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from seatrial.cli.answer import plain
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export.reading import read_exported
from seatrial.export.targets.csv_table import CsvTable
from seatrial.export.targets.own_json import OwnJson
from seatrial.export.vehicle import AveragedCoefficient
from tests.export.cases import PROVENANCE, own_force, published, rich, states, with_law, written


def save(vehicle, folder, **changes):
    path = folder / "vehicle.json"
    content = json.loads(written(OwnJson(), vehicle)["vehicle.json"])
    path.write_text(json.dumps(content | changes))
    return path, content


@pytest.mark.parametrize("name", ["rich", "law", "bluerov2_heavy", "mariner", "remus100_surge"])
def test_a_vehicle_comes_back(name, tmp_path):
    made = {"rich": rich, "law": with_law}
    vehicle = made[name]() if name in made else published(name)
    path, content = save(vehicle, tmp_path)
    again, provenance = read_exported(path)
    assert (again.coefficients, again.numbers) == (vehicle.coefficients, vehicle.numbers)
    assert (again.moves, again.thrusters, again.actuators) == (vehicle.moves, vehicle.thrusters, vehicle.actuators)
    np.testing.assert_array_equal(again.estimated.covariance, vehicle.estimated.covariance)
    assert asdict(provenance) == asdict(PROVENANCE)
    if vehicle.knows_body:
        assert again.hull == vehicle.hull
        nu, phi, theta, controls = states(vehicle, count=20)
        nu = nu * np.array([rate in vehicle.moves for rate in RATES])[:, None]
        if vehicle.is_whole:
            np.testing.assert_array_equal(
                own_force(again, nu, phi, theta, controls), own_force(vehicle, nu, phi, theta, controls)
            )
    else:
        assert content["body"]["centre_of_gravity"]["value"] is None, "what is not known is not zero"
        assert content["body"]["buoyancy"]["value"] is None


BROKEN = {
    "another format": ({"format": 2}, "format 2"),
    "no format": ({"format": None}, "no format number"),
    "no body": ({"body": {}}, "KeyError"),
    "a boolean": ({"coefficients": [{"name": "X_u", "value": True, "unit": "kg/s"}]}, "True instead of a number"),
    "another unit": ({"coefficients": [{"name": "X_u", "value": -1.0, "unit": "N"}]}, 'unit "N"'),
    "an unknown name": ({"coefficients": [{"name": "X_foo", "value": -1.0, "unit": "N"}]}, "X_foo"),
    "no list": ({"coefficients": 3}, "TypeError"),
    "velocities": ({"moves": ["u", "z"]}, "ValueError"),
    "a covariance": ({"estimated": {"names": ["X_u"], "mean": [1], "sd": [2], "covariance": [[1]]}}, "ValueError"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_no_vehicle_is_refused(case, tmp_path):
    changes, words = BROKEN[case]
    path, _ = save(published(), tmp_path, **changes)
    with pytest.raises(InputError, match=r"vehicle\.json") as error:
        read_exported(path)
    assert words in str(error.value)


def _edit(content, *keys, value):
    at = content
    for key in keys[:-1]:
        at = at[key]
    at[keys[-1]] = value


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("body", "mass", "unit"), "lb", "key body.mass.unit"),
        (("body", "mass", "value"), 0.0, "above 0"),
        (("body", "thrust_deduction", "value"), 5.0, "a share"),
        (("frame",), "north, east, up", "key frame"),
        (("matrices", "added_mass", 0, 0), 0.0, "key matrices.added_mass.0.0"),
        (("estimated", "mean", 0), -99.0, "the coefficient's value"),
        (("coefficients", 0, "sd"), 7.0, "key coefficients.0.sd"),
    ],
)
def test_parts_that_contradict_each_other_are_refused(keys, value, words, tmp_path):
    path, content = save(rich(), tmp_path)
    _edit(content, *keys, value=value)
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"vehicle\.json") as error:
        read_exported(path)
    assert words in str(error.value)


def test_averages_go_along_as_numbers(tmp_path):
    """In JSON and back, in the table, and as `--json` prints them; a file of an earlier version lacks them."""
    vehicle = published()
    averaged = (
        AveragedCoefficient("X_uabsu", -2.0, 0.6, 1.0),
        AveragedCoefficient("X_u", -0.5, 0.7, 0.3),
    )
    estimated = replace(vehicle.estimated, averaged=averaged, quoted="averaged")
    path, content = save(replace(vehicle, estimated=estimated), tmp_path)
    again, _ = read_exported(path)
    assert (again.estimated.averaged, again.estimated.quoted) == (averaged, "averaged")
    assert "contain noise, stated inputs" in content["estimated"]["uncertainty"]
    text = written(CsvTable(), replace(vehicle, estimated=estimated))["coefficients.csv"]
    assert "# sd and covariance of a campaign contain noise, stated inputs" in text
    rows = {row["name"]: row for row in csv.DictReader(line for line in text.splitlines() if line[0] != "#")}
    columns = ("averaged_mean", "averaged_sd", "source")
    assert [rows["X_uabsu"][name] for name in columns] == ["-2.0", "0.6", "estimated"]
    assert [rows["X_u"][name] for name in columns] == ["-0.5", "0.7", "in other models"]
    printed = plain(estimated)
    assert [(one["name"], one["mean"]) for one in printed["averaged"]] == [("X_uabsu", -2.0), ("X_u", -0.5)]
    for part in (content["estimated"], *content["coefficients"]):
        for key in ("uncertainty", "quoted", "averaged"):
            part.pop(key, None)
    path.write_text(json.dumps(content))
    assert read_exported(path)[0].estimated.averaged == ()


def test_keys_that_stand_twice_and_folders_are_refused(tmp_path):
    path, _ = save(rich(), tmp_path)
    path.write_text(path.read_text().replace('"format": 1', '"format": 1, "format": 1'))
    with pytest.raises(InputError, match="a key stands twice"):
        read_exported(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_exported(tmp_path)


def test_files_that_are_no_json_are_refused(tmp_path):
    for text in ("", "[]", "{", "[" * 100_000):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(InputError):
            read_exported(tmp_path / "x.json")
    with pytest.raises(InputError, match="no such file"):
        read_exported(tmp_path / "missing.json")


def test_the_table_holds_every_coefficient_and_the_covariance():
    vehicle = published()
    lines = [line for line in written(CsvTable(), vehicle)["coefficients.csv"].splitlines() if line[0] != "#"]
    rows = {row["name"]: row for row in csv.DictReader(lines)}
    assert {name: float(rows[name]["value"]) for name in vehicle.coefficients} == vehicle.coefficients
    found = [[float(rows[a][f"covariance with {b}"]) for b in vehicle.estimated.names] for a in vehicle.estimated.names]
    np.testing.assert_array_equal(found, vehicle.estimated.covariance)
    assert (rows["mass"]["value"], rows["mass"]["unit"]) == ("30.48", "kg")
    frame = written(CsvTable(), published("bluerov2_heavy"))["coefficients.csv"]
    assert "\nthruster 8 x,-0.12," in frame
    assert "\nf_3 upper,40.0,,kg m/s^2,body" in frame
    assert "\ncoriolis_of_added_mass_automatic,1.0," in frame
    surge = written(CsvTable(), published("remus100_surge"))["coefficients.csv"]
    assert "x_g" not in surge
    assert "\nmass,30.48" in surge


def test_thrusters_are_numbered_from_one_in_the_table():
    vehicle = published("bluerov2_heavy")
    lines = csv.reader(written(CsvTable(), vehicle)["coefficients.csv"].splitlines())
    rows = {row[0]: row[1] for row in lines if len(row) > 1}
    for number, thruster in enumerate(vehicle.thrusters):
        assert [float(rows[f"thruster {1 + number} {axis}"]) for axis in "xyz"] == list(thruster.place)
    assert "thruster 9 x" not in rows
