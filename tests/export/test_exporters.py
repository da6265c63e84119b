"""Every exporter keeps the same promises; one test over the whole family."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export import manoeuvre
from seatrial.export.motion import motion_of
from seatrial.export.target import Exporter
from seatrial.export.vehicle import of_published, rest_for
from seatrial.export.write import (
    EXPORTERS,
    carried_by,
    export_vehicle,
    exporter_names,
    loss_words,
    make_exporter,
    state,
)
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.catalogue import load_vehicle
from tests.export.cases import HOSTILE, PROVENANCE, TARGETS, published, rich, states, text_of, towing, with_terms

OWN = ("json", "csv", "casadi", "fmu", "mjcf", "control", "draws")  # Targets that hold a part of a vehicle


class Other(Exporter):
    """Of a simulator that keeps something else; it writes nothing."""

    def write(self, vehicle, statement):
        return {}


@pytest.mark.parametrize("name", TARGETS)
def test_conformance(name, tmp_path, monkeypatch):
    monkeypatch.setattr(manoeuvre, "DURATION", 1.0)
    exporter, vehicle = make_exporter(name), replace(rich(), name=HOSTILE)
    assert exporter.name == name
    assert exporter.target
    carried = exporter.carries(vehicle)
    nu, phi, theta, controls = states(vehicle, count=1)
    here = {key: float(value[0]) for key, value in controls.items()}
    assert carried.motion(nu[:, 0], float(phi[0]), float(theta[0]), here).shape == (6,)
    statement, paths = export_vehicle(exporter, vehicle, PROVENANCE, tmp_path / name)
    again, _ = export_vehicle(exporter, vehicle, PROVENANCE, tmp_path / "again")
    assert statement.lines == again.lines
    for path in paths:
        text = text_of(path)
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), "the same bytes for the same vehicle"
        for words in (
            "abc123",
            "± 0.15 kg/m",
            "dropped by the selection: X_u",
            "loss in predicted motion",
            exporter.target,
        ):
            assert words in text, f"{words} in {path.name}"
        if path.suffix in (".sdf", ".config", ".urdf", ".scn"):
            ElementTree.fromstring(text)
        elif path.suffix == ".json":
            json.loads(text)
        elif path.suffix == ".py":
            compile(text, path.name, "exec")
    assert sorted(p.name for p in (tmp_path / name).iterdir()) == sorted(p.name for p in paths), "nothing half-written"
    if not (carried.lost or carried.changed):
        assert loss_words(statement.loss) == "none"


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_not_known_is_not_invented(name, tmp_path):
    exporter, vehicle = make_exporter(name), published("remus100_surge")
    if name in OWN:
        exporter.check(vehicle)
        return
    with pytest.raises(InputError, match="nothing about v w p q r") as error:
        export_vehicle(exporter, vehicle, PROVENANCE, tmp_path / "out")
    assert "`--fill-from remus100_hall_anstee`" in error.value.remedy
    assert not (tmp_path / "out").exists()


def test_the_rest_is_offered_from_a_vehicle_that_fits_or_from_none():
    """Same mass and all of its controls: a propeller is not Prestero's, a ship is no REMUS, and a heavier REMUS is none of them."""
    surge = published("remus100_surge")
    assert rest_for(surge) == rest_for(published("remus100_longitudinal")) == "remus100_hall_anstee"
    assert rest_for(published("remus100_prestero")) == "remus100_prestero"
    assert rest_for(published("bluerov2_heavy")) == "bluerov2_heavy"
    for stranger in (
        published("mariner"),
        replace(surge, hull=replace(surge.hull, mass=31.0)),
        replace(surge, hull=replace(surge.hull, mass=None)),
    ):
        assert rest_for(stranger) is None
    with pytest.raises(InputError, match="nothing about w p q") as error:
        make_exporter("gz").check(published("mariner"))
    assert "--fill-from" not in error.value.remedy
    assert "json or csv" in error.value.remedy


