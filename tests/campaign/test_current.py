"""A Doppler log over ground and a USBL with outliers, in a current: the water's velocity is a state, and drag is that of the water."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.quick_estimates import posterior_modes
from seatrial.core.errors import InputError
from tests.campaign.test_misaligned import CAMPAIGN, SAMPLES, STEP, TRUTH, motion
from tests.campaigns import write_campaign

CURRENT = np.array([0.25, -0.15])
OUTLIERS = 0.08


def write(folder, sensors, *changes):
    """Write the log of the plane ROV: speeds over ground, heading, and position by a USBL with gross errors."""
    tau, states, h = motion()
    psi = np.concatenate([[0.0], np.cumsum(states[:-1, 2] * h)])
    cos, sin = np.cos(psi), np.sin(psi)
    north = states[:, 0] * cos - states[:, 1] * sin + CURRENT[0]
    east = states[:, 0] * sin + states[:, 1] * cos + CURRENT[1]
    place = np.stack([np.concatenate([[0.0], np.cumsum(one[:-1] * h)]) for one in (north, east)])
    rows = np.arange(SAMPLES) * round(STEP / h)
    c, s, n, e = (one[rows] for one in (cos, sin, north, east))
    rng = np.random.default_rng(5)
    over = np.stack([n * c + e * s, -n * s + e * c]) + 0.01 * rng.normal(size=(2, SAMPLES))
    usbl = place[:, rows] + 0.1 * rng.normal(size=(2, SAMPLES))
    wrong = rng.random(SAMPLES) < OUTLIERS
    usbl[:, wrong] += rng.normal(0.0, 15.0, (2, wrong.sum()))
    turn = [states[rows, 2] + 0.005 * rng.normal(size=SAMPLES), psi[rows] + 0.01 * rng.normal(size=SAMPLES)]
    table = np.column_stack([STEP * np.arange(SAMPLES), tau, *over, *turn, *usbl])
    folder.mkdir(parents=True, exist_ok=True)
    heads = "t,tau_X,tau_Y,tau_N,u,v,r,psi,x,y"
    np.savetxt(folder / "log.csv", table, delimiter=",", header=heads, comments="", fmt="%.9g")
    text = CAMPAIGN.replace('[mounts.dvl]\nchannels = ["u", "v"]\n', "")
    own, a = text[text.index("[sensors]") : text.index("[design]")], text.index("channels.u =")
    more = (
        'channels.u_g = { column = "u", unit = "m/s" }\nchannels.v_g = { column = "v", unit = "m/s" }\n'
        'channels.psi = { column = "psi", unit = "rad" }\n'
    )
    if "[sensors.x]" in sensors:
        more += 'channels.x = { column = "x", unit = "m" }\nchannels.y = { column = "y", unit = "m" }\n'
    text = text[:a] + more + text[text.index("channels.r =") :]
    text = text.replace(own, sensors + "\n").replace("[import]\n", '[estimation]\ninitial = "estimated"\n\n[import]\n')
    write_campaign(folder, text.replace('moves = ["u", "v", "r"]', 'moves = ["u", "v", "r"]\ncurrent = true'), *changes)
    return load_campaign(folder)


def fitted(campaign):
    (answer,) = posterior_modes(campaign, get_trials(campaign))
    assert answer.rows, answer.alarm
    return {name: pair for name, _, (pair,) in answer.rows}


GYRO = '[sensors.r]\nnoise = "0.005 rad/s"\n\n[sensors.psi]\nnoise = "0.01 rad"\n'
LOG = '[sensors.u_g]\nnoise = "0.01 m/s"\n\n[sensors.v_g]\nnoise = "0.01 m/s"\n\n' + GYRO
HEAVY = 'residuals = "heavy"\n'
TAILS = "".join(f'\n[prior.dof_{axis}]\ndistribution = "log-uniform"\nlower = 0.3\nupper = 50.0\n' for axis in "xy")
"""Errors 150 times the noise: tails heavier than those that the usual prior allows."""
USBL = f'[sensors.x]\nnoise = "0.1 m"\n{HEAVY}\n[sensors.y]\nnoise = "0.1 m"\n{HEAVY}\n' + GYRO + TAILS
PLACES = ("current = true", 'current = true\npositions = ["x", "y"]')


@pytest.mark.parametrize(("sensors", "changes"), [(LOG, ()), pytest.param(USBL, (PLACES,), marks=pytest.mark.proof)])
def test_drag_and_the_current_are_found(tmp_path, sensors, changes):
    found = fitted(write(tmp_path, sensors, *changes))
    for name, value in {**TRUTH, "current_x_0[log]": CURRENT[0], "current_y_0[log]": CURRENT[1]}.items():
        mean, sd = found[name]
        assert abs(mean - value) < 3.3 * sd, (name, mean, sd, value)
    assert found["current_x_0[log]"][1] < 0.05
    assert found["X_uabsu"][1] < 0.25 * abs(TRUTH["X_uabsu"])


@pytest.mark.proof
def test_without_the_current_the_log_is_said_not_to_fit(tmp_path):
    changes = (("\ncurrent = true", ""), ("channels.u_g", "channels.u"), ("channels.v_g", "channels.v"))
    campaign = write(tmp_path, LOG.replace("u_g", "u").replace("v_g", "v"), *changes)
    with pytest.raises(InputError, match="Noise does not explain the error of u"):
        fitted(campaign)


def test_a_current_needs_starts_that_are_estimated(tmp_path):
    with pytest.raises(InputError, match=r"estimation\.initial"):
        write(tmp_path, LOG, ('initial = "estimated"', 'initial = "measured"'))
