"""Campaigns of whole vehicles: bodies of the catalogue and by hand, what moves, and coefficients known beforehand."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.design.searches import design_relay_trial
from seatrial.campaign.design.sweep import design_first
from seatrial.core.errors import InputError
from tests.campaign.small import write_summary
from tests.campaigns import joined, normal, priors, write_campaign

EXAMPLES = Path(__file__).parents[2] / "examples"
PITCH = """
[campaign]
name = "pitch"
seed = 5

[vehicle]
catalogue = "remus100_prestero"
moves = ["w", "q"]
measured_inputs = ["u"]
published_prior_sd = "20 %"

[vehicle.trim]
u = "1.54 m/s"

[structure]
always = ["M_uw", "M_uudelta_s"]

[sensors.q]
noise = "0.3 deg/s"

[sensors.theta]
noise = "0.2 deg"
rate = "5 Hz"

[limits.delta_s]
lower = "-13 deg"
upper = "13 deg"

[design]
control = "delta_s"
families = ["doublet"]
duration = "25 s"
active = "22 s"
sample_time = "0.1 s"
amplitude = { from = "6 deg", to = "10 deg", points = 2 }
period = { from = "2 s", to = "4 s", points = 2 }

[design.relay]
output = "theta"
threshold = { from = "2 deg", to = "4 deg", points = 2 }

[truth]
M_uw = 22.0
"""
OF_ALL = ("M_uw = 22.0\n", "M_uw = 22.0\nM_uudelta_s = -6.15\n")
"""Of a body by hand nothing is published, so that the truth has to name all."""
BY_HAND = joined(
    """name = "by hand"
mass = "30.48 kg"
inertia = ["0.177 kg m^2", "3.45 kg m^2", "3.45 kg m^2"]
centre_of_gravity = ["0 m", "0 m", "0.0196 m"]
weight = "299 N"
buoyancy = "306 N"
moves = ["w", "q"]
measured_inputs = ["u"]

