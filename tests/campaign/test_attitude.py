"""A body that tumbles over the vertical, whose log is made with SciPy's rotations: its attitude is compared as a quaternion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.posterior import build_posterior, initial_state
from seatrial.core.errors import InputError
from seatrial.estimation.posterior.first_guess import first_guess
from seatrial.vehicles.simulate import simulate
from tests.campaigns import joined, normal, priors, small_design, uniform

INERTIA, WEIGHT = np.array([0.4, 0.6, 0.6]), 100.0
TRUTH = {"K_p": -0.25, "M_q": -0.3, "N_r": -0.4, "z_b": -0.012}
NOISE = {"rate": 0.004, "attitude": 0.01}
CAMPAIGN = joined(
    """[campaign]
name = "tumbling"
seed = 1

[vehicle]
mass = "10.19367991845056 kg"
inertia = ["0.4 kg m^2", "0.6 kg m^2", "0.6 kg m^2"]
moves = ["p", "q", "r"]
fixed = { K_tau_K = 1.0, M_tau_M = 1.0, N_tau_N = 1.0 }

[structure]
always = ["K_p", "M_q", "N_r"]
""",
    priors(K_p=uniform(-1.0, 0.0), M_q=uniform(-1.0, 0.0), N_r=uniform(-1.0, 0.0), z_b=normal(0.0, 0.02)),
    """[sensors]
p = { noise = "0.004 rad/s" }
q = { noise = "0.004 rad/s" }
r = { noise = "0.004 rad/s" }
attitude = { noise = "0.01 rad" }

[estimation]
initial = "estimated"
""",
    small_design("tau_M", "0.5 N*m", "1 N*m"),
    """[import]
fit = ["log"]

[[import.files]]
path = "{run}.csv"
time = { column = "t", unit = "s" }

[import.files.channels]
tau_K = { column = "tau_K", unit = "N*m" }
tau_M = { column = "tau_M", unit = "N*m" }
tau_N = { column = "tau_N", unit = "N*m" }
p = { column = "p", unit = "rad/s" }
q = { column = "q", unit = "rad/s" }
r = { column = "r", unit = "rad/s" }
q_w = { column = "q_w", unit = "1" }
q_x = { column = "q_x", unit = "1" }
q_y = { column = "q_y", unit = "1" }
q_z = { column = "q_z", unit = "1" }
""",
)


def tumble(n=400, step=0.1, parts=10):
    """Moments, body rates and rotations: I domega/dt = tau - D omega - omega x I omega - r_b x B, midpoint rule."""
    rng = np.random.default_rng(6)
    tau = np.repeat(rng.uniform(-1.0, 1.0, (n // 20, 3)) * [0.5, 1.2, 0.4], 20, axis=0)
    damping, h = np.array([TRUTH["K_p"], TRUTH["M_q"], TRUTH["N_r"]]), step / parts
    omega, turn, rates, turns = np.zeros(3), Rotation.identity(), [], []

    def change(omega, turn, tau):
        up = turn.inv().apply([0.0, 0.0, -WEIGHT])
        moment = tau + damping * omega - np.cross(omega, INERTIA * omega) + np.cross([0.0, 0.0, TRUTH["z_b"]], up)
        return moment / INERTIA

    for k in range(n):
        rates.append(omega)
        turns.append(turn)
        for _ in range(parts):
            half = omega + 0.5 * h * change(omega, turn, tau[k])
            middle = turn * Rotation.from_rotvec(0.5 * h * omega)
            omega = omega + h * change(half, middle, tau[k])
            turn = turn * Rotation.from_rotvec(h * half)
    return tau, np.array(rates), Rotation.concatenate(turns)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The campaign with its log, in which every third quaternion has the other sign."""
    path, rng = tmp_path_factory.mktemp("tumbling"), np.random.default_rng(9)
    tau, rates, turns = tumble()
    pitch = turns.as_euler("ZYX")[:, 1]
    assert np.abs(pitch).max() > np.radians(75)
    assert (turns.as_matrix()[:, 2, 2] < 0).any()  # upside down
    n = len(tau)
    shown = turns * Rotation.from_rotvec(NOISE["attitude"] * rng.normal(size=(n, 3)))
    x, y, z, w = (shown.as_quat(canonical=True) * np.where(np.arange(n) % 3 == 0, -1.0, 1.0)[:, None]).T
    columns = (0.1 * np.arange(n), *tau.T, *(rates + NOISE["rate"] * rng.normal(size=(n, 3))).T, w, x, y, z)
    rows = [",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True)]
    (path / "log.csv").write_text("t,tau_K,tau_M,tau_N,p,q,r,q_w,q_x,q_y,q_z\n" + "\n".join(rows) + "\n")
    (path / "campaign.toml").write_text(CAMPAIGN)
    return path


@pytest.mark.proof
def test_attitude_is_continuous_and_a_tumbling_body_is_identified(folder):
    campaign = load_campaign(folder)
    (record,) = get_trials(campaign).fit
    parts = np.stack([record.channel(name) for name in ("q_w", "q_x", "q_y", "q_z")])
    assert (np.sum(parts[:, 1:] * parts[:, :-1], axis=0) > 0.9).all()
    model = campaign.model(campaign.full)
    start = initial_state(campaign, model, record)
    assert abs(dict(zip(model.states, start, strict=True))["q_w"]) == pytest.approx(1.0, abs=0.01)
    guess = first_guess(model, [record], [start], campaign.priors)
    for name, value in TRUTH.items():
        assert guess[name] == pytest.approx(value, rel=0.05), name
    control = np.column_stack([record.channel(name) for name in model.controls])
    states = np.asarray(simulate(model, TRUTH, control, record.step, np.array([0.0] * 3 + [1.0] + [0.0] * 3)))
    turns, names = tumble()[2], list(model.states)
    simulated = Rotation.from_quat(states[:, [names.index(name) for name in ("q_x", "q_y", "q_z", "q_w")]])
    assert (turns.inv() * simulated).magnitude().max() < 0.01


def test_angles_beyond_half_a_turn_are_only_refused_where_a_sensor_reads_them(folder, tmp_path):
    text = CAMPAIGN.replace("attitude = { noise", "psi = { noise").replace(
        "moves =", 'attitude = "quaternion"\nmoves ='
    )
    (tmp_path / "campaign.toml").write_text(text.replace('initial = "estimated"', 'initial = "measured"'))
    (tmp_path / "log.csv").write_text((folder / "log.csv").read_text())
    campaign = load_campaign(tmp_path)
    with pytest.raises(InputError, match=r"(?s)psi.*sensors.attitude"):
        build_posterior(campaign, campaign.full, get_trials(campaign).fit)


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("moves =", 'attitude = "euler"\nmoves =', ("vehicle.attitude", "sensors.attitude")),
        ('attitude = { noise = "0.01 rad" }', 'attitude = { noise = "0.01 rad", lag = true }', ("lag",)),
    ],
)
def test_attitude_sensor_refuses_euler_angles_and_a_lag(tmp_path, old, new, parts):
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace(old, new, 1))
    with pytest.raises(InputError) as refused:
        load_campaign(tmp_path)
    for part in parts:
        assert part in str(refused.value)
