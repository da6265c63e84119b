"""A Doppler log that is turned, off the origin, of a wrong scale and late, on a simulated ROV: what is found, and what cannot be."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.check import check_records
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.inference.quick_estimates import posterior_modes
from seatrial.core.errors import InputError
from seatrial.estimation.diagnostics.identifiability import identify
from seatrial.estimation.posterior.information import likelihood_information
from seatrial.estimation.simulation.mounts import Mount
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.estimation.simulation.simulator import Simulator, samples_remembered
from seatrial.messages.identifiability import identifiability_cautions
from tests.campaigns import write_campaign

MASS, I_Z = 20.0, 1.5
TRUTH = {"X_uabsu": -18.0, "Y_vabsv": -30.0, "N_r": -2.0}
WRONG = {"yaw_dvl": np.radians(5.0), "x_dvl": 0.3, "scale_dvl": 1.02, "delay_dvl": 0.2}
PRIORS = {
    "yaw_dvl": 'distribution = "normal"\nmean = 0.0\nsd = 0.2',
    "x_dvl": 'distribution = "normal"\nmean = 0.0\nsd = 0.5',
    "scale_dvl": 'distribution = "truncated-normal"\nmean = 1.0\nsd = 0.05\nlower = 0.5',
    "delay_dvl": 'distribution = "uniform"\nlower = 0.0\nupper = 0.6',
}
STEP, SAMPLES = 0.1, 600
CAMPAIGN = f"""
[campaign]
name = "misaligned"
seed = 1

[vehicle]
mass = "{MASS} kg"
inertia = ["1 kg m^2", "1 kg m^2", "{I_Z} kg m^2"]
moves = ["u", "v", "r"]
fixed = {{ X_tau_X = 1.0, Y_tau_Y = 1.0, N_tau_N = 1.0 }}
trim = {{ u = "0 m/s" }}

[structure]
always = ["X_uabsu", "Y_vabsv", "N_r"]

[prior.X_uabsu]
distribution = "uniform"
lower = -60.0
upper = 0.0

[prior.Y_vabsv]
distribution = "uniform"
lower = -90.0
upper = 0.0

[prior.N_r]
distribution = "uniform"
lower = -8.0
upper = 0.0

[sensors]
u = {{ noise = "0.01 m/s" }}
v = {{ noise = "0.01 m/s" }}
r = {{ noise = "0.005 rad/s" }}

[mounts.dvl]
channels = ["u", "v"]

[design]
control = "tau_X"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = {{ from = "5 N", to = "20 N", points = 2 }}
period = {{ from = "4 s", to = "8 s", points = 2 }}

[import]
fit = ["log"]

