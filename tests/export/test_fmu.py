"""The co-simulation unit, checked and run by FMPy, against our simulation."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.manoeuvre import plan_for, simulate
from seatrial.export.motion import motion_of
from seatrial.export.targets.fmu import STEP, CoSimulationUnit
from tests.export.cases import published, rich, with_law, with_terms, written

VEHICLES = {
    "frame": lambda: published("bluerov2_heavy"),
    "ship": lambda: published("mariner"),
    "surge": lambda: published("remus100_surge"),
    "rich": rich,
    "law": with_law,
}
OURS = ("u", "v", "w", "p", "q", "r", "phi", "theta")


@pytest.fixture
def fmpy():
    pytest.importorskip("pythonfmu", reason="pythonfmu is not installed: the extra `export`")
    return pytest.importorskip("fmpy", reason="fmpy is not installed: a development dependency")


def unit_of(vehicle, folder):
    ((name, content),) = written(CoSimulationUnit(), vehicle).items()
    (folder / name).write_bytes(content)
    return str(folder / name)


def run(fmpy, path, controls, step, duration, start, order):
    """Commands change at the steps of the communication, as in our simulation."""
    times = step * np.arange(round(duration / step) + 1)
    rows = [(t, *(controls(t + 1e-9)[name] for name in order)) for t in times]
    table = np.array(rows, [("time", float), *((name, float) for name in order)]) if order else None
    result = fmpy.simulate_fmu(
        path, stop_time=duration, step_size=step, output_interval=step, start_values=start, input=table, output=OURS
    )
    return np.array([result[name] for name in OURS]).T


@pytest.mark.parametrize("name", VEHICLES)
def test_outputs_are_ours(fmpy, name, tmp_path):
    """In the standard manoeuvre of 40 s, to 1e-9 of the range."""
    from fmpy.validation import validate_fmu

    vehicle = VEHICLES[name]()
    path = unit_of(vehicle, tmp_path)
    assert validate_fmu(path) == []
    motion = motion_of(vehicle)
    plan = plan_for(vehicle, motion)
    start = np.zeros(8)
    start[0], start[6] = plan.speed, 0.1 if "p" in vehicle.moves else 0.0

    # Held over 0.05 s here and there; inside, steps of 0.01 s.
    def held(t):
        return plan.controls(0.05 * np.floor(t / 0.05 + 1e-6))

    duration = 40.0 if name == "frame" else 12.0
    ours = simulate(motion, vehicle.actuators, held, start, duration, STEP)[::5]
    initial = {"u_0": start[0], "phi_0": start[6]}
    found = run(fmpy, path, held, 0.05, duration, initial, vehicle.controls)
    assert found.shape == ours.shape
    assert np.abs(ours).max() > 0.1
    assert (np.abs(found - ours).max(0) <= 1e-9 * np.maximum(1.0, np.ptp(ours, axis=0))).all()


def test_parameters_can_be_set(fmpy, tmp_path):
    """A unit with other drag moves as the vehicle with that drag; its interface names every coefficient with its unit."""
    vehicle = published("bluerov2_heavy")
    path = unit_of(vehicle, tmp_path)
    other = with_terms(vehicle, X_uabsu=-60.0, X_udot=-10.0)

    def controls(t):
        return dict.fromkeys(vehicle.controls, 5.0)

    start = {"X_uabsu": -60.0, "X_udot": -10.0, "step": 0.05}
    found = run(fmpy, path, controls, 0.05, 3.0, start, vehicle.controls)
    ours = simulate(motion_of(other), vehicle.actuators, controls, np.zeros(8), 3.0, 0.05)
    np.testing.assert_allclose(found, ours, rtol=0, atol=1e-9)
    variables = {one.name: one for one in fmpy.read_model_description(path).modelVariables}
    assert variables["X_uabsu"].description == "kg/m"
    assert {variables[name].causality for name in vehicle.coefficients} == {"parameter"}
    assert float(variables["X_uabsu"].start) == vehicle.coefficients["X_uabsu"]


def test_without_the_packer_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pythonfmu", None)
    with pytest.raises(InputError, match=r"(?s)pythonfmu, which packs .* is not installed.*the extra `export`"):
        CoSimulationUnit().check(published())
