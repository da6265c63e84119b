"""Heave alone, of an open frame whose net weight differs between dives: what drives it, and how much each dive weighs."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.thruster_check import mirrored_thrusters
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError
from seatrial.estimation.posterior.mode import find_mode
from tests.campaigns import joined, normal, priors, sensors

MASS, ADDED, DRAG, NOISE, STEP, COUNT = 11.0, 14.0, -60.0, 0.01, 0.1, 300
WEIGHTS = {"a": 2.0, "b": 6.0, "c": -3.0}
"""Net weight of each dive, N: ballast was changed between them."""
CAMPAIGN = joined(
    """[campaign]
name = "heave"
seed = 2

[vehicle]
mass = "11 kg"
moves = ["w"]
fixed = { Z_wdot = -14.0 }

[[vehicle.thrusters]]
place = ["0.2 m", "0.1 m", "0 m"]
direction = [1.0, 0.2, 0.0]

[[vehicle.thrusters]]
place = ["0 m", "0.1 m", "0 m"]
direction = [0.0, 0.0, 1.0]

[[vehicle.thrusters]]
place = ["0 m", "-0.1 m", "0 m"]
direction = [0.0, 0.0, 1.0]

[structure]
always = ["Z_wabsw"]

[prior.Z_wabsw]
distribution = "half-normal"
upper = 0.0
scale = 100.0
""",
    priors(net_weight=normal(0.0, 10.0)),
    """[prior.spread_net_weight]
distribution = "half-normal"
lower = 0.0
scale = 10.0
""",
    sensors(w="0.01 m/s"),
    """[estimation]
initial = "estimated"
varying = ["net_weight"]

[import]
fit = ["a", "b", "c"]

[[import.files]]
path = "{run}.csv"
time = { column = "t", unit = "s" }
channels.f_2 = { column = "port", unit = "N" }
channels.f_3 = { column = "starboard", unit = "N" }
channels.w = { column = "w", unit = "m/s" }
""",
)


def write_heave(folder, text=CAMPAIGN):
    """Write the campaign and its logs, integrated by small Euler steps."""
    (folder / "campaign.toml").write_text(text)
    random = np.random.default_rng(5)
    for label, weight in WEIGHTS.items():
        w, rows = 0.0, ["t,port,starboard,w,main"]
        for k in range(COUNT):
            port, starboard = (4.0 if (k // 40 + shift) % 2 else -1.0 for shift in (0, 1))
            rows.append(f"{STEP * k:.1f},{port},{starboard},{w + NOISE * random.normal():.5f},7.0")
            for _ in range(20):
                w += STEP / 20 * (port + starboard + DRAG * w * abs(w) + weight) / (MASS + ADDED)
        (folder / f"{label}.csv").write_text("\n".join(rows) + "\n")
    return load_campaign(folder)


def test_only_thrusters_that_push_along_an_axis_that_moves_are_controls(tmp_path):
    campaign = write_heave(tmp_path)
    assert campaign.model(campaign.full).controls == ("f_2", "f_3")
    assert [one.controls for one in get_trials(campaign).fit] == [("f_2", "f_3")] * 3
    assert mirrored_thrusters(campaign.vehicle, campaign.full)["p"] == ("f_2", "f_3")


def test_a_column_of_a_thruster_that_cannot_act_may_be_mapped(tmp_path):
    text = CAMPAIGN.replace("channels.w", 'channels.f_1 = { column = "main", unit = "N" }\nchannels.w')
    campaign = write_heave(tmp_path, text)
    assert {"f_2", "f_3"} <= {*get_trials(campaign).fit[0].controls}


@pytest.mark.proof
def test_the_net_weight_of_each_dive(tmp_path):
    campaign = write_heave(tmp_path)
    posterior = build_posterior(campaign, campaign.full, get_trials(campaign).fit)
    assert {"spread_net_weight", *(f"dev_net_weight[{label}]" for label in WEIGHTS)} <= {*posterior.names}
    mode = find_mode(posterior, key=random_key(1, "mode"))
    found = dict(zip(mode.names, mode.values, strict=True))
    assert found["Z_wabsw"] == pytest.approx(DRAG, rel=0.05)
    for label, weight in WEIGHTS.items():
        own = found["net_weight"] + found["spread_net_weight"] * found[f"dev_net_weight[{label}]"]
        assert own == pytest.approx(weight, abs=0.15), label


def test_an_unknown_without_a_prior_or_of_one_sign_cannot_vary(tmp_path):
    for name in ("x_b", "lag_f"):
        with pytest.raises(InputError, match=r"estimation\.varying[^$]*Z_wabsw, net_weight"):
            write_heave(tmp_path, CAMPAIGN.replace('["net_weight"]', f'["{name}"]'))