[[import.files]]
path = "{{run}}.csv"
time = {{ column = "t", unit = "s" }}
channels.tau_X = {{ column = "tau_X", unit = "N" }}
channels.tau_Y = {{ column = "tau_Y", unit = "N" }}
channels.tau_N = {{ column = "tau_N", unit = "N*m" }}
channels.u = {{ column = "u", unit = "m/s" }}
channels.v = {{ column = "v", unit = "m/s" }}
channels.r = {{ column = "r", unit = "rad/s" }}
"""


def motion(parts=20):
    """Forces and the motion at a finer step: Newton's equations in the plane, midpoint rule."""
    rng = np.random.default_rng(2)
    tau = np.repeat(rng.uniform(-1.0, 1.0, (SAMPLES // 20, 3)), 20, axis=0) * [25.0, 25.0, 2.0]
    h, state, found = STEP / parts, np.zeros(3), []

    def change(state, force):
        u, v, r = state
        return np.array(
            [
                (force[0] + TRUTH["X_uabsu"] * u * abs(u)) / MASS + v * r,
                (force[1] + TRUTH["Y_vabsv"] * v * abs(v)) / MASS - u * r,
                (force[2] + TRUTH["N_r"] * r) / I_Z,
            ]
        )

    for force in tau:
        for _ in range(parts):
            found.append(state)
            state = state + h * change(state + 0.5 * h * change(state, force), force)
    return tau, np.array(found), h


def write_log(folder, wrong):
    """Write what a log turned by yaw, at x, of a scale and late shows: its speed is that of its place in its own axes."""
    tau, states, h = motion()
    late = round(wrong.get("delay_dvl", 0.0) / h)
    rows = np.arange(SAMPLES) * round(STEP / h)
    u, v, r = states[np.maximum(rows - late, 0)].T
    yaw, x, scale = (wrong.get(name, usual) for name, usual in (("yaw_dvl", 0.0), ("x_dvl", 0.0), ("scale_dvl", 1.0)))
    there = np.stack([u, v + x * r])
    shown = scale * np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) @ there
    rng = np.random.default_rng(3)
    noisy = [*(shown + 0.01 * rng.normal(size=shown.shape)), states[rows, 2] + 0.005 * rng.normal(size=SAMPLES)]
    table = np.column_stack([STEP * np.arange(SAMPLES), tau, *noisy])
    folder.mkdir(parents=True, exist_ok=True)
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,tau_X,tau_Y,tau_N,u,v,r", comments="", fmt="%.9g")


def fitted(folder, wrong, sought, *changes, more=""):
    """Return mean and standard deviation of everything, by name, at the mode."""
    write_log(folder, wrong)
    write_campaign(
        folder, CAMPAIGN + more + "".join(f"\n[prior.{name}]\n{PRIORS[name]}\n" for name in sought), *changes
    )
    campaign = load_campaign(folder)
    (answer,) = posterior_modes(campaign, get_trials(campaign))
    assert answer.rows, answer.alarm
    return {name: pair for name, _, (pair,) in answer.rows}


@pytest.mark.proof
def test_all_errors_are_found_together_where_a_gyro_and_known_forces_tell_them_apart(tmp_path):
    found = fitted(tmp_path, WRONG, list(WRONG))
    for one, value in {**TRUTH, **WRONG}.items():
        mean, sd = found[one]
        assert abs(mean - value) < 3.3 * sd, (one, mean, sd, value)


def axes_of(folder, columns=None, turned=0.0):
    """Return what `check` says of the axes of the log, some of its columns swapped or reversed."""
    write_log(folder, {"yaw_dvl": np.radians(turned)})
    text = CAMPAIGN.replace('[mounts.dvl]\nchannels = ["u", "v"]\n', "")
    for channel, (column, scale) in (columns or {}).items():
        text = text.replace(
            f'channels.{channel} = {{ column = "{channel}", unit = "m/s" }}',
            f'channels.{channel} = {{ column = "{column}", unit = "m/s", scale = {scale} }}',
        )
    (folder / "campaign.toml").write_text(text)
    campaign = load_campaign(folder)
    (judged,) = check_records(campaign, get_trials(campaign))
    (found,) = [one for one in judged.findings if one.code == "axes-wrong"]
    return found


@pytest.mark.parametrize(
    ("columns", "turned", "level", "mirrored", "remedy"),
    [
        ({}, 4.0, "pass", None, ()),
        ({}, 90.0, "alarm", False, 90.0),
        ({}, -60.0, "alarm", False, -60.0),
        ({"u": ("v", 1.0), "v": ("u", 1.0)}, 0.0, "alarm", True, ("left-handed",)),
        ({"v": ("v", -1.0)}, 0.0, "alarm", True, ("left-handed",)),
    ],
)
def test_check_finds_a_turned_or_mirrored_log(tmp_path, columns, turned, level, mirrored, remedy):
    found = axes_of(tmp_path, columns, turned)
    assert found.level == level, found
    assert found.values.get("mirrored") == mirrored, found
    if isinstance(remedy, tuple):
        assert found.remedies == remedy
    else:  # by vehicles of the priors, whose motion is not that of this one
        ((part, angle),) = found.values["angles"]
        assert part == "yaw"
        assert abs((angle - remedy + 180.0) % 360.0 - 180.0) < 8.0


@pytest.mark.proof
def test_a_scale_and_the_gain_of_every_force_are_said_not_to_be_separable(tmp_path):
    """Speeds s times as large by forces of a gain s times as large, and drag s times less: no record of u and v tells s."""
    write_log(tmp_path, {"scale_dvl": 1.02})
    gains = "".join(
        f'\n[prior.{name}]\ndistribution = "normal"\nmean = 1.0\nsd = 0.3\n' for name in ("X_tau_X", "Y_tau_Y")
    )
    text = CAMPAIGN + gains + f"\n[prior.scale_dvl]\n{PRIORS['scale_dvl']}\n"
    text = text.replace('"N_r"]', '"N_r", "X_tau_X", "Y_tau_Y"]')
    text = text.replace("X_tau_X = 1.0, Y_tau_Y = 1.0, ", "")
    (tmp_path / "campaign.toml").write_text(text)
    campaign = load_campaign(tmp_path)
    posterior = build_posterior(campaign, campaign.full, get_trials(campaign).fit)
    true = {**TRUTH, "X_tau_X": 1.0, "Y_tau_Y": 1.0, "scale_dvl": 1.02}
    true |= {f"sigma_{channel}": sd for channel, sd in campaign.noise.items()}
    values = np.array([true[name] for name in posterior.names])
    information = likelihood_information(posterior, values)
    prior = np.diag([parameter.prior.sd**-2.0 for parameter in posterior.parameters])
    found = identify(posterior.parameters, values, information, cov=np.linalg.inv(information + prior))
    said = " ".join(identifiability_cautions(found))
    assert all(name in said for name in ("scale_dvl", "X_tau_X", "X_uabsu")), said
    sd = dict(zip(found.names, found.sd, strict=True))
    assert sd["scale_dvl"] > 0.8 * 0.05  # as little known as before
    assert sd["N_r"] < 0.1


def test_a_late_sensor_shows_the_past_on_a_straight_line():
    from seatrial.vehicles.catalogue import load_vehicle

    model = load_vehicle("remus100_surge").build()
    values = dict(load_vehicle("remus100_surge").coefficients)
    n, step = 60, np.full(60, 0.1)
    control = (np.where(np.arange(n) < 20, 125.0, 150.0),)
    start = np.array([1.5])
    late = Sensor("u", mount=Mount("dvl", late=0.23))
    plain, shown = (
        np.asarray(
            Simulator(model, (one,), late=samples_remembered((one,), 0.1)).outputs(values, start, control, step)
        )[:, 0]
        for one in (Sensor("u"), late)
    )
    time = 0.1 * np.arange(n)
    np.testing.assert_allclose(shown, np.interp(time - 0.23, time, plain), rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('channels = ["u", "v"]', 'channels = ["u", "v"]\ndelay = "2 s"', r"mounts\.dvl\.delay"),
        ('channels = ["u", "v"]', 'channels = ["u", "v"]\ndelay = "-0.1 s"', r"mounts\.dvl\.delay"),
        ("[design]", '[prior.delay_dvl]\ndistribution = "uniform"\nlower = 0.0\nupper = 3.0\n\n[design]', "beyond 1 s"),
        ("[design]", '[prior.delay_dvl]\ndistribution = "normal"\nmean = 0.0\nsd = 0.1\n\n[design]', "delay_dvl"),
    ],
)
def test_impossible_sensor_delay_is_refused(tmp_path, old, new, message):
    write_log(tmp_path, {})
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        load_campaign(tmp_path)
