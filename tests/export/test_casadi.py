"""The module for CasADi, imported as it is written and run by CasADi, against the package's own model."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from seatrial.export.manoeuvre import simulate
from seatrial.export.motion import motion_of
from seatrial.export.targets.casadi_module import CasadiModule
from tests.export.cases import HOSTILE, commanded, own_rates, published, rich, whole_states, with_law, written

casadi = pytest.importorskip("casadi", reason="casadi is not installed: the extra `export`")
VEHICLES = {
    "frame": lambda: published("bluerov2_heavy"),
    "ship": lambda: published("mariner"),
    "surge": lambda: published("remus100_surge"),
    "rich": rich,
    "commanded": commanded,
    "law": with_law,
}


def module_of(vehicle, folder):
    """The exported file, imported where it finds nothing of seatrial."""
    ((name, text),) = written(CasadiModule(), vehicle).items()
    path = folder / name
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", VEHICLES)
def test_the_right_side_is_ours(name, tmp_path):
    """At 10^4 random states, to 1e-12 of the largest rate of each state."""
    vehicle = VEHICLES[name]()
    module = module_of(vehicle, tmp_path)
    state, control = whole_states(vehicle, 10_000)
    assert tuple(state) == module.STATES
    assert tuple(control) == module.CONTROLS
    x, u = np.array(list(state.values())), np.array(list(control.values())).reshape(len(control), -1)
    found = np.array(module.f(x, u, module.P, casadi.DM.zeros(3)))
    wanted = own_rates(vehicle, state, control)
    assert (np.abs(found - wanted).max(1) <= 1e-12 * np.abs(wanted).max(1)).all()
    assert {line.split()[1] for line in module.__doc__.splitlines() if line.startswith("import ")} == set()


def test_a_step_is_that_of_our_simulation(tmp_path):
    """Lags, rates and limits included, also in a current."""
    vehicle = rich()
    module, step = module_of(vehicle, tmp_path), 0.05
    commands = {"n": 200.0, "delta_r": 0.2, "delta_s": -0.1}
    start = np.array([1.5, 0, 0, 0, 0, 0, 0.1, -0.1])
    current = (0.1, -0.3, 0.05)
    motion = motion_of(vehicle)
    ours = simulate(motion, vehicle.actuators, lambda t: commands, start, 5.0, step, current)
    control = [commands[name] for name in module.CONTROLS]
    actual = [float(one) for one in module.followed(control)]
    assert actual == [157.0, 0.2]
    state = np.concatenate([start[:6], np.zeros(3), start[6:], [0.0], actual])
    for row in ours[1:]:
        state = np.array(module.F(state, control, module.P, current, step)).ravel()
        np.testing.assert_allclose(state[[0, 1, 2, 3, 4, 5, 9, 10]], row, rtol=0, atol=1e-10)
    assert np.abs(state[6:9]).max() > 3


def test_the_posterior_is_in_arrays_and_a_hostile_name_in_no_code(tmp_path):
    from dataclasses import replace

    vehicle = replace(published(), name=HOSTILE)
    module = module_of(vehicle, tmp_path)
    np.testing.assert_array_equal(np.array(module.MEAN).ravel(), vehicle.estimated.mean)
    np.testing.assert_array_equal(np.array(module.COVARIANCE), vehicle.estimated.covariance)
    assert [list(module.PARAMETERS)[i] for i in module.INDEX] == list(vehicle.estimated.names)
    (text,) = written(CasadiModule(), vehicle).values()
    assert [line for line in text.splitlines() if line.startswith(("import ", "from "))] == [
        "import casadi",
        "from casadi import cos, fmax, fmin, sin, tan",
    ]
    assert module.__name__ not in sys.modules


@pytest.mark.proof
def test_the_controller_designed_for_scenarios_keeps_its_bound():
    """In at least 95 % of the vehicles, and that designed for the mean in fewer: the example says so with its exit code too."""
    example = Path(__file__).parents[2] / "examples" / "depth_control.py"
    told = subprocess.run([sys.executable, example], capture_output=True, text=True, check=True).stdout
    mean, scenarios = (float(share) for share in re.findall(r"([\d.]+)% of 200 vehicles", told))
    assert scenarios >= 95.0 > mean
