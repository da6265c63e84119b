"""Fossen's Python simulator: the generated file, run in a process of its own on a stand-in of the base class, moves as our vehicle."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from seatrial.export.targets.fossen import Fossen, controls_of
from tests.export.cases import (
    assert_equal,
    commanded,
    own_force,
    published,
    rich,
    states,
    with_law,
    with_terms,
    written,
)

BASE = '''
"""Stands for the simulator's class: what its loop and its subclasses use of it."""
import numpy as np

class remus100:
    def __init__(self, controlSystem="stepInput", r_z=0, r_psi=0, r_rpm=0, V_current=0, beta_current=0):
        self.V_c, self.beta_c, self.controlMode = V_current, np.radians(beta_current), controlSystem
        self.nu, self.u_actual, self.dimU = np.zeros(6), np.zeros(3), 3
        self.nMax = 1525
'''
RUN = """
import importlib.util, json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
spec = importlib.util.spec_from_file_location("made", sys.argv[2])
made = importlib.util.module_from_spec(spec)
spec.loader.exec_module(made)
(kind,) = [v for k, v in vars(made).items() if isinstance(v, type) and k != "remus100"]
asked = json.load(open(sys.argv[3]))
vehicle = kind(V_current=0.3, beta_current=20)
out = {"rates": [vehicle.acceleration(*map(np.array, row)).tolist() for row in asked["states"]]}
out["steps"] = [[x.tolist() for x in vehicle.dynamics(*map(np.array, row), 0.02)] for row in asked["steps"]]
print(json.dumps(out | {"scale": vehicle.to_SI.tolist(), "dimU": vehicle.dimU, "doc": made.__doc__}))
"""


def ran(vehicle, tmp_path, rows=(), steps=()):
    folder = tmp_path / "base" / "python_vehicle_simulator" / "vehicles"
    folder.mkdir(parents=True)
    for package in (folder.parent, folder):
        (package / "__init__.py").write_text("")
    (folder / "remus100.py").write_text(BASE)
    ((name, text),) = written(Fossen(), vehicle).items()
    (tmp_path / name).write_text(text)
    (tmp_path / "asked.json").write_text(json.dumps({"states": rows, "steps": steps}))
    places = [str(tmp_path / "base"), str(tmp_path / name), str(tmp_path / "asked.json")]
    done = subprocess.run([sys.executable, "-c", RUN, *places], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def in_a_wake():
    """A propeller whose thrust falls with its inflow, behind a hull that slows it and that it pulls back."""
    vehicle = with_terms(published(), T_nabsn=6e-4, T_nu=-2e-3)
    return replace(vehicle, hull=replace(vehicle.hull, wake=0.25, thrust_deduction=0.15))


@pytest.mark.parametrize(
    "name",
    [
        "rich",
        "commanded",
        "wake",
        "law",
        *(pytest.param(name, marks=pytest.mark.proof) for name in ("remus100_prestero", "bluerov2_heavy")),
    ],
)
def test_accelerations_are_ours(name, tmp_path):
    made = {"rich": rich, "commanded": commanded, "wake": in_a_wake, "law": with_law}
    vehicle = made[name]() if name in made else published(name)
    nu, phi, theta, controls = states(vehicle)
    order = controls_of(vehicle)
    signs = {"delta_r": -1.0, "n": 30 / np.pi}
    columns = [controls.get(key, 0 * phi) * signs.get(key, 1.0) for key in order]
    rows = [
        [[0, 0, 0, float(phi[i]), float(theta[i]), 0.3], nu[:, i].tolist(), [float(c[i]) for c in columns]]
        for i in range(nu.shape[1])
    ]
    out = ran(vehicle, tmp_path, rows)
    mass = vehicle.rigid_mass + vehicle.added_mass
    assert_equal(mass @ np.array(out["rates"]).T, own_force(vehicle, nu, phi, theta, controls))
    assert out["dimU"] == len(order)
    assert "Body axes forward, starboard and down" in out["doc"]


def test_a_step_holds_limits_lags_and_current(tmp_path):
    """Rudder command beyond its limit, one without lag beyond its limit, and a propeller whose rate is limited."""
    vehicle = rich()
    pose, nu = [0.0, 0.0, 5.0, 0.1, -0.1, 0.7], [1.2, 0.1, -0.1, 0.02, 0.03, -0.2]
    actual, wanted = [0.05, 0.1, 600.0], [0.5, -0.7, 3000.0]
    out = ran(vehicle, tmp_path, steps=[[pose, nu, actual, wanted]])
    ((after, controls),) = out["steps"]
    rudder = 0.05 + 0.02 * min(1.0, (0.2 - 0.05) / 0.1)
    turns = 600.0 + 0.02 * 60.0 * 30 / np.pi
    np.testing.assert_allclose(controls, [rudder, -0.2, turns], rtol=1e-12)
    water = np.array([0.3 * np.cos(np.radians(20) - 0.7), 0.3 * np.sin(np.radians(20) - 0.7), 0, 0, 0, 0])
    through = (np.array(nu) - water)[:, None]
    given = {"delta_r": np.array([-0.05]), "delta_s": np.array([-0.2]), "n": np.array([600.0 * np.pi / 30])}
    force = own_force(vehicle, through, np.array([0.1]), np.array([-0.1]), given)
    rate = np.linalg.solve(vehicle.rigid_mass + vehicle.added_mass, force)[:, 0]
    rate[:2] += [nu[5] * water[1], -nu[5] * water[0]]
    np.testing.assert_allclose(after, np.array(nu) + 0.02 * rate, rtol=1e-10)


def test_a_vehicle_without_actuators_follows_at_once_and_an_absent_rudder_has_no_effect(tmp_path):
    vehicle = replace(rich(), actuators={})
    gone = [name for name in vehicle.coefficients if name.endswith("delta_r")]
    bare = replace(vehicle, coefficients={k: x for k, x in vehicle.coefficients.items() if k not in gone})
    pose, nu, wanted = [0.0] * 6, [1.2, 0.1, 0.0, 0.0, 0.0, 0.1], [9.0, -2.0, 9000.0]
    out = ran(bare, tmp_path, steps=[[pose, nu, [0.0, 0.0, 0.0], one] for one in (wanted, [0.0, *wanted[1:]])])
    (after, controls), (same, _) = out["steps"]
    np.testing.assert_allclose(controls, wanted)
    assert after == same
    assert out["scale"] == [1.0, 1.0, pytest.approx(np.pi / 30)]
