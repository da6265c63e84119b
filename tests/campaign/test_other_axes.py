"""Designs of a vehicle that turns: other controls stay at trim, and the relay is closed on every vehicle by itself."""

import json

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.design.problem import design_problem
from seatrial.campaign.design.searches import design_relay_trial, relay_search
from seatrial.campaign.design.sweep import design_first
from seatrial.core.errors import InputError
from seatrial.design.relay_sweep import RANGE_QUANTILES
from tests.campaigns import joined, normal, priors, write_campaign

YAW = joined(
    """[campaign]
name = "yaw"
seed = 3

[vehicle]
mass = "unknown"

[vehicle.trim]
u = "1.5 m/s"

[structure]
always = ["N_uur", "N_uudelta_r"]
""",
    priors(N_uur=normal(-0.5, 0.1), N_uudelta_r=normal(-0.4, 0.05)),
    """[sensors.r]
noise = "0.3 deg/s"
rate = "5 Hz"

[limits.delta_r]
lower = "-20 deg"
upper = "20 deg"
rate = "40 deg/s"

[limits.r]
upper = "10 deg/s"

[design]
control = "delta_r"
families = ["doublet"]
duration = "20 s"
active = "15 s"
ramp = "1 s"
sample_time = "0.1 s"
amplitude = { from = "5 deg", to = "12.5 deg", points = 2 }
period = { from = "4 s", to = "12 s", points = 2 }

[design.relay]
output = "r"
threshold = { from = "2 deg/s", to = "6 deg/s", points = 2 }

[truth]
N_uur = -0.55
N_uudelta_r = -0.35
""",
)


def yaw(folder, *changes):
    write_campaign(folder, YAW, *changes)
    return load_campaign(folder)


@pytest.mark.proof
def test_other_controls_stay_at_trim(tmp_path):
    campaign = yaw(tmp_path)
    best = design_first(campaign).best
    controls = dict(zip(campaign.model(campaign.full).controls, best.best_controls().T, strict=True))
    assert set(controls) == {"u", "delta_r"}
    np.testing.assert_array_equal(controls["u"], 1.5)
    assert np.ptp(controls["delta_r"]) == pytest.approx(2 * best.amplitude[best.best[0]])
    record = get_trials(campaign).fit[0]
    np.testing.assert_array_equal(record.channel("u"), 1.5)
    assert record.controls == ("u", "delta_r")


def test_a_control_without_a_trim_value(tmp_path):
    with pytest.raises(InputError, match=r"vehicle\.trim\.u"):
        design_first(yaw(tmp_path, ('u = "1.5 m/s"', 'v = "0 m/s"')))


def plain_steps(amplitude, threshold, draws, noise):
    """Rate and rudder of every vehicle, shape (S, n), and how often each relay reverses."""
    h, (a, b) = 0.1, draws.T * 1.5**2
    r, applied, side, reversals, course = *np.zeros((2, len(a))), np.ones(len(a)), np.zeros(len(a)), []
    for k, error in enumerate(noise.T):
        acts, seen = 1.0 <= k * h + 1e-9 < 16.0, -(r + error)
        turned = np.where(seen >= threshold, -1.0, np.where(seen <= -threshold, 1.0, side)) if acts else side
        reversals, side = reversals + (turned != side), turned
        wanted = side * amplitude if acts else np.zeros(len(a))
        applied = applied + np.clip(wanted - applied, -np.deg2rad(40) * h, np.deg2rad(40) * h)
        course.append((r, applied))
        r = np.exp(a * h) * r + (np.exp(a * h) - 1) / a * b * applied
    return *np.array(course).transpose(1, 2, 0), reversals


@pytest.mark.proof
def test_the_relay_is_closed_on_every_vehicle_by_itself(tmp_path):
    """With each draw's own loop, r goes to the threshold and back; the rule is kept with the schedule."""
    campaign = yaw(tmp_path)
    found, schedule = design_relay_trial(campaign)
    assert found.effect == -1.0
    assert found.oscillates > 0.95
    assert found.first_overshoot[0] > -0.03
    problem, search = design_problem(campaign), relay_search(campaign)
    draws = problem.draws_for("draws of the self-oscillation")
    fresh = slice(len(draws) // 2, None)
    noise = search._noise(problem, len(draws))[fresh]
    *_, reversals = plain_steps(found.amplitude, found.threshold, draws[fresh], noise)
    assert found.oscillates == (reversals >= 2).mean()
    np.testing.assert_array_equal(found.reversals, np.quantile(reversals[reversals >= 2], RANGE_QUANTILES))
    rule = json.loads(schedule.with_suffix(".json").read_text())["rule"]
    assert rule == found.rule
    assert "below trim once r is -" in rule
    again, _ = design_relay_trial(campaign)
    assert again.lines() == found.lines()


def test_the_loop_against_plain_steps_of_the_exact_solution(tmp_path):
    """r' = a r + b delta, held from sample to sample, has an exact step; without noise the relay sees r every other sample."""
    campaign = yaw(tmp_path)
    loop = relay_search(campaign).loop(design_problem(campaign))
    amplitude, threshold = np.deg2rad(12.5), np.deg2rad(4.0)
    noise = np.where(np.arange(200) % 2 == 0, 0.0, np.nan)[None]
    controls, outputs = loop.runs(amplitude, threshold, np.array([[-0.55, -0.35]]), noise)
    r, rudder, _ = plain_steps(amplitude, threshold, np.array([[-0.55, -0.35]]), noise)
    np.testing.assert_allclose(outputs, r, atol=2e-6)
    np.testing.assert_allclose(controls[..., 1], rudder, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            [('output = "r"', 'output = "psi"'), ('from = "2 deg/s", to = "6 deg/s"', 'from = "2 deg", to = "6 deg"')],
            "a measured channel: r",
        ),
        ([('from = "2 deg/s", to = "6 deg/s"', 'from = "90 deg/s", to = "95 deg/s"')], "and never on both sides"),
        ([('upper = "10 deg/s"', 'upper = "1 deg/s"')], r"r at most 1 deg/s: holds in \d+ of 400 draws"),
        (
            [("sd = 0.05", "sd = 0.25")],
            r"3 of 4 designs of the grid oscillate.*the best, ±12.5 deg reversed at ±2 deg/s, oscillates in \d\d%",
        ),
    ],
)
def test_relays_that_cannot_be_run(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        design_relay_trial(yaw(tmp_path, *changes))