@pytest.mark.parametrize("name", ["gz", "json"])
@pytest.mark.parametrize(
    ("terms", "words"),
    [
        ({"X_uabsu": 1.5}, "X_uabsu = 1.5 kg/m, which gives energy"),
        ({"X_u": 0.8}, "without X_u = 0.8"),
        ({"N_rabsr": 94.0}, "N_rabsr = 94"),
        ({"Y_rabsr": 600.0}, "without Y_rabsr = 600"),
        ({"Y_vdot": 35.5}, "Y_vdot = 35.5 kg: mass and added mass have the eigenvalue"),
    ],
    ids=["drag", "linear", "yaw", "crossed", "mass"],
)
def test_what_would_run_away_is_refused(name, terms, words, tmp_path):
    with pytest.raises(InputError) as error:
        export_vehicle(make_exporter(name), with_terms(published(), **terms), PROVENANCE, tmp_path / "out")
    assert words in str(error.value)
    assert name in error.value.where
    assert error.value.remedy
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", TARGETS)
def test_every_target_refuses_what_would_run_away(name):
    with pytest.raises(InputError, match=f"export to {name}, X_uabsu"):
        make_exporter(name).check(with_terms(published(), X_uabsu=1.5))


def test_unknown_targets_and_options_are_refused():
    with pytest.raises(InputError, match='did you mean "gz"'):
        make_exporter("gx")
    with pytest.raises(InputError, match="a target that has this option: gz"):
        make_exporter("json", engine="dart")
    with pytest.raises(InputError, match=r"foo\n.*\n.*expected: density, engine") as error:
        make_exporter("gz", foo=1)
    assert "--" not in str(error.value)
    for density in (-3, "heavy", float("nan")):
        with pytest.raises(InputError, match=r"stonefish, density\n.*\n.*above 0"):
            make_exporter("stonefish", density=density)
    with pytest.raises(InputError, match="without named coefficients"):
        of_published("remus100_fossen", load_vehicle("remus100_fossen"))


