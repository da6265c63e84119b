"""The laboratory's frame: a twin of ourselves differs in nothing, one of a wrong sign or a lag is caught."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seatrial.export.manoeuvre import simulate
from seatrial.export.target import Carried
from seatrial.export.write import make_exporter
from seatrial.vehicles.actuators import Actuator

FILE = Path(__file__).parents[2] / "release" / "simulators" / "laboratory.py"
SPEC = importlib.util.spec_from_file_location("laboratory", FILE)
laboratory = sys.modules["laboratory"] = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(laboratory)


class Mirror:
    """Ourselves as a target, with signs of controls and lags of our choice."""

    target, version = "mirror", "1"

    def __init__(self, motion, signs=None, actuators=None):
        self.motion, self.signs, self.actuators = motion, signs or {}, actuators or {}

    def run(self, start, controls, duration):
        def changed(t):
            return {name: self.signs.get(name, 1.0) * value for name, value in controls(t).items()}

        found = simulate(self.motion, self.actuators, changed, start, duration, laboratory.STEP)
        return found[:: round(laboratory.SAMPLE / laboratory.STEP)]


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(laboratory, "DURATION", 2.0)
    monkeypatch.setattr(laboratory, "STEP", 0.05)
    monkeypatch.setattr(laboratory, "_START", 0.5)


def subject(label="bluerov2_heavy"):
    return laboratory.subject_of(label, make_exporter("gz"))


@pytest.mark.proof
def test_a_twin_of_ourselves_differs_in_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(laboratory, "RESULTS", tmp_path)
    found, one = laboratory.Results("python mirror.py", "1"), subject()
    laboratory.add_vehicle(found, one, Mirror(one.carried.motion))
    assert {row.scenario for row in found.rows} == {"thrust step", "turn", "heave", "roll release"}
    assert max(row.largest for row in found.rows) == 0
    assert found.failures == 0
    laboratory.store("mirror", found)
    (again,) = laboratory.all_results()
    numbers = laboratory.numbers_of([again])
    assert laboratory.tables(numbers) == laboratory.tables(laboratory.numbers_of([found]))
    assert "mirror 1 | bluerov2_heavy" in laboratory.tables(numbers)
    assert numbers["counts"]["all"] == {"vehicles": 1, "inside": 1}


def test_a_wrong_sign_is_caught():
    one = subject()
    signs = laboratory.sign_test(one, Mirror(one.carried.motion, {"f_3": -1.0}))
    assert {row.control for row in signs} == set(one.vehicle.controls)
    assert {row.control for row in signs if not row.same} == {"f_3"}


def test_a_lag_that_is_not_kept_is_a_loss_and_one_that_the_target_adds_is_outside():
    one = subject()
    lags = {name: Actuator(0.5) for name in one.vehicle.controls}
    scenarios, _ = laboratory.scenarios_of(one.vehicle)
    (step,) = (scenario for scenario in scenarios if scenario.name == "thrust step")
    added = {row.channel: row for row in laboratory.compare(one, Mirror(one.carried.motion, None, lags), step)}
    assert not added["u"].inside
    assert added["u"].stated == 0
    lagging = replace(one, vehicle=replace(one.vehicle, actuators=lags), carried=Carried(one.carried.motion))
    lost = {row.channel: row for row in laboratory.compare(lagging, Mirror(one.carried.motion), step)}
    assert lost["u"].inside
    assert lost["u"].stated == pytest.approx(added["u"].largest)


def test_the_span_of_an_unstable_vehicle_ends_where_rounding_would_show():
    scenario = laboratory.Scenario("x", np.zeros(8), lambda t: {}, "")

    def unstable(nu, phi, theta, controls):
        return np.array([7.0 * nu[0], 0.0, 0.0, 0.0, 0.0, 0.0])

    span, note = laboratory.meaningful_span(unstable, {}, scenario)
    assert span == pytest.approx(np.log(300.0) / 7.0 - 0.1, abs=0.1)
    assert "unstable" in note


def test_a_current_is_in_the_comparison():
    """What the export keeps in a current is not what the vehicle does, and a twin without the current is caught."""
    one, scenario = subject(), laboratory.scenario_in_current(subject().vehicle)
    rows = {row.channel: row for row in laboratory.compare(one, Mirror(one.carried.motion), scenario)}
    assert rows["u"].stated > 1e-3
    assert max(row.largest for row in rows.values()) > 1e-3


def test_what_a_vehicle_cannot_do_is_said():
    scenarios, absent = laboratory.scenarios_of(subject("remus100_prestero").vehicle)
    assert [scenario.name for scenario in scenarios] == ["turn", "heave", "roll release"]
    assert absent == ["thrust step left out: the vehicle has no n"]


def test_a_twin_that_samples_otherwise_is_refused():
    short, long = np.zeros((3, 8)), np.zeros((4, 8))
    with pytest.raises(ValueError, match="samples"):
        laboratory.rows_of("t", "1", "v", "turn", (short, long, long), 0.3)
