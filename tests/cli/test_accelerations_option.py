"""`seatrial import --accelerations`: a table and a picture beside the campaign, and what was found in words."""

import csv

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.campaign.data.accelerations import check_names
from seatrial.cli.main import app
from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Provenance, make_record

CAMPAIGN = """
[campaign]
name = "accelerations"
seed = 1

[vehicle]
mass = "unknown"

[structure]
always = ["N_r", "N_tau_N"]

[prior]
N_r = { distribution = "normal", mean = -1.0, sd = 0.5 }
N_tau_N = { distribution = "normal", mean = 1.0, sd = 0.5 }

[sensors]
r = { noise = "0.3 deg/s" }

[design]
control = "tau_N"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = { from = "5 N m", to = "10 N m", points = 2 }
period = { from = "5 s", to = "10 s", points = 2 }

[estimation]
initial = "measured"

[import]
fit = ["one"]

[[import.files]]
path = "{run}.csv"
time = { column = "t", unit = "s" }

[import.files.channels]
tau_N = { column = "moment", unit = "N m" }
r = { column = "rate", unit = "deg/s" }
"""
NOISE = np.deg2rad(0.3)


@pytest.fixture
def folder(tmp_path):
    """A first-order yaw rate under a moment that is switched, measured with noise."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    random, r, rows = np.random.default_rng(3), 0.0, []
    for k in range(600):
        moment = 0.2 if k // 100 % 2 == 0 else -0.2
        rows.append((0.1 * k, moment, np.rad2deg(r + NOISE * random.normal())))
        r = moment + (r - moment) * np.exp(-0.1)
    with (tmp_path / "one.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("t", "moment", "rate"), *rows])
    return tmp_path


def truth():
    """Acceleration of the same vehicle, whose yaw rate falls towards the moment by 1/s, in closed form over each stretch."""
    r, found = 0.0, []
    for k in range(600):
        moment = 0.2 if k // 100 % 2 == 0 else -0.2
        found.append(moment - r)
        r = moment + (r - moment) * np.exp(-0.1)
    return np.array(found)


def test_values_and_rates_are_written_with_their_sd(folder):
    result = CliRunner().invoke(app, ["import", str(folder), "--quiet", "--accelerations", "r"])
    assert result.exit_code == 0, result.output
    assert "record one, r: noise 0.005" in result.output
    assert "0.00524 stated" in result.output
    with (folder / "accelerations-one.csv").open() as file:
        head, *rows = csv.reader(file)
    assert head == ["time_s", "r [rad/s]", "r_sd [rad/s]", "rdot [rad/s^2]", "rdot_sd [rad/s^2]"]
    time, _, _, rate, sd = np.array(rows, float).T
    assert time == pytest.approx(0.1 * np.arange(600))
    settled = np.arange(600) % 100 > 5
    assert np.mean(abs(rate - truth())[settled] < 2 * sd[settled]) > 0.9
    assert (folder / "accelerations-one.svg").read_text().endswith("</svg>\n")


@pytest.mark.parametrize("channels", ["u", "r,q", "", "tau_N"])
def test_a_channel_that_is_not_measured_is_named_before_anything_is_written(folder, channels):
    result = CliRunner().invoke(app, ["import", str(folder), "--quiet", "--accelerations", channels])
    assert isinstance(result.exception, InputError)
    assert "no measured channel of record" in str(result.exception)
    assert not list(folder.glob("accelerations*"))


def test_a_velocity_that_is_given_to_the_equations_was_measured_too():
    channels = (Channel("u", "m/s", "control"), Channel("n", "rad/s", "control"), Channel("r", "rad/s", "measurement"))
    columns = {"u": np.ones(5), "n": np.ones(5), "r": np.arange(5.0)}
    record = make_record(np.arange(5.0), columns, channels, Provenance("here", ""))
    check_names(record, ["u", "r"], "--accelerations")
    with pytest.raises(InputError, match="one or several of r, u,"):
        check_names(record, ["n"], "--accelerations")
