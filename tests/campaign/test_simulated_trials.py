"""Trials of a simulated vehicle: any schedule can be run, and the truth goes through the sensors that are fitted."""

import json

import jax
import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.campaign.config.load import check_text, load_campaign
from seatrial.campaign.config.truth import true_coefficients
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.simulate import (
    Chosen,
    Scheduled,
    add_trial,
    ask_for,
    later_trials,
    record_keys,
    run_trial,
)
from seatrial.campaign.data.true_vehicle import true_vehicle
from seatrial.campaign.design.schedule import write_schedule
from seatrial.campaign.design.searches import design_free_trial, design_relay_trial, plan_together, search_design
from seatrial.campaign.store.stored_result import Store
from seatrial.cli.main import app
from seatrial.core.errors import InputError
from seatrial.manoeuvres.relay import RelayFamily
from seatrial.manoeuvres.schedule import Schedule
from tests.campaign.small import write_small
from tests.campaign.test_other_axes import YAW
from tests.cases import MASS
from tests.estimation_cases import naive_speed

RPM = np.pi / 30
STEP, N = 0.1, 300
OWN = "time_s,n_rpm\n0,1194\n3,1194\n3,1400\n10,1400\n12,1000\n29.9,1000\n"
QUIET = ("[truth]", "[truth]\nsigma_u = 1e-12")


def campaign(folder, *changes):
    return load_campaign(write_small(folder, *changes))


def own(folder, text=OWN):
    path = folder / "mine.csv"
    path.write_text(text)
    return path


def labels(made):
    return [record.label for record in get_trials(made).fit]


def told(lines):
    return type(
        "Told", (), {"say": lambda self, text: lines.append(text), "progress": lambda self, _: lambda *_: None}
    )()


def test_a_schedule_of_ones_own_is_run_and_kept(tmp_path):
    made, store = campaign(tmp_path), Store(tmp_path)
    ask_for(made, None, own(tmp_path))
    assert labels(made) == ["trial", "mine"]
    record = get_trials(made).fit[1]
    time = np.arange(N) * STEP
    wanted = np.interp(time, [0, 2.95, 2.95001, 10, 12, 30], [1194, 1194, 1400, 1400, 1000, 1000])
    np.testing.assert_allclose(record.channel("n") / RPM, wanted, rtol=1e-6)
    written = store.record("mine").stat().st_mtime_ns
    ask_for(made, None, own(tmp_path))
    assert labels(made) == ["trial", "mine"]
    assert store.record("mine").stat().st_mtime_ns == written
    ask_for(made, None, own(tmp_path, OWN.replace("1400", "1300")))
    assert labels(made) == ["trial", "mine"]
    assert get_trials(made).fit[1].channel("n").max() == pytest.approx(1300 * RPM)


def test_a_schedule_may_stand_alone_and_the_first_trial_come_back(tmp_path):
    made, lines = campaign(tmp_path), []
    add_trial(made, Chosen("repeated-doublet", 10.0, 8.0))
    ask_for(made, None, own(tmp_path), label="sea", alone=True, reporter=told(lines))
    assert labels(made) == ["sea"]
    assert any("2 trials so far are left out" in line for line in lines)
    add_trial(made, Chosen("repeated-doublet", 10.0, 8.0))
    assert list(record_keys(made)) == ["sea", "trial-2"]
    ask_for(made, "design", None)
    assert list(record_keys(made)) == ["trial", "sea", "trial-3"]
    ask_for(made, "design", None, alone=True)
    assert list(record_keys(made)) == ["trial"]


def test_a_schedule_stays_where_the_campaign_is_changed_and_is_run_again(tmp_path):
    made = campaign(tmp_path)
    ask_for(made, None, own(tmp_path), alone=True)
    add_trial(made, Chosen("repeated-doublet", 10.0, 8.0))
    (before,) = [key for label, key in record_keys(made).items() if label == "mine"]
    made = campaign(tmp_path, ("X_u = -1.21", "X_u = -1.3"))
    assert [type(one) for one in later_trials(made)] == [Scheduled]
    assert record_keys(made)["mine"] != before
    assert labels(made) == ["mine"]


