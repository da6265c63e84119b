"""A BlueROV2 Heavy from the pulse widths, gyro, depth and motion capture of a ROS bag to its coefficients, twenty times.

Truth lies within two standard deviations as often as a normal posterior has it, and never far outside.
"""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.compiled.random_keys import random_key
from seatrial.estimation.posterior.mode import find_mode

pytestmark = pytest.mark.proof
EXAMPLE = Path(__file__).parents[2] / "examples" / "thruster_rov"
SEEDS, SAMPLES = 20, 1500
DOPPLER = """table = "/dvl/twist"
axes = "ENU"
channels.u = { column = "twist.linear.x", unit = "m/s" }
channels.v = { column = "twist.linear.y", unit = "m/s" }
channels.w = { column = "twist.linear.z", unit = "m/s" }
"""
MOTION_CAPTURE = """table = "/mocap/pose"
axes = "ENU"
channels.x = { column = "pose.position.y", unit = "m" }
channels.y = { column = "pose.position.x", unit = "m" }
"""
CHANGES = {
    DOPPLER: MOTION_CAPTURE,
    'positions = ["z"]': 'positions = ["x", "y", "z"]',
    'u = { noise = "0.01 m/s" }\nv = { noise = "0.01 m/s" }\nw = { noise = "0.01 m/s" }\n': (
        'x = { noise = "0.005 m" }\ny = { noise = "0.005 m" }\n'
    ),
}


def test_truth_is_within_two_standard_deviations_in_twenty_bags(tmp_path):
    bag = runpy.run_path(str(EXAMPLE / "make_bag.py"))
    pulse = bag["pulses"]()[:SAMPLES]
    states, names = bag["motion"](pulse)
    text = (EXAMPLE / "campaign.toml").read_text()
    for old, new in CHANGES.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    truth = {**bag["TRUTH"], "lag_f": bag["LAG"]}
    off, attitude = [], []
    for seed in range(SEEDS):
        folder = tmp_path / str(seed)
        folder.mkdir()
        (folder / "campaign.toml").write_text(text)
        bag["write_curve"](folder)
        bag["write_bag"](folder / "pool", pulse, dict(zip(names, states.T, strict=True)), seed)
        campaign = load_campaign(folder)
        posterior = build_posterior(campaign, campaign.full, get_trials(campaign).fit)
        mode = find_mode(posterior, key=random_key(seed, "mode"))
        at = [mode.names.index(name) for name in truth]
        off.append((mode.values[at] - list(truth.values())) / mode.sd[at])
        attitude.append(np.mean([mode.by_name[f"sigma_q_{part}"] ** 2 for part in "wxyz"]))
        print(seed, np.round(off[-1], 2).tolist(), flush=True)
    # An error of attitude has three directions, a quaternion four parts, each of half the angle.
    assert 2.0 * np.sqrt(np.mean(attitude)) == pytest.approx(bag["NOISE"]["attitude"], rel=0.01)
    away = np.abs(np.array(off))
    for limit in (1.0, 2.0):
        share, count = float(stats.chi2.cdf(limit**2, 1)), away.size
        low, high = stats.binom.ppf([5e-4, 1.0 - 5e-4], count, share)
        inside = int((away <= limit).sum())
        print(f"{inside} of {count} within {limit:g} sd, expected {low:g} to {high:g}")
        assert low <= inside <= high
    assert away.max() < stats.norm.isf(5e-4 / away.size)
