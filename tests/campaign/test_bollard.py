"""A vehicle tied to a force gauge: its thrust against least squares in closed form, and what the next campaign makes of it."""

from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.campaign.config.earlier_campaigns import lost_correlations
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.check import check_records
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.thruster_check import thruster_lines
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.inference.posterior import build_posterior, initial_state
from seatrial.campaign.prior.predictive import speeds
from seatrial.campaign.selection.runner_up import leading_channel, noise_of
from seatrial.cli.main import app
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError
from seatrial.estimation.posterior.mode import find_mode
from seatrial.manoeuvres.schedule import schedule_of
from seatrial.messages.render import remedy
from tests.campaign.small import write_summary
from tests.campaigns import MEASURED, import_log, joined, normal, priors, sensors, small_design, uniform, write_campaign

STEP, LAG = 0.1, 0.25
GAIN, ASTERN, PER_VOLT, OFFSET, DEAD = 0.85, -0.06, 0.09, 1.7, 1.2
VEHICLE = joined(
    """[campaign]
name = "bollard"
seed = 1

[vehicle]
mass = "20 kg"
moves = []
trim = { V = "16 V" }

[vehicle.thrust_laws.main]
polynomial = [0.0, 0.08]
neutral = 1500
lag = "0.25 s"

[[vehicle.thrusters]]
place = ["-0.3 m", "0.2 m", "0 m"]
direction = [1, 0, 0]

[[vehicle.thrusters]]
place = ["-0.3 m", "-0.2 m", "0 m"]
direction = [1, 0, 0]
""",
    priors(T_f=normal(1.0, 0.3)),
)
REST = joined(
    """[structure]
always = ["T_f", "T_absf", "T_fdV"]
""",
    priors(T_absf=normal(0.0, 0.2), T_fdV=normal(0.0, 0.2), bias_force_X=normal(0.0, 5.0)),
    """[sensors.force_X]
noise = "0.3 N"
bias = "shared"
""",
    MEASURED,
    """[design]
control = "f_1"
together = { f_2 = "20 N" }
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = { from = "10 N", to = "20 N", points = 2 }
period = { from = "2 s", to = "8 s", points = 2 }
""",
    import_log(
        "log",
        "{run}.csv",
        f_1=("left", "command"),
        f_2=("right", "command"),
        V=("battery", "V"),
        force_X=("gauge", "N"),
    ),
)


def late(command, lag=LAG):
    """A command that is held over each step, followed with a time constant; both columns at once."""
    actual = [command[0]]
    for held in command[:-1]:
        actual.append(held + (actual[-1] - held) * np.exp(-STEP / lag))
    return np.array(actual)


