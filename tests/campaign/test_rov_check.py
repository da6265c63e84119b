"""What `check` says of an ROV's log by the campaign that `init --log` makes: guessed thrust, unknown buoyancy, a DVL that is turned."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.log_campaign import log_campaign_text
from seatrial.campaign.data.check import check_records
from seatrial.campaign.data.import_logs import get_trials

EXAMPLE = Path(__file__).parents[2] / "examples" / "thruster_rov"
MOUNT = """
[mounts.dvl]
channels = ["u", "v", "w"]
yaw = "45 deg"
"""


@pytest.fixture(scope="module")
def motion():
    """Pulse widths and states of a minute, by name, at 50 Hz."""
    bag = runpy.run_path(str(EXAMPLE / "make_bag.py"))
    pulse = bag["pulses"]()
    states, names = bag["motion"](pulse)
    return pulse, dict(zip(names, states.T, strict=True))


def findings(folder, motion, yaw=0.0, depth_scale=1.0, more=""):
    """Of its log at 10 Hz, with a DVL turned by so many degrees about the vertical."""
    from scipy.spatial.transform import Rotation

    (pulse, state), rng = motion, np.random.default_rng(1)
    velocity = np.stack([state[name] for name in "uvw"], axis=1)
    shown = Rotation.from_euler("z", yaw, degrees=True).inv().apply(velocity) + 0.01 * rng.normal(size=velocity.shape)
    rates = np.stack([state[name] for name in "pqr"], axis=1) + 0.005 * rng.normal(size=velocity.shape)
    parts = np.stack([state[f"q_{part}"] for part in "wxyz"], axis=1)
    depth = depth_scale * (state["z"] + 0.02 * rng.normal(size=len(pulse)))
    columns = np.column_stack([0.02 * np.arange(len(pulse)), pulse, shown, rates, parts, depth])[::5]
    names = ["t", *(f"pwm{k}_us" for k in range(1, 9)), "u_mps", "v_mps", "w_mps", "p_rad_s", "q_rad_s", "r_rad_s"]
    names += ["q_w", "q_x", "q_y", "q_z", "depth_m"]
    np.savetxt(folder / "dive.csv", columns, delimiter=",", header=",".join(names), comments="", fmt="%.7g")
    text = log_campaign_text(folder, "bluerov2_heavy", folder / "dive.csv")
    (folder / "campaign.toml").write_text(text.replace("[design]", more + "\n[design]"))
    campaign = load_campaign(folder)
    (judged,) = check_records(campaign, get_trials(campaign))
    return judged.findings


def test_depth_is_not_judged_where_the_priors_allow_it(tmp_path, motion):
    """With the buoyancy unknown it may go either way; depth in centimetres goes further than any vehicle of the priors."""
    found = findings(tmp_path, motion)
    assert [one.signal for one in found if one.level == "fail" and one.check != "thruster"] == []
    (depth,) = [one for one in found if one.signal == "z" and one.check != "outliers"]
    assert (depth.check, depth.level) == ("direction", "note")
    assert not any(one.check == "mounting" for one in found)
    (size,) = [
        one for one in findings(tmp_path, motion, depth_scale=1000.0) if one.signal == "z" and one.check == "size"
    ]
    assert size.level == "caution"


def test_a_turned_doppler_log_is_named_with_its_mount(tmp_path, motion):
    (mounting,) = [one for one in findings(tmp_path, motion, yaw=45.0) if one.check == "mounting"]
    assert (mounting.signal, mounting.level) == ("u, v, w", "fail")
    assert "about the vertical axis" in mounting.value
    assert abs(float(mounting.value.split()[2]) - 45.0) < 8.0
    assert '[mounts.dvl] with channels = ["u", "v", "w"] and yaw = "' in mounting.remedy
    assert "[prior.yaw_dvl]" in mounting.remedy


def test_a_mount_that_is_stated_is_believed(tmp_path, motion):
    found = findings(tmp_path, motion, yaw=45.0, more=MOUNT)
    assert not any(one.check == "mounting" for one in found)
    assert {one.level for one in found if one.check == "direction" and one.signal in "uvw"} == {"pass"}