def test_exporters_of_other_packages_are_found_by_name(tmp_path, monkeypatch):
    """Their metadata are read if an unknown name is asked for, or all are listed; a broken one is named with its package."""
    folder = tmp_path / "strange-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: strange\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(
        "[seatrial.exporters]\nplain = strange:PlainText\nlist = strange:NUMBERS\nabsent = strange.nowhere:X\ngz = strange:PlainText\n"
    )
    skeleton = Path(__file__).parents[2] / "docs" / "skeletons" / "exporter.py"
    (tmp_path / "strange.py").write_text(skeleton.read_text() + "\n\nNUMBERS = [1, 2]\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert exporter_names() == (*EXPORTERS, "plain", "list", "absent")
    assert type(make_exporter("gz")).__module__ == "seatrial.export.targets.gz"
    _, (path,) = export_vehicle(make_exporter("plain"), published(), PROVENANCE, tmp_path / "out")
    assert "\nX_uabsu = -" in path.read_text()
    with pytest.raises(InputError, match=r"NUMBERS of strange\n.*something else"):
        make_exporter("list")
    with pytest.raises(InputError, match=r"(?s)--to absent, .*ModuleNotFoundError.*that fits, or remove it"):
        make_exporter("absent")
    with pytest.raises(InputError, match="draws, plain, list, absent"):
        make_exporter("nothing_like_it")


def test_the_loss_is_that_of_the_manoeuvre(monkeypatch):
    """Half the propeller: the loss is the difference of two simulations, zero where nothing is lost."""
    monkeypatch.setattr(manoeuvre, "DURATION", 10.0)
    vehicle = published()

    class Half(Other):
        def carries(self, vehicle):
            weak = with_terms(vehicle, T_nabsn=0.5 * vehicle.coefficients["T_nabsn"])
            return make_exporter("json").carries(weak)._replace(lost=("half of the thrust",))

    statement = state(Half(), vehicle, PROVENANCE)
    by_rate = {change.rate: change for change in statement.loss}
    plan = manoeuvre.plan_for(vehicle, motion_of(vehicle))
    own = manoeuvre.run_manoeuvre(motion_of(vehicle), vehicle.actuators, plan)
    weak = manoeuvre.run_manoeuvre(Half().carries(vehicle).motion, vehicle.actuators, plan)
    assert by_rate["u"].largest == pytest.approx(np.abs(own - weak)[:, 0].max())
    assert by_rate["u"].largest > 0.3
    assert by_rate["u"].range == pytest.approx(np.ptp(own[:, 0]))
    assert "not supported: half of the thrust" in statement.lines
    assert loss_words(state(make_exporter("json"), vehicle, PROVENANCE).loss) == "none"


@pytest.mark.proof
def test_lags_that_a_target_lacks_count_in_the_loss(monkeypatch):
    """BlueROV2 in gz loses nothing else in still water; Fossen's simulator has the lags."""
    monkeypatch.setattr(manoeuvre, "DURATION", 8.0)
    vehicle = published("bluerov2_heavy")
    assert loss_words(state(make_exporter("gz"), vehicle, PROVENANCE).loss) == "none"
    late = replace(vehicle, actuators={name: Actuator(0.5, -40.0, 40.0) for name in vehicle.controls})
    kept, lost = (state(make_exporter(name), late, PROVENANCE) for name in ("fossen", "gz"))
    assert loss_words(kept.loss) == "none"
    assert "lag 0.5 s of f_1" in " ".join(lost.carried.lost)
    (surge,) = (change for change in lost.loss if change.rate == "u")
    plan = manoeuvre.plan_for(vehicle, motion_of(vehicle))
    slow = manoeuvre.run_manoeuvre(motion_of(vehicle), late.actuators, plan)
    fast = manoeuvre.run_manoeuvre(motion_of(vehicle), vehicle.actuators, plan)
    assert surge.largest == pytest.approx(np.abs(slow - fast)[:, 0].max())
    assert surge.largest > 0.01


@pytest.mark.parametrize("name", TARGETS)
def test_every_lag_rate_and_limit_is_carried_or_named(name):
    vehicle = rich()
    carried = make_exporter(name).carries(vehicle)
    for control, own in vehicle.actuators.items():
        there = carried.actuators.get(control, Actuator(0.0))
        (line,) = [line for line in carried.lost if line.endswith(f" of {control}")] or [""]
        assert ("lag" in line) == (there.time_constant != own.time_constant), line
        assert ("rate" in line) == (there.rate != own.rate), line
        assert ("limits" in line) == ((there.lower, there.upper) != (own.lower, own.upper)), line


@pytest.mark.proof
def test_the_loss_in_a_current_is_stated_where_the_campaign_has_one(monkeypatch):
    monkeypatch.setattr(manoeuvre, "DURATION", 20.0)
    vehicle, provenance = published("bluerov2_heavy"), replace(PROVENANCE, current=0.36)
    lines = state(make_exporter("gz"), vehicle, provenance).lines
    (line,) = (line for line in lines if "in the campaign's current" in line)
    assert "0.36 m/s" in line
    assert "u by" in line
    assert not any("the campaign's current" in line for line in state(make_exporter("gz"), vehicle, PROVENANCE).lines)
    found = state(make_exporter("fossen"), vehicle, provenance)
    assert loss_words(found.loss_in_current) == "none"


def test_a_target_that_runs_away_is_said_to(monkeypatch):
    monkeypatch.setattr(manoeuvre, "DURATION", 5.0)
    vehicle = published()

    class Wild(Other):
        def carries(self, vehicle):
            return make_exporter("json").carries(with_terms(vehicle, X_uabsu=500.0))._replace(lost=("drag",))

    assert "u diverges in the target" in loss_words(state(Wild(), vehicle, PROVENANCE).loss)


@pytest.mark.parametrize("name", TARGETS)
def test_no_target_keeps_a_tether_and_each_says_so(name, tmp_path, monkeypatch):
    """The files are those of the vehicle without it but for the statement, and what it does to the motion is lost."""
    monkeypatch.setattr(manoeuvre, "DURATION", 8.0)
    exporter, kind = make_exporter(name), "bluerov2_heavy" if name in (*OWN, "gz") else "remus100_hall_anstee"
    vehicle, towed = published(kind), towing(kind)
    statement, paths = export_vehicle(exporter, towed, PROVENANCE, tmp_path / "towing")
    words = "not supported: tether drag of 5 kg/s and 30 kg/m at (-0.3, 0, -0.1) m"
    assert words in statement.lines
    assert statement.carried.holds or max(change.largest for change in statement.loss) > 0.01
    assert all(words in text_of(path) for path in paths)
    nu, phi, theta, controls = states(vehicle, count=1)
    here = nu[:, 0], float(phi[0]), float(theta[0]), {key: float(value[0]) for key, value in controls.items()}
    np.testing.assert_array_equal(carried_by(exporter, towed).motion(*here), exporter.carries(vehicle).motion(*here))
    assert np.abs(motion_of(towed)(*here) - motion_of(vehicle)(*here)).max() > 0.01