def test_designs_are_run_from_their_schedules(tmp_path):
    made, store, lines = campaign(tmp_path), Store(tmp_path), []
    h = made.family.sample_time
    write_schedule(store.schedule(store.free_design), made.family.manoeuvre(15.0, 6.0), h, about={"design": "older"})
    for number in (1, 2):
        write_schedule(store.batch_schedule(number), made.family.manoeuvre(10.0 * number, 8.0), h)
    ask_for(made, "free_form", None, alone=True, reporter=told(lines))
    ask_for(made, "batch", None)
    assert labels(made) == ["free_form", "batch_1", "batch_2"]
    assert any("designed before the campaign was changed" in line for line in lines)
    wanted = made.family.manoeuvre(20.0, 8.0).sample(h)[1]
    np.testing.assert_allclose(get_trials(made).fit[2].channel("n"), wanted, rtol=1e-8)


@pytest.mark.parametrize(
    ("design", "schedule", "label", "alone", "place"),
    [
        ("free_form", None, None, False, "one of design"),
        ("desing", None, None, False, 'did you mean "design"'),
        ("design", "mine.csv", None, False, "found:    both"),
        (None, None, "sea", False, "neither, with --label"),
        (None, "mine.csv", "trial-2", False, "a name that seatrial gives its own trials"),
        (None, "mine.csv", "a/b", False, "no file can have"),
        (None, "none.csv", None, False, "no such file"),
    ],
)
def test_what_cannot_be_run_is_refused(tmp_path, design, schedule, label, alone, place):
    made, store = campaign(tmp_path), Store(tmp_path)
    own(tmp_path)
    write_schedule(store.schedule(store.design), made.family.manoeuvre(15.0, 6.0), 0.1)
    with pytest.raises(InputError, match=place):
        ask_for(made, design, None if schedule is None else tmp_path / schedule, label, alone)
    assert not store.sequence.exists()


def test_a_self_oscillation_switches_on_what_its_sensor_shows(tmp_path):
    """The hysteresis by a plain loop over the measured speed, which has noise, a bias, a delay of the control and gaps."""
    more = ("[truth]", "[truth]\nbias_u = 0.05\ndelay = 0.15\nlag_n = 0.3")
    made = campaign(tmp_path, more, ('noise = "0.05 m/s"', 'noise = "0.01 m/s"\nrate = "5 Hz"'))
    trim = made.control_trim(made.model(made.full))
    family = RelayFamily(trim, "n", "u", 1.6, duration=30.0, sample_time=STEP, start=1.0, active=20.0)
    relay = json.loads(json.dumps({"family": family.as_plain(), "amplitude": 20.0, "threshold": 0.1}))
    time = np.arange(N) * STEP
    asked = Scheduled("zigzag", "zigzag.csv", Schedule(time, {"n": np.full(N, trim[0][1])}), relay)
    add_trial(made, asked)
    record = get_trials(made).fit[1]
    side, command = 1.0, []
    for t, u in zip(time, record.channel("u"), strict=True):
        acts = 1.0 <= t + 1e-9 < 21.0
        if acts and np.isfinite(u):
            side = -1.0 if u - 1.6 >= 0.1 else 1.0 if u - 1.6 <= -0.1 else side
        command.append(trim[0][1] + 20.0 * side * acts)
    np.testing.assert_allclose(record.channel("n"), command)
    assert np.abs(np.diff(np.sign(np.array(command)[12:200] - trim[0][1]))).sum() >= 4