def pulls(n=600, seed=3):
    """Pulse widths of two thrusters that step together and apart, and a battery that sags and recovers."""
    rng = np.random.default_rng(seed)
    pwm = 1500.0 + np.repeat(np.round(rng.uniform(-250, 250, (n // 20, 2))), 20, axis=0)
    return pwm, 16.5 - 2.0 * np.arange(n) / n + 0.3 * np.sin(0.05 * np.arange(n))


def columns_of(command, volt):
    """What a newton of T_f, T_absf and T_fdV pulls, and the gauge's offset."""
    actual = late(0.08 * (command - 1500.0))
    return np.column_stack([actual.sum(1), np.abs(actual).sum(1), actual.sum(1) * (volt - 16.0), np.ones(len(command))])


def campaign(folder, rows, *changes, head="t,left,right,battery,gauge", text=VEHICLE + REST):
    write_campaign(folder, text, *changes, count=1)
    lines = (",".join(f"{x:.10g}" for x in (STEP * k, *row)) for k, row in enumerate(rows))
    (folder / "log.csv").write_text(f"{head}\n" + "\n".join(lines) + "\n")
    return load_campaign(folder)


def mode_of(found):
    posterior = build_posterior(found, found.full, get_trials(found).fit)
    mode = find_mode(posterior, key=random_key(1, "mode"))
    return posterior, mode, dict(zip(mode.names, zip(mode.values, mode.sd, strict=True), strict=True))


@pytest.fixture(scope="module")
def pull():
    command, volt = pulls()
    truth = [GAIN, ASTERN, PER_VOLT, OFFSET]
    noise = 0.3 * np.random.default_rng(4).normal(size=len(command))
    return command, volt, columns_of(command, volt) @ truth + noise


def test_the_mode_is_least_squares_on_the_known_shapes(tmp_path, pull):
    """With Gaussian priors and a known lag the coefficients are those of weighted least squares, at the noise of the mode."""
    command, volt, gauge = pull
    _, mode, at = mode_of(campaign(tmp_path, np.column_stack(pull)))
    design, sigma = columns_of(command, volt), at["sigma_force_X"][0]
    names = ["T_f", "T_absf", "T_fdV", "bias_force_X"]
    mean, sd = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.3, 0.2, 0.2, 5.0])
    precision = design.T @ design / sigma**2 + np.diag(sd**-2.0)
    expected = np.linalg.solve(precision, design.T @ gauge / sigma**2 + mean / sd**2)
    expected_sd = np.sqrt(np.diag(np.linalg.inv(precision)))
    for name, value, error in zip(names, expected, expected_sd, strict=True):
        assert at[name][0] == pytest.approx(value, abs=1e-4 * error), name
        assert at[name][1] == pytest.approx(error, rel=1e-3), name
    # What the next campaign takes without its correlations has small ones.
    kept = mode.cov[:3, :3] / np.sqrt(np.outer(*[np.diag(mode.cov)[:3]] * 2))
    assert np.abs(kept - np.eye(3)).max() < 0.35
    for name, value in zip(names, [GAIN, ASTERN, PER_VOLT, OFFSET], strict=True):
        assert abs(at[name][0] - value) < 4 * at[name][1], name
    assert sigma == pytest.approx(0.3, rel=4 / np.sqrt(2 * len(gauge)))


SOUGHT = """
[prior.lag_f]
distribution = "log-normal"
median = 0.2
factor = 2.0

[prior.dead_f]
distribution = "half-normal"
scale = 2.0
lower = 0.0
"""


def test_a_propeller_is_pulled_by_its_speed(tmp_path):
    """F = (1 - t) T n|n|, one propeller on the axis with a measured speed."""
    change = (
        (VEHICLE[VEHICLE.index("\ntrim = {") : VEHICLE.index("[prior.T_f]")], PROPELLER),
        ("[prior.T_f]\n", "[prior.T_nabsn]\n"),
        ("mean = 1.0\nsd = 0.3", "mean = 6.0e-4\nsd = 3.0e-4"),
        ('["T_f", "T_absf", "T_fdV"]', '["T_nabsn"]'),
        (REST[REST.index("[prior.T_absf]") : REST.index("[prior.bias")], ""),
        ('control = "f_1"\ntogether = { f_2 = "20 N" }', 'control = "n"'),
        ('"10 N", to = "20 N"', '"200 rpm", to = "600 rpm"'),
        ('channels.f_1 = { column = "left", unit = "command" }', 'channels.n = { column = "left", unit = "rpm" }'),
        ('channels.f_2 = { column = "right", unit = "command" }\nchannels.V = { column = "battery", unit = "V" }', ""),
    )
    command, volt = pulls()
    n = late(command) * np.pi / 30
    gauge = 0.9 * 6.28e-4 * n[:, 0] * np.abs(n[:, 0])
    rows = np.column_stack([command, volt, gauge + 0.3 * np.random.default_rng(6).normal(size=len(gauge))])
    _, _, at = mode_of(campaign(tmp_path, rows, *change))
    assert abs(at["T_nabsn"][0] - 6.28e-4) < 4 * at["T_nabsn"][1]
    assert at["T_nabsn"][1] < 1e-5


PROPELLER = """
thrust_deduction = 0.1

[vehicle.actuators.n]
lag = "0.25 s"

"""


@pytest.mark.proof
def test_a_vehicle_that_is_towed_shows_drag_and_the_loss_of_thrust_with_speed(tmp_path):
    """At a given velocity the gauge shows sum T_f f + T_uabsf u |f| + X_uabsu u|u|; least squares has the same numbers."""
    command, volt = pulls()
    u = 0.8 * np.repeat(np.random.default_rng(7).uniform(-1, 1, len(volt) // 30), 30)
    actual = late(0.08 * (command - 1500.0))
    shapes = np.column_stack([actual.sum(1), u * np.abs(actual).sum(1), u * np.abs(u), np.ones(len(u))])
    truth = np.array([GAIN, -0.2, -30.0, OFFSET])
    gauge = shapes @ truth + 0.3 * np.random.default_rng(8).normal(size=len(u))
    change = (
        ('trim = { V = "16 V" }', 'measured_inputs = ["u"]\ntrim = { u = "0 m/s" }'),
        ('["T_f", "T_absf", "T_fdV"]', '["T_f", "T_uabsf", "X_uabsu"]'),
        ("[prior.T_absf]", "[prior.T_uabsf]"),
        ("[prior.T_fdV]", "[prior.X_uabsu]"),
        ("mean = 0.0\nsd = 0.2\n\n[prior.bias", "mean = -20.0\nsd = 50.0\n\n[prior.bias"),
        ('channels.V = { column = "battery", unit = "V" }', 'channels.u = { column = "battery", unit = "m/s" }'),
    )
    _, _, at = mode_of(campaign(tmp_path, np.column_stack([command, u, gauge]), *change))
    solved = np.linalg.lstsq(shapes, gauge, rcond=None)[0]
    for name, value, exact in zip(("T_f", "T_uabsf", "X_uabsu"), solved, truth, strict=False):
        assert at[name][0] == pytest.approx(value, abs=0.1 * at[name][1]), name
        assert abs(at[name][0] - exact) < 4 * at[name][1], name


@pytest.mark.proof
def test_a_simulated_pull_is_that_of_plain_formulas(tmp_path):
    truth = {"T_f": GAIN, "T_absf": ASTERN, "T_fdV": PER_VOLT, "bias_force_X": OFFSET, "dead_f": DEAD}
    text = (VEHICLE + REST[: REST.index("[import]")]).replace('V = "16 V"', 'V = "16 V", f_2 = "0 N"')
    dead = SOUGHT[SOUGHT.index("[prior.dead_f]") :]
    lines = "\n".join(f"{name} = {value}" for name, value in truth.items())
    (tmp_path / "campaign.toml").write_text(f"{text}{dead}\n[truth]\n{lines}\n")
    (record,) = get_trials(load_campaign(tmp_path)).fit
    actual = late(np.column_stack([record.channel("f_1"), record.channel("f_2")]))
    beyond = np.sign(actual) * np.maximum(np.abs(actual) - DEAD, 0.0)
    left = record.channel("force_X") - (GAIN * beyond + ASTERN * np.abs(beyond)).sum(1) - OFFSET
    assert np.ptp(record.channel("force_X")) > 30
    assert left.std() == pytest.approx(0.3, rel=4 / np.sqrt(2 * left.size))
    assert abs(left.mean()) < 4 * 0.3 / np.sqrt(left.size)


def test_structures_are_compared_by_the_force_on_the_gauge(tmp_path, pull):
    """However large it is: forces do not run away; a dead zone counts."""
    command, *_ = pull
    found = campaign(tmp_path, np.column_stack(pull), ("[sensors", SOUGHT + "[sensors"))
    assert leading_channel(found.model(found.full), found.channels) == "force_X"
    model, (record,) = found.model(found.full), get_trials(found).fit
    control = np.column_stack([record.channel(name) for name in model.controls])
    gain, width = np.array([GAIN, 40.0]), np.array([0.0, DEAD])
    params = {"T_f": gain, "T_absf": 0 * gain, "T_fdV": 0 * gain, "dead_f": width, "lag_f": np.full(2, LAG)}
    start = np.array([initial_state(found, model, record)] * 2)
    step = np.append(np.diff(record.time), 0.0)
    force, lost = speeds(model, ["force_X"], params, None, start, control, step, range(record.time.size))
    actual = late(0.08 * (command - 1500.0))
    beyond = np.sign(actual) * np.maximum(np.abs(actual) - DEAD, 0.0)
    assert not lost.any()
    np.testing.assert_allclose(force[:, :, 0], [GAIN * actual.sum(1), 40.0 * beyond.sum(1)], atol=1e-9)


def test_a_gauge_whose_offset_differs_between_trials_has_one_noise(tmp_path, pull):
    found = campaign(tmp_path, np.column_stack(pull), ('bias = "shared"', 'bias = "own"'))
    draws = {"sigma_force_X": np.full((5, 1), 0.3), "bias_force_X[log]": np.full((5, 1), 1.7)}
    estimate = SimpleNamespace(draws=lambda names: draws[names[0]])
    sensor = next(one for one in found.sensor_models if one.channel == "force_X")
    assert noise_of(found, sensor, estimate) == pytest.approx(0.3)


# What the next campaign makes of it.

DRIVEN = joined(
    """[structure]
always = ["X_udot", "X_u", "X_uabsu", "T_f"]
""",
    priors(X_udot=normal(-6.0, 4.0), X_u=uniform(-60.0, 0.0), X_uabsu=uniform(-120.0, 0.0)),
    sensors(u="0.01 m/s"),
    MEASURED,
    small_design("f_1", "5 N", "10 N"),
    import_log("log", "{run}.csv", f_1=("left", "command"), f_2=("right", "command"), u=("u", "m/s")),
)
MOVES = ("moves = []", 'moves = ["u"]')
ALONE = (VEHICLE[VEHICLE.index("[prior.T_f]") :], "")


def sail(folder, command, *changes):
    """A campaign of the vehicle set free; nothing here looks into its log."""
    rows = np.column_stack([command, np.zeros(len(command))])
    return campaign(folder, rows, MOVES, *changes, head="t,left,right,u", text=VEHICLE + DRIVEN)


@pytest.mark.proof
def test_a_posterior_mode_is_enough_for_the_next_campaign(tmp_path, pull):
    """Until there is a finished run, which counts more."""
    command = pulls(seed=11)[0]
    known = ("moves =", 'priors_from = ["../bollard"]\nmoves =')
    bollard = campaign(tmp_path / "bollard", np.column_stack(pull))
    with pytest.raises(InputError) as refused:
        sail(tmp_path / "rov", command, ALONE, known)
    told = str(refused.value)
    assert "vehicle.priors_from" in told
    assert "without a finished run and without a posterior mode" in told
    there = tmp_path / "rov" / ".." / "bollard"
    assert f"`seatrial run {there}`, or `seatrial estimate {there} --by mode`" in told
    result = CliRunner().invoke(app, ["estimate", str(bollard.folder), "--by", "mode", "--quiet"])
    assert result.exit_code in (0, 3), result.output
    found = mode_of(bollard)[2]
    after = sail(tmp_path / "rov", command, ALONE, known)
    prior = after.prior("T_f")
    mean, sd = found["T_f"]
    assert prior.mean == pytest.approx(mean, rel=1e-6)
    assert sd < prior.sd < 1.1 * sd  # with the error of the model
    assert after.hull.fixed["T_fdV"] == pytest.approx(found["T_fdV"][0], rel=1e-6)
    assert "bias_force_X" not in after.priors
    assert lost_correlations(after) == []  # T_f alone is sought again
    write_summary(bollard.folder, bollard.full.terms, T_f=(0.8, 0.1), T_absf=(0.0, 0.1), T_fdV=(0.1, 0.1))
    assert load_campaign(after.folder).prior("T_f").mean == 0.8


@pytest.mark.proof
def test_correlations_that_are_not_taken_over_are_told(tmp_path, pull):
    """A fan of one direction: T_f and T_absf are known together, by the mode as by the finished run."""
    one_way = np.column_stack([np.abs(np.asarray(x) - 1500.0) + 1500.0 if x.ndim == 2 else x for x in pull[:2]])
    gauge = columns_of(one_way[:, :2], one_way[:, 2]) @ [GAIN, ASTERN, PER_VOLT, OFFSET]
    noise = 0.3 * np.random.default_rng(5).normal(size=len(gauge))
    bollard = campaign(tmp_path / "bollard", np.column_stack([one_way, gauge + noise]))
    result = CliRunner().invoke(app, ["estimate", str(bollard.folder), "--by", "mode", "--quiet"])
    assert result.exit_code in (0, 3), result.output
    mode = mode_of(bollard)[1]
    at = [mode.names.index(name) for name in ("T_f", "T_absf")]
    expected = mode.cov[at[0], at[1]] / np.sqrt(mode.cov[at[0], at[0]] * mode.cov[at[1], at[1]])
    assert abs(expected) > 0.9
    text = (VEHICLE + REST).replace("moves =", 'priors_from = ["../bollard"]\nmoves =', 1)
    for name in ("T_f", "T_absf", "T_fdV"):
        start = text.index(f"[prior.{name}]")
        text = text[:start] + text[text.index("\n\n" if name != "T_f" else "\n\n[structure]", start) + 2 :]
    again = campaign(tmp_path / "again", np.column_stack([one_way, gauge]), text=text)
    (said,) = [text for text in lost_correlations(again) if "T_f and T_absf" in text]
    assert float(said.split("correlation of ")[1].split(",")[0]) == pytest.approx(expected, abs=0.03)
    result = CliRunner().invoke(app, ["estimate", str(again.folder), "--by", "mode", "--quiet"])
    assert said in result.output
    pairs = (("T_f", "T_absf", -0.8), ("T_absf", "T_f", -0.8), ("T_fdV", "T_f", 0.6))
    found = {"T_f": (0.8, 0.1), "T_absf": (0.0, 0.1), "T_fdV": (0.1, 0.1)}
    write_summary(bollard.folder, bollard.full.terms, correlated=pairs, **found)
    (said,) = lost_correlations(load_campaign(again.folder))
    assert "priors_from ../bollard: T_absf and T_f were found with a correlation of -0.80" in said


# What is refused, and what a check tells.


def test_terms_about_another_voltage_are_refused(tmp_path, pull):
    bollard = campaign(tmp_path / "bollard", np.column_stack(pull))
    write_summary(bollard.folder, bollard.full.terms, T_f=(0.85, 0.01), T_absf=(0.0, 0.01), T_fdV=(0.09, 0.01))
    known = ("moves =", 'priors_from = ["../bollard"]\nmoves =')
    with pytest.raises(InputError, match="T_fdV about V = 16 V, and here a trim of 14 V"):
        sail(tmp_path / "rov", pulls()[0], known, ('V = "16 V"', 'V = "14 V"'))


REFUSED = {
    "a force that is not in the log": ([('channels.force_X = { column = "gauge", unit = "N" }', "")], ("force_X",)),
    "a force in metres": ([('"gauge", unit = "N"', '"gauge", unit = "m"')], ("force_X", "N")),
    "no voltage": ([('channels.V = { column = "battery", unit = "V" }', "")], ("no column for V",)),
    "no gain": ([('"T_f", ', "")], ("without T_f",)),
    "a gain that may be dropped": (
        [('"T_f", "T_absf", "T_fdV"]', '"T_absf"]\noptional = ["T_f", "T_fdV"]')],
        ("always",),
    ),
    "speed and force": ([('"T_f", ', '"T_f", "T_nabsn", ')], ("commanded force f",)),
}


@pytest.mark.parametrize("what", REFUSED)
def test_impossible_force_gauge_is_refused_by_key(tmp_path, pull, what):
    changes, parts = REFUSED[what]
    with pytest.raises(InputError) as refused:
        mode_of(campaign(tmp_path, np.column_stack(pull), *changes))
    for part in parts:
        assert part in str(refused.value), str(refused.value)


FAULTS = {
    "kgf": (lambda gauge: gauge / 9.80665, "size-unlike", "kilograms-force taken for newtons"),
    "tension": (lambda gauge: -gauge, "direction-reversed", "scale = -1"),
    "limit": (lambda gauge: np.clip(gauge, -14.0, 14.0), "gauge-at-limit", "leave these samples out"),
    "slack": (lambda gauge: np.maximum(gauge, 0.0), "gauge-at-limit", "leave these samples out"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_check_tells_what_is_wrong_with_a_gauge(tmp_path, pull, fault):
    change, check, told = FAULTS[fault]
    command, volt, gauge = pull
    found = campaign(tmp_path, np.column_stack([command, volt, change(gauge)]))
    (judged,) = check_records(found, get_trials(found))
    (wrong,) = [one for one in judged.findings if one.level in ("caution", "alarm") and one.subject == ("force_X",)]
    assert wrong.code == check
    assert told in remedy(wrong)


def test_check_passes_a_sound_record(tmp_path, pull):
    found = campaign(tmp_path, np.column_stack(pull))
    (judged,) = check_records(found, get_trials(found))
    assert judged.level == "pass", judged.lines()
    assert any(
        "rank 1 on the 1 axes that are measured, X" in line for line in thruster_lines(found.vehicle, found.channels)
    )


@pytest.mark.proof
def test_a_pull_is_designed(tmp_path):
    """Every design is weighed, by the entropy of a linear model: half the log det of what a pull tells of T_f and T_absf."""
    text = (VEHICLE + REST[: REST.index("[import]")]).replace('V = "16 V"', 'V = "16 V", f_2 = "0 N"')
    (tmp_path / "campaign.toml").write_text(text)
    found = load_campaign(tmp_path)
    best = design_first(found).best
    prior = np.diag([0.3**2, 0.2**2])
    for (row, column), worth in np.ndenumerate(best.utility):
        pull = schedule_of(best.family.manoeuvre(best.amplitude[row], best.period[column]), STEP)
        actual = late(np.column_stack([pull.controls["f_1"], pull.controls["f_2"]]))
        shapes = np.column_stack([actual.sum(1), np.abs(actual).sum(1)])
        expected = 0.5 * np.linalg.slogdet(np.eye(2) + prior @ shapes.T @ shapes / 0.3**2)[1]
        assert worth == pytest.approx(expected, abs=1e-6), (row, column)
    assert best.amplitude[best.best[0]] == 20.0
