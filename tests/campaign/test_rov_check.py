"""What `check` says of an ROV's log by the campaign that `init --log` makes: guessed thrust, unknown buoyancy, a DVL that is turned."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.vehicle_campaign import vehicle_campaign_text
from seatrial.campaign.data.check import check_records
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference import modes
from seatrial.core.errors import InputError
from seatrial.core.findings import Finding
from seatrial.messages.render import remedy

EXAMPLE = Path(__file__).parents[2] / "examples" / "thruster_rov"
MOUNT = """
[mounts.dvl]
channels = ["u", "v", "w"]
yaw = "45 deg"
"""


@pytest.fixture(scope="module")
def turned(motion, tmp_path_factory):
    """A campaign whose DVL is turned by 45 degrees, and its records."""
    campaign = rov(tmp_path_factory.mktemp("turned"), motion, yaw=45.0)
    return campaign, get_trials(campaign)


@pytest.fixture(scope="module")
def motion():
    """Pulse widths and states of a minute, by name, at 50 Hz."""
    bag = runpy.run_path(str(EXAMPLE / "make_bag.py"))
    pulse = bag["pulses"]()
    states, names = bag["motion"](pulse)
    return pulse, dict(zip(names, states.T, strict=True))


def findings(folder, motion, **changes):
    """What is found about its log."""
    campaign = rov(folder, motion, **changes)
    (judged,) = check_records(campaign, get_trials(campaign))
    return judged.findings


def rov(folder, motion, yaw=0.0, depth_scale=1.0, more=""):
    """A campaign of its log at 10 Hz, with a DVL turned by so many degrees about the vertical."""
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
    text = vehicle_campaign_text(folder, "bluerov2_heavy", folder / "dive.csv")
    (folder / "campaign.toml").write_text(text.replace("[design]", more + "\n[design]"))
    return load_campaign(folder)


@pytest.mark.proof
def test_depth_is_not_judged_where_the_priors_allow_it(tmp_path, motion):
    """With the buoyancy unknown it may go either way; depth in centimetres goes further than any vehicle of the priors."""
    found = findings(tmp_path, motion)
    assert [one for one in found if one.level == "alarm" and not one.code.startswith("thruster")] == []
    (depth,) = [one for one in found if "z" in one.subject and one.code != "outliers"]
    assert (depth.code, depth.level) == ("sum-not-judged", "note")
    assert not any(one.code == "sensor-turned" for one in found)
    (size,) = [
        one
        for one in findings(tmp_path, motion, depth_scale=1000.0)
        if one.subject == ("z",) and one.code == "size-unlike"
    ]
    assert size.level == "alarm"


@pytest.mark.proof
def test_a_turned_doppler_log_is_named_with_its_mount(turned):
    (judged,) = check_records(*turned)
    (mounting,) = [one for one in judged.findings if one.code == "sensor-turned"]
    assert (mounting.subject, mounting.level) == (("u", "v", "w"), "alarm")
    assert (mounting.values["part"], mounting.values["mount"]) == ("yaw", "dvl")
    assert abs(mounting.values["degrees"] - 45.0) < 8.0
    assert '[mounts.dvl] with channels = ["u", "v", "w"] and yaw = "' in remedy(mounting)
    assert "[prior.yaw_dvl]" in remedy(mounting)


@pytest.mark.proof
def test_a_mount_that_is_stated_is_believed(tmp_path, motion):
    found = findings(tmp_path, motion, yaw=45.0, more=MOUNT)
    assert not any(one.code == "sensor-turned" for one in found)
    assert {one.level for one in found if one.code == "direction-reversed" and one.subject[0] in "uvw"} == {"pass"}


@pytest.mark.proof
def test_a_prior_that_excludes_the_data_is_refused_with_what_the_check_finds(turned, monkeypatch):
    campaign, trials = turned
    study = Study(campaign, trials.fit)
    values = {"value": 0.2, "unit": "m/s", "beyond": 0.3, "gain": 50.0, "channel": "u"}
    finding = Finding("prior-excludes-data", "alarm", ("sigma_u",), values, ("explain-channel",))
    monkeypatch.setattr(modes, "prior_excluding_data", lambda posterior, mode: finding)
    with pytest.raises(InputError, match="check units") as caught:
        modes.check_prior_of(study, None, None)
    assert "looks turned" in caught.value.remedy
    assert caught.value.remedy.startswith("`seatrial check` finds a likely cause: run 1: ")
    line = int(caught.value.where.split("campaign.toml:")[1].split(",")[0])
    assert campaign.text.splitlines()[line - 1].startswith("u = { noise")
    assert campaign.where_of_prior("prior.tau_u") == f"{campaign.path}, key prior.tau_u"