def shown(made, label="trial"):
    """One record under a control that jumps at random, and that control in revolutions a second."""
    rev = 20.0 + np.repeat(np.random.default_rng(5).uniform(-4, 4, N // 10), 10)
    asked = Scheduled(label, "mine.csv", Schedule(np.arange(N) * STEP, {"n": 2 * np.pi * rev}))
    return run_trial(made, asked, label, "key").channel("u"), rev


def speed(rev):
    """By the plain loop, with the mass and coefficients of the small campaign."""
    share = MASS / (30.48 + 0.93)
    terms = {"x_u": -1.21 * share, "x_uu": -2.93 * share, "thrust": 6.28e-4 * (2 * np.pi) ** 2 * share}
    return naive_speed(rev, np.full(N, STEP), **terms)


@pytest.mark.parametrize(
    ("truth", "late", "more"),
    [("bias_u = 0.1\ncurrent = -0.3", 0, -0.2), ("delay = 0.4", 4, 0.0), ("lag_n = 0.0", 0, 0.0)],
)
def test_the_truth_goes_through_the_sensors(tmp_path, truth, late, more):
    u, rev = shown(campaign(tmp_path, (QUIET[0], f"{QUIET[1]}\n{truth}")))
    expected = speed(np.concatenate([np.full(late, rev[0]), rev])[:N]) + more
    np.testing.assert_allclose(u, expected, atol=1e-9)


BODY = """
[campaign]
name = "late"
seed = 1
[vehicle]
mass = "30 kg"
trim = {{ u = "1.5 m/s", tau_X = "8 N" }}
moves = ["u"]
fixed = {{ X_udot = -1.0 }}
{stated}
[structure]
always = ["X_uabsu", "X_tau_X"]
optional = []
[prior]
X_uabsu = {{ distribution = "uniform", lower = -8.8, upper = 0.0 }}
X_tau_X = {{ distribution = "uniform", lower = 0.5, upper = 2.0 }}
[sensors.u]
noise = "1e-9 m/s"
[design]
control = "tau_X"
duration = "60 s"
active = "40 s"
sample_time = "0.1 s"
amplitude = {{ from = "1 N", to = "2 N", points = 2 }}
period = {{ from = "1 s", to = "20 s", points = 2 }}
[truth]
X_uabsu = -3.55
X_tau_X = 1.0
{truth}
"""


def test_the_true_lag_of_an_actuator_takes_the_place_of_the_stated_one(tmp_path):
    """Not one behind the other: as of a campaign that states none."""

    def late(stated, truth):
        made = check_text(tmp_path / "campaign.toml", BODY.format(stated=stated, truth=truth))
        time = np.arange(100) * 0.1
        schedule = Schedule(time, {"tau_X": np.where(time >= 1, 30.0, 8.0)})
        return true_vehicle(made).show(schedule, np.ones((100, 1), bool), [jax.random.key(0)])["u"]

    stated, alone = '[vehicle.actuators.tau_X]\nlag = "2 s"', late("", "lag_tau_X = 1.0")
    np.testing.assert_allclose(late(stated, "lag_tau_X = 1.0"), alone, atol=1e-7)
    np.testing.assert_allclose(late(stated, ""), late("", "lag_tau_X = 2.0"), atol=1e-7)
    assert np.abs(late(stated, "") - alone).max() > 0.1
    with pytest.raises(InputError, match=r"truth.lag_tau_X[^$]*because \[vehicle.actuators\] has a lag"):
        late(stated, "lag_tau_X = 0.0")


def test_a_true_lag_of_a_sensor_is_of_first_order(tmp_path):
    """Against Euler steps of a thousandth of the sample time along straight lines between samples."""
    u, rev = shown(campaign(tmp_path, (QUIET[0], f"{QUIET[1]}\nlag_u = 0.5")))
    true, found = speed(rev), []
    y = true[0]
    for k in range(N - 1):
        found.append(y)
        for share in (np.arange(1000) + 0.5) / 1000:
            y += 1e-3 * STEP / 0.5 * (true[k] + share * (true[k + 1] - true[k]) - y)
    np.testing.assert_allclose(u[:-1], found, atol=1e-5)


def test_true_noise_may_be_correlated_or_have_heavy_tails(tmp_path):
    """Within four standard errors: the correlation of neighbours, and the share of Cauchy's noise beyond its scale."""
    rev = shown(campaign(tmp_path / "w"))[1]
    coloured = shown(campaign(tmp_path / "c", ("[truth]", "[truth]\nsigma_u = 0.2\ntau_u = 0.5")))[0] - speed(rev)
    rho = np.exp(-STEP / 0.5)
    assert abs(np.corrcoef(coloured[:-1], coloured[1:])[0, 1] - rho) < 4 * np.sqrt((1 - rho**2) / N)
    heavy = shown(campaign(tmp_path / "h", ("[truth]", "[truth]\nsigma_u = 0.2\ndof_u = 1.0")))[0] - speed(rev)
    assert abs(np.mean(np.abs(heavy) > 0.2) - 0.5) < 4 * 0.5 / np.sqrt(N)
    share = shown(campaign(tmp_path / "p", ("[truth]", "[truth]\nsigma_u = 0.01\nshare_u = 0.1")))[0] / speed(rev) - 1.0
    assert abs(np.mean(np.abs(share) > 0.1) - 0.317) < 0.01 + 4 * np.sqrt(0.22 / N)
    both = "[truth]\nsigma_u = 0.1\ndrift_u = 0.2\ndrift_time_u = 0.5"
    drifting = shown(campaign(tmp_path / "d", ("[truth]", both)))[0] - speed(rev)
    assert abs(np.corrcoef(drifting[:-1], drifting[1:])[0, 1] - 0.8 * rho) < 4 * np.sqrt(
        (1 + rho**2) / (1 - rho**2) / N
    )


def test_a_true_vehicle_that_runs_away_is_told(tmp_path):
    with pytest.raises(InputError, match=r"key truth[^$]*a simulated vehicle that diverges"):
        shown(campaign(tmp_path, ("X_uabsu = -2.93", "X_uabsu = 200.0")))


def test_a_record_is_drawn_by_its_label(tmp_path):
    made = campaign(tmp_path)
    assert not np.array_equal(shown(made)[0], shown(made, "other")[0])


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("X_uabsu = -2.93\n", "", r"truth[^$]*no X_uabsu, which is in every structure"),
        ("[truth]", "[truth]\nbias_v = 0.1", 'truth.bias_v[^$]*"bias_v"'),
        ("[truth]", "[truth]\ndelay = -0.1", r"truth.delay[^$]*0 s or more"),
        ("[truth]", "[truth]\nlag_u = -0.1", r"truth.lag_u[^$]*0 s or more"),
        ("[truth]", "[truth]\nsigma_u = 0.0", r"truth.sigma_u[^$]*more than 0"),
        ("[truth]", "[truth]\ntau_u = 1.0\ndof_u = 3.0", r"truth.dof_u[^$]*tau_u as well"),
        ("[truth]", "[truth]\ndrift_u = 0.1", r"truth.drift_u[^$]*no drift_time_u"),
    ],
)
def test_impossible_truth_is_refused_by_key(tmp_path, old, new, match):
    with pytest.raises(InputError, match=match):
        campaign(tmp_path, (old, new))