[vehicle.fixed]
Z_wdot = -35.5
Z_qdot = -1.93
M_wdot = -1.93
M_qdot = -4.88
Z_wabsw = -1310.0
Z_qabsq = -0.632
Z_uw = -28.6
Z_uq = -5.22
Z_uudelta_s = -9.64
M_wabsw = 3.18
M_qabsq = -188.0
M_uq = -2.0
""",
    priors(M_uw=normal(24.0, 4.8), M_uudelta_s=normal(-6.15, 1.23)),
)


def pitch(folder, *changes):
    write_campaign(folder, PITCH, *changes)
    return load_campaign(folder)


def rate_of(campaign, values):
    model = campaign.model(campaign.full)
    state = dict.fromkeys(model.states, 0.0) | {"w": 0.1, "q": -0.05, "theta": 0.2}
    control = {"u": 1.5, "delta_s": 0.1}
    return np.array(
        model.derivative(values, tuple(state[x] for x in model.states), tuple(control[x] for x in model.controls))
    )


def test_published_damping_does_not_drive_the_vehicle():
    """One in twenty would, by a normal prior of 60 %; terms without a side of their own stay normal."""
    rov, torpedo = (load_campaign(EXAMPLES / name) for name in ("thruster_rov", "six_degrees"))
    published = rov.vehicle.published["X_u"]
    drag, lift = rov.prior("X_u"), torpedo.prior("Y_uv")
    cut = stats.truncnorm(-np.inf, 1 / 0.6, loc=published, scale=0.6 * abs(published))
    assert drag.bounds == (-np.inf, 0.0)
    assert (drag.mean, drag.sd) == (pytest.approx(cut.mean()), pytest.approx(cut.std()))
    assert (lift.bounds, lift.mean, lift.sd) == ((-np.inf, np.inf), -28.6, 28.6)


def test_published_coefficients_are_priors_where_sought_and_fixed_where_not(tmp_path):
    campaign = pitch(tmp_path)
    model = campaign.model(campaign.full)
    assert [term.text for term in model.coefficients] == ["M_uw", "M_uudelta_s"]
    assert {"w", "q", "theta"} <= set(model.states)
    prior = campaign.prior("M_uudelta_s")
    assert (prior.mean, prior.sd) == pytest.approx((-6.15, 1.23))
    assert campaign.hull.fixed["M_uq"] == -2.0
    assert "M_uw" not in campaign.hull.fixed


def test_a_body_by_hand_is_the_one_of_the_catalogue(tmp_path):
    (tmp_path / "hand").mkdir()
    known = pitch(tmp_path)
    by_hand = pitch(
        tmp_path / "hand",
        (
            'catalogue = "remus100_prestero"\nmoves = ["w", "q"]\nmeasured_inputs = ["u"]\npublished_prior_sd = "20 %"\n',
            BY_HAND,
        ),
        OF_ALL,
    )
    values = {"M_uw": 21.0, "M_uudelta_s": -6.0}
    np.testing.assert_allclose(rate_of(by_hand, values), rate_of(known, values), rtol=1e-12)


@pytest.mark.proof
def test_a_trial_is_designed_and_simulated_in_pitch(tmp_path):
    """What [truth] does not name is as published; the zigzag is between pitch angles."""
    campaign = pitch(tmp_path)
    best = design_first(campaign).best
    assert np.isfinite(best.gain).all()
    found, _ = design_relay_trial(campaign)
    assert found.output == "theta"
    record = get_trials(campaign).fit[0]
    assert record.measured == ("q", "theta")
    assert np.isfinite(record.channel("theta")).sum() == 125


def test_what_an_earlier_campaign_found_is_a_prior_or_fixed(tmp_path):
    found = {"M_uw": (22.5, 0.3), "M_uq": (-2.2, 0.1), "sigma_q": (1.0, 0.1)}
    write_summary(tmp_path / "first", ("M_uw", "M_uq"), **found)
    (tmp_path / "second").mkdir()
    campaign = pitch(tmp_path / "second", ("published_prior_sd", 'priors_from = ["../first"]\npublished_prior_sd'))
    prior = campaign.prior("M_uw")
    assert (prior.mean, prior.sd) == pytest.approx((22.5, 0.3))
    assert campaign.hull.fixed["M_uq"] == -2.2
    assert campaign.priors["M_uudelta_s"].mean == pytest.approx(-6.15)


def test_what_an_earlier_campaign_found_of_thrusters_and_balance_is_sought_again(tmp_path):
    """Each with its uncertainty, where this vehicle has it; a prior of its own counts more, and a vehicle without thrusters has no gain."""
    found = {"M_q": (-0.6, 0.1), "gain_f_3": (0.8, 0.02), "z_b": (-0.008, 1e-4), "gain_f_9": (1.0, 0.1)}
    write_summary(tmp_path / "first", ("M_q",), **found)
    example = Path(__file__).parents[2] / "examples" / "thruster_rov"
    (tmp_path / "second").mkdir()
    (tmp_path / "second" / "thrust.csv").write_text("pulse_us,thrust_N\n1100,-32\n1500,0\n1900,40\n")
    text = (example / "campaign.toml").read_text()
    own = text[text.index("[prior.gain_f_3]") : text.index("[prior.net_weight]")]
    text = text.replace(own, "").replace("published_prior_sd =", 'priors_from = ["../first"]\npublished_prior_sd =')
    (tmp_path / "second" / "campaign.toml").write_text(text)
    campaign = load_campaign(tmp_path / "second")
    assert "gain_f_9" not in campaign.priors
    prior = campaign.priors["gain_f_3"]
    assert float(prior.mean) == pytest.approx(0.8, rel=1e-3)
    assert float(prior.sd) == pytest.approx(0.02, rel=0.05)
    assert float(campaign.priors["z_b"].mean) == pytest.approx(-0.01)
    assert {"gain_f_3", "z_b"} <= {one.name for one in campaign.model(campaign.full).unknowns}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"remus100_prestero"', '"remus100_fossen"'), "no sum of named coefficients"),
        (('"20 %"', '"0 %"'), "a positive share"),
        (('moves = ["w", "q"]', 'moves = ["w", "yaw"]'), "moves"),
    ],
)
def test_vehicles_that_make_no_sense(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        pitch(tmp_path, change)


def test_a_quaternion_is_no_unknown_start(tmp_path):
    changes = [
        ('moves = ["w", "q"]', 'moves = ["v", "w", "p", "q", "r"]\nattitude = "quaternion"'),
        ('u = "1.54 m/s"', 'u = "1.54 m/s"\ndelta_r = "0 deg"'),
    ]
    campaign = pitch(tmp_path, *changes)
    assert campaign.state_trim(campaign.model(campaign.full))[-4:] == (1.0, 0.0, 0.0, 0.0)
    with pytest.raises(InputError, match=r"estimation\.initial(.|\n)*attitude as a quaternion"):
        pitch(tmp_path, *changes, ("[truth]", '[estimation]\ninitial = "estimated"\n\n[truth]'))
