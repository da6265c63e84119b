"""The body and its callback in MuJoCo, beside our simulation."""

import importlib.util

import numpy as np
import pytest

from seatrial.export.manoeuvre import plan_for, simulate
from seatrial.export.motion import motion_of
from seatrial.export.targets.mjcf import Mujoco
from tests.export.cases import published, rich, with_law, written

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed: the extra `export`")
VEHICLES = {
    "frame": lambda: published("bluerov2_heavy"),
    "ship": lambda: published("mariner"),
    "surge": lambda: published("remus100_surge"),
    "rich": rich,
    "law": with_law,
}


@pytest.fixture(autouse=True)
def alone():
    yield
    mujoco.set_mjcb_passive(None)
    mujoco.set_mjcb_act_dyn(None)


def loaded(vehicle, folder):
    """The module, with its callbacks in place, and the model."""
    for name, text in written(Mujoco(), vehicle).items():
        (folder / name).write_text(text, encoding="utf-8")
        stem = name.partition(".")[0]
    spec = importlib.util.spec_from_file_location(stem, folder / f"{stem}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    model = mujoco.MjModel.from_xml_path(str(folder / f"{stem}.xml"))
    module.install()
    return module, model, mujoco.MjData(model)


@pytest.mark.parametrize("name", VEHICLES)
def test_it_moves_as_ours_for_a_minute(name, tmp_path):
    """From a roll, in a current, through the standard manoeuvre: far closer than 2 % of the motion."""
    vehicle, duration = VEHICLES[name](), 60.0
    module, model, data = loaded(vehicle, tmp_path)
    motion = motion_of(vehicle)
    model.opt.timestep = step = 0.05
    plan, current = plan_for(vehicle, motion), (0.1, -0.2, 0.0)
    start = np.zeros(8)
    start[0], start[6] = plan.speed, 0.1 if "p" in vehicle.moves else 0.0
    ours = simulate(motion, vehicle.actuators, plan.controls, start, duration, step, current)
    module.water = list(current)
    data.qpos[3:7] = np.cos(start[6] / 2), np.sin(start[6] / 2), 0.0, 0.0
    turn = np.array([[1, 0, 0], [0, np.cos(start[6]), -np.sin(start[6])], [0, np.sin(start[6]), np.cos(start[6])]])
    data.qvel[:3] = turn @ [plan.speed, 0.0, 0.0] + [0.1, 0.2, 0.0]
    found = []
    for i in range(round(duration / step) + 1):
        data.ctrl[:] = [plan.controls(i * step)[control] for control in vehicle.controls]
        if i == 0:
            module.begin(model, data)
            mujoco.mj_forward(model, data)
        found.append(module.nu_of(model, data))
        mujoco.mj_step(model, data)
    gap, reach = np.abs(np.array(found) - ours[:, :6]).max(0), np.ptp(ours[:, :6], axis=0)
    assert reach.max() > 0.05
    assert (gap <= 0.001 * reach + 1e-9).all(), (gap, reach)


def test_a_force_from_outside_meets_the_added_mass(tmp_path):
    """At rest, a push at the centre of gravity or along a joint gives (M_RB + M_A)^-1 of it, and weight as we have it."""
    vehicle = rich()
    _module, model, data = loaded(vehicle, tmp_path)
    mass = vehicle.rigid_mass + vehicle.added_mass
    still = motion_of(vehicle)(np.zeros(6), 0.0, 0.0, dict.fromkeys(vehicle.controls, 0.0))
    flip, force = np.array([1.0, -1, -1, 1, -1, -1]), np.array([3.0, -5.0, 4.0, 0.4, -0.3, 0.2])
    data.qfrc_applied[:] = force
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(flip * data.qacc, still + np.linalg.solve(mass, flip * force), rtol=1e-9, atol=1e-12)
    data.qfrc_applied[:] = 0.0
    data.xfrc_applied[1] = force
    mujoco.mj_forward(model, data)
    moment = force[3:] + np.cross(model.body_ipos[1], force[:3])
    about = np.concatenate([force[:3], moment])
    np.testing.assert_allclose(flip * data.qacc, still + np.linalg.solve(mass, flip * about), rtol=1e-9, atol=1e-12)


def test_another_model_is_left_alone(tmp_path):
    ball = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    loaded(published("bluerov2_heavy"), tmp_path)
    data = mujoco.MjData(ball)
    mujoco.mj_step(ball, data)
    np.testing.assert_allclose(data.qacc, [0, 0, -9.81, 0, 0, 0], atol=1e-12)