def test_a_term_that_may_be_left_out_is_none_of_the_true_vehicle(tmp_path):
    made = campaign(tmp_path, ("X_u = -1.21\n", ""))
    assert true_coefficients(made, made.model(made.full)) == {"X_u": 0.0, "X_uabsu": -2.93, "T_nabsn": 6.28e-4}


def test_the_command_line_runs_a_schedule(tmp_path):
    made = campaign(tmp_path / "c")
    ask_for(made, None, own(tmp_path), label="before", alone=True)
    said = CliRunner().invoke(app, ["simulate", str(tmp_path / "c"), "--schedule", str(own(tmp_path)), "--quiet"])
    assert said.exit_code == 0, said.output
    assert "record before: 300 samples" in said.output
    assert "record mine: 300 samples" in said.output


@pytest.mark.parametrize("relay", [{}, {"family": {"trim": 3}}, {"family": {"gain": 1.0, "trim": []}}, 7])
def test_a_damaged_law_of_a_self_oscillation_is_told(tmp_path, relay):
    made, store = campaign(tmp_path), Store(tmp_path)
    path = store.schedule(store.relay_design)
    write_schedule(path, made.family.manoeuvre(15.0, 6.0), made.family.sample_time, about={"relay": relay})
    with pytest.raises(InputError, match=r"self_oscillation_schedule\.json"):
        ask_for(made, "self_oscillation", None)


@pytest.mark.proof
def test_every_design_is_run_as_it_was_found(tmp_path):
    made = campaign(tmp_path)
    free, _ = design_free_trial(made, 6)
    found, family, _ = search_design(made, 48)
    plan_together(made, 2)
    for name in ("free_form", "searched", "batch"):
        ask_for(made, name, None, alone=name == "free_form")
    records = {record.label: record for record in get_trials(made).fit}
    assert list(records) == ["free_form", "searched", "batch_1", "batch_2"]
    rpm = records["free_form"].channel("n")[10 + np.arange(6) * 200 // 6 + 10]
    np.testing.assert_allclose(rpm, free.levels, rtol=1e-8, atol=1e-9)
    wanted = family.manoeuvre(found.amplitude, found.period).sample(STEP)[1]
    np.testing.assert_allclose(records["searched"].channel("n"), wanted, rtol=1e-8)


@pytest.mark.proof
def test_a_designed_self_oscillation_closes_its_loop_on_the_true_vehicle(tmp_path):
    """Its control differs from the one that was foreseen, and turns round only where the measured rate allows it."""
    (tmp_path / "campaign.toml").write_text(YAW)
    made = load_campaign(tmp_path)
    test, _ = design_relay_trial(made)
    ask_for(made, "self_oscillation", None, alone=True)
    (record,) = get_trials(made).fit
    rudder, rate = record.channel("delta_r"), record.channel("r")
    at = np.flatnonzero(np.diff(np.sign(rudder[np.abs(rudder) > 0])))
    assert at.size >= 2
    assert np.abs(rudder).max() == pytest.approx(test.amplitude)
    assert np.nanmax(np.abs(rate)) > test.threshold
