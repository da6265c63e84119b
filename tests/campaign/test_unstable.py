"""A vehicle that runs away without its autopilot: filter error finds its coefficients from a log of a closed loop."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import import_trials
from seatrial.campaign.inference.quick_estimates import posterior_modes
from seatrial.vehicles.catalogue import load_vehicle

TERMS = ("Y_uv", "Y_uudelta_r", "N_uv", "N_ur", "N_uudelta_r")
CAMPAIGN = f"""
[campaign]
name = "runs away"
seed = 1
[vehicle]
catalogue = "remus100_hall_anstee"
moves = ["v", "r"]
measured_inputs = ["u"]
published_prior_sd = "50 %"
[structure]
always = {list(TERMS)}
[prior]
process_v = {{ distribution = "log-uniform", lower = 0.0005, upper = 0.5 }}
process_r = {{ distribution = "log-uniform", lower = 0.0005, upper = 0.5 }}
[sensors]
v = {{ noise = "0.02 m/s" }}
r = {{ noise = "0.004 rad/s" }}
[estimation]
initial = "measured"
likelihood = "filter-error"
[design]
control = "delta_r"
duration = "60 s"
active = "40 s"
sample_time = "0.1 s"
amplitude = {{ from = "2 deg", to = "10 deg", points = 3 }}
period = {{ from = "6 s", to = "18 s", points = 3 }}
[import]
fit = ["1"]
[[import.files]]
path = "log_{{run}}.csv"
time = {{ column = "t", unit = "s" }}
channels.delta_r = {{ column = "rudder", unit = "rad" }}
channels.u = {{ column = "u", unit = "m/s" }}
channels.v = {{ column = "v", unit = "m/s" }}
channels.r = {{ column = "r", unit = "rad/s" }}
"""


def turning(c, mass, inertia):
    """Rates of sway and yaw from the equations, and their derivatives at rest; the forward speed is given."""
    body = np.linalg.inv([[mass - c["Y_vdot"], -c["Y_rdot"]], [-c["N_vdot"], inertia - c["N_rdot"]]])

    def rates(state, u, rudder):
        v, r = state
        sway = c["Y_uv"] * u * v + (c["Y_ur"] - mass) * u * r + c["Y_vabsv"] * v * abs(v) + c["Y_rabsr"] * r * abs(r)
        yaw = c["N_uv"] * u * v + c["N_ur"] * u * r + c["N_vabsv"] * v * abs(v) + c["N_rabsr"] * r * abs(r)
        fin = np.array([c["Y_uudelta_r"], c["N_uudelta_r"]]) * u * u * rudder
        return body @ (np.array([sway, yaw]) + fin)

    return rates


@pytest.mark.proof
def test_a_closed_loop_on_an_unstable_vehicle(tmp_path):
    vehicle = load_vehicle("remus100_hall_anstee")
    rates = turning({**vehicle.hull.fixed, **vehicle.coefficients}, vehicle.hull.mass, vehicle.hull.inertia[2])
    at_rest = np.column_stack([rates(1e-9 * way, 1.5, 0.0) / 1e-9 for way in np.eye(2)])
    assert np.linalg.eigvals(at_rest).real.max() > 0.5
    random, step, state, psi, rows = np.random.default_rng(2), 0.1, np.zeros(2), 0.0, []
    for k in range(900):
        wanted = 0.6 * np.sign(np.sin(2 * np.pi * k * step / 30))
        rudder = float(np.clip(wanted * -1.0 + psi + 1.2 * state[1], -0.22, 0.22))
        u = 1.5 + 0.1 * np.sin(0.05 * k)
        rows.append((k * step, rudder, u, *(state + [0.02, 0.004] * random.normal(size=2))))
        for _ in range(50):
            state = state + step / 50 * rates(state, u, rudder)
            psi += step / 50 * state[1]
    np.savetxt(tmp_path / "log_1.csv", rows, delimiter=",", header="t,rudder,u,v,r", comments="", fmt="%.6f")
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    campaign = load_campaign(tmp_path)
    (answer,) = posterior_modes(campaign, import_trials(campaign))
    found = {name: pairs[0] for name, _, pairs in answer.rows}
    for name in TERMS:
        value, sd = found[name]
        assert abs(value - vehicle.coefficients[name]) < 4 * sd, name
        assert sd < 0.5 * abs(vehicle.coefficients[name]) * 0.9, name
