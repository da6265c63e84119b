"""The command that judges records before anything is fitted to them."""

import csv

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.apps.cli import app

CAMPAIGN = """
[campaign]
name = "check"
seed = 1

[vehicle]
mass = "30 kg"

[structure]
always = ["X_tau_X", "X_uabsu"]

[prior.X_tau_X]
distribution = "normal"
mean = 1.0
sd = 0.2

[prior.X_uabsu]
distribution = "normal"
mean = -6.0
sd = 3.0

[sensors.u]
noise = "0.02 m/s"

[design]
control = "tau_X"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = { from = "5 N", to = "10 N", points = 2 }
period = { from = "5 s", to = "10 s", points = 2 }

[import]
fit = ["one"]

[[import.files]]
path = "{run}.csv"
time = { column = "t", unit = "s" }

[import.files.channels]
tau_X = { column = "force", unit = "N" }
u = { column = "speed", unit = "m/s", scale = SCALE }

[estimation]
initial = "measured"
"""


def write(folder, scale):
    """A vehicle of the prior means, by Euler steps, under a slow doublet."""
    folder.mkdir()
    (folder / "campaign.toml").write_text(CAMPAIGN.replace("SCALE", scale))
    random, u, rows = np.random.default_rng(3), 0.0, []
    for k in range(400):
        force = 10.0 if k < 150 else -10.0 if k < 300 else 0.0
        rows.append((0.1 * k, force, u + 0.02 * random.normal()))
        for _ in range(10):
            u += 0.01 * (force - 6.0 * u * abs(u)) / 30.0
    with (folder / "one.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("t", "force", "speed"), *rows])


@pytest.mark.parametrize(
    ("scale", "code", "told"),
    [("1.0", 0, "record one: pass"), ("-1.0", 3, "set scale = -1"), ("57.3", 0, "degrees taken for radians")],
)
def test_the_sign_and_the_unit_of_a_channel(tmp_path, scale, code, told):
    write(tmp_path / "a", scale)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"])
    assert result.exit_code == code, result.output
    assert told in result.output
    assert (tmp_path / "a" / "check-one.svg").read_text().endswith("</svg>\n")
