"""Trials through an autopilot: what the file may say, what is simulated, designed, kept safe, imported and fitted in closed loop."""

import re
from dataclasses import replace

import numpy as np
import pytest
from jax.random import key

import seatrial as st
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import import_trials
from seatrial.campaign.data.rebuilt_controls import with_rebuilt_controls
from seatrial.campaign.data.simulate import Scheduled, run_trial
from seatrial.campaign.data.true_vehicle import true_vehicle
from seatrial.campaign.design.problem import design_problem, plan_of, prior_draws
from seatrial.campaign.design.searches import relay_search
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.inference.quick_estimates import posterior_modes
from seatrial.campaign.rehearsal.run import rehearse
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError
from seatrial.core.record import make_record
from seatrial.core.reporter import SILENT
from seatrial.design.free_form import FreeFormSearch
from seatrial.design.loop_stability import VEHICLES, GainChange, _advice, check_autopilot, loop_growth
from seatrial.design.measures import MeasureSearch
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.safety import judge_safety
from seatrial.estimation.posterior.simulated_record import _pushes, with_pushes
from seatrial.manoeuvres.schedule import Schedule
from tests.campaigns import write_campaign

DEG = np.pi / 180
REMUS = """
[campaign]
name = "unstable in yaw"
seed = 1
[vehicle]
catalogue = "remus100_hall_anstee"
moves = ["v", "r"]
measured_inputs = ["u"]
published_prior_sd = "20 %"
trim = { u = "1.5 m/s" }
[structure]
always = ["Y_uv", "N_uv", "N_uudelta_r"]
[sensors]
v = { noise = "0.02 m/s" }
r = { noise = "0.004 rad/s" }
psi = { noise = "0.5 deg", rate = "5 Hz" }
[autopilot.psi]
drives = { delta_r = -1 }
kp = "1 rad/rad"
ki = "0.1 rad/(rad s)"
kd = "3 rad s/rad"
derivative = "r"
limit = "13 deg"
rate = "30 deg/s"
interval = "0.2 s"
[limits.delta_r]
lower = "-13.6 deg"
upper = "13.6 deg"
[limits.psi]
lower = "-60 deg"
upper = "60 deg"
[estimation]
initial = "measured"
likelihood = "filter-error"
[prior]
process_v = { distribution = "log-uniform", lower = 0.003, upper = 0.03 }
process_r = { distribution = "log-uniform", lower = 0.003, upper = 0.03 }
process_psi = { distribution = "log-uniform", lower = 0.0001, upper = 0.001 }
[design]
control = "psi_set"
families = ["repeated-doublet"]
duration = "30 s"
active = "25 s"
sample_time = "0.1 s"
amplitude = { from = "20 deg", to = "40 deg", points = 2 }
period = { from = "8 s", to = "12 s", points = 2 }
"""
TRUTH = "[truth]\nY_uv = -28.6\nprocess_v = 0.01\nprocess_r = 0.01\n"


def campaign(folder, *changes, more=TRUTH):
    write_campaign(folder, REMUS + more, *changes)
    return load_campaign(folder)


def turns(time):
    return Schedule(time, {"psi_set": np.where(time % 16 < 8, 20 * DEG, -20 * DEG)})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[autopilot.psi]", "[autopilot.theta]", r"key autopilot.theta[^$]*no sensor measures[^$]*v, r, psi"),
        ('derivative = "r"', 'derivative = "q"', r"autopilot.psi.derivative[^$]*\[sensors.q\]"),
        ("delta_r = -1", "delta_s = 1", r"autopilot.psi.drives[^$]*delta_r"),
        ("delta_r = -1", "psi = 1", r'autopilot.psi.drives[^$]*"psi"[^$]*delta_r'),
        ('kp = "1 rad/rad"', 'kp = "1 rad/m"', "autopilot.psi.kp"),
        ('interval = "0.2 s"', 'interval = "0.25 s"', r"autopilot.psi.interval[^$]*whole multiple"),
        ('interval = "0.2 s"', 'interval = "0.01 s"', r"autopilot.psi.interval[^$]*whole multiple"),
        ('limit = "13 deg"', 'limit = "0 deg"', "autopilot.psi.limit[^$]*more than 0"),
        ('control = "psi_set"', 'control = "theta_set"', r"design.control[^$]*psi_set"),
        ('control = "psi_set"', 'control = "psi_set"\nper = "second"', r"design.per[^$]*autopilot"),
    ],
)
def test_what_cannot_be_is_told_by_its_key(tmp_path, old, new, said):
    with pytest.raises(InputError, match=said):
        campaign(tmp_path, (old, new))


def check(search):
    return lambda campaign: search.check(design_problem(campaign))


@pytest.mark.parametrize(
    ("old", "new", "checked", "said"),
    [
        ("", "", relay_search, r"key autopilot.psi[^$]*self-oscillating test[^$]*same actuators"),
        ("", "", check(MeasureSearch(5)), r"key prior.process_v[^$]*process noise, with a comparison"),
        ("", "", check(FreeFormSearch(4)), r"key limits.psi_set[^$]*because a free form uses the whole range"),
        (
            "[design]",
            '[design]\ntogether = { delta_r = "2 deg" }',
            check(FreeFormSearch(4)),
            r"key design.together[^$]*delta_r beside psi_set",
        ),
    ],
)
def test_designs_that_an_autopilot_does_not_allow(tmp_path, old, new, checked, said):
    with pytest.raises(InputError, match=said):
        checked(campaign(tmp_path, *([(old, new)] if old else [])))


def test_the_log_holds_what_the_autopilot_made_of_what_the_sensors_showed(tmp_path):
    """Taken from the log alone: its measurements, with their gaps, and its set-points give its rudder."""
    made = campaign(tmp_path)
    record = run_trial(made, Scheduled("one", "one.csv", turns(np.arange(300) * 0.1)), "one", "key")
    assert np.isnan(record.channel("psi")[1::2]).all()
    channels = tuple(channel for channel in record.channels if channel.name != "delta_r")
    columns = {channel.name: record.channel(channel.name) for channel in channels}
    bare = make_record(record.time, columns, channels, record.provenance, "bare")
    again = with_rebuilt_controls(made, bare)
    np.testing.assert_allclose(again.channel("delta_r"), record.channel("delta_r"), atol=1e-12)
    assert "exact if the autopilot used" in again.provenance.options["cautions"][-1]
    rudder = record.channel("delta_r")
    assert np.abs(rudder).max() <= 13 * DEG + 1e-12
    assert (np.diff(rudder)[1::2] != 0).any()
    assert (np.diff(rudder)[::2] == 0).all()
    assert np.abs(np.diff(rudder)).max() <= 30 * DEG * 0.2 + 1e-12
    assert record.channel("psi")[70] == pytest.approx(20 * DEG, abs=6 * DEG)
    alone = tuple(channel for channel in channels if channel.name != "psi_set")
    left = make_record(record.time, columns, alone, record.provenance, "left")
    with pytest.raises(InputError, match="neither the controls nor psi_set"):
        with_rebuilt_controls(made, left)


def test_without_the_autopilot_the_same_vehicle_runs_away(tmp_path):
    made = campaign(tmp_path)
    time = np.arange(300) * 0.1
    held = run_trial(made, Scheduled("one", "one.csv", Schedule(time, {"psi_set": 0.0 * time})), "one", "key")
    free = campaign(tmp_path, ("[autopilot.psi]", '[limits.r]\nupper = "9 rad/s"\n#'), *LOOSE)
    lost = run_trial(free, Scheduled("one", "one.csv", Schedule(time, {"delta_r": 0.0 * time})), "one", "key")
    assert np.nanmax(np.abs(held.channel("psi"))) < 10 * DEG
    assert np.nanmax(np.abs(lost.channel("psi"))) > 60 * DEG


LOOSE = (
    ('control = "psi_set"', 'control = "delta_r"'),
    ("drives = { delta_r = -1 }\n", ""),
    *(
        (f"{line}\n", "")
        for line in (
            'kp = "1 rad/rad"',
            'ki = "0.1 rad/(rad s)"',
            'kd = "3 rad s/rad"',
            'derivative = "r"',
            'limit = "13 deg"',
            'rate = "30 deg/s"',
            'interval = "0.2 s"',
        )
    ),
)


def test_process_noise_of_the_truth_has_the_size_that_is_stated(tmp_path):
    """A vehicle whose rate is noise alone: the increments of a random walk."""
    made = campaign(tmp_path, ("process_r = 0.01", "process_r = 0.02"))
    vehicle = true_vehicle(made)
    step = np.full(20_000, 0.1)
    pushes = _pushes(vehicle.simulator.model, vehicle.values, step, key(0))
    assert list(pushes) == ["process_v", "process_r"]
    model = with_pushes(vehicle.simulator.model, tuple(pushes))
    still = model.derivative(vehicle.values, (0.0, 0.0, 0.0), (1.5, 0.0, 0.0, 0.0))
    pushed = model.derivative(vehicle.values, (0.0, 0.0, 0.0), (1.5, 0.0, 0.3, 0.7))
    np.testing.assert_allclose(np.subtract(pushed, still), [0.3, 0.7, 0.0], atol=1e-12)
    sizes = [np.std(one * step) / np.sqrt(0.1) for one in pushes.values()]
    np.testing.assert_allclose(sizes, [0.01, 0.02], rtol=4 / np.sqrt(2 * 20_000))


def test_python_simulates_the_same_trial_under_the_autopilot(tmp_path):
    made = campaign(tmp_path)
    time = np.arange(200) * 0.1
    record = run_trial(made, Scheduled("a", "a.csv", turns(time)), "a", "key")
    vehicle = true_vehicle(made)
    model = vehicle.simulator.model
    same = st.simulate(
        model,
        {**vehicle.values, "process_psi": 0.0},
        Schedule(time, turns(time).columns(vehicle.trim)),
        vehicle.simulator.sensors,
        feedback=made.pilot(model.controls),
        start=vehicle.start,
        rates={"psi": 5.0},
        key=[random_key(made.seed, f"noise {channel} a") for channel in made.channels],
    )
    assert same.channels == record.channels
    for channel in record.channels:
        np.testing.assert_array_equal(same.channel(channel.name), record.channel(channel.name))
    with pytest.raises(InputError, match="feedback"):
        st.simulate(model, vehicle.values, turns(time), ["v"], feedback=made.pilot(model.controls), start=vehicle.start)


@pytest.mark.proof
def test_safety_is_that_of_each_closed_loop(tmp_path):
    """Room by the motions themselves, with sensors so good that their noise moves nothing."""
    made = campaign(tmp_path)
    model = made.model(made.full)
    plan = plan_of(made, model)
    sharp = replace(plan, weight=np.where(plan.weight > 0, 1e9, 0.0))
    draws = prior_draws(made, model)[:60]
    time = np.arange(300) * 0.1
    told = np.stack([turns(time).columns(made.control_trim(model))[name] for name in plan.commands], 1)
    limit = MotionLimit("psi", -25 * DEG, 25 * DEG)
    found = judge_safety(sharp, told[None], draws, [limit])
    for room, values in zip(found.room[0, :, 0], draws, strict=True):
        psi = np.asarray(sharp.motion(values, told))[:, model.states.index("psi")]
        assert room == pytest.approx(25 * DEG - np.abs(psi).max(), abs=1e-6)
    noisy = judge_safety(plan, told[None], draws, [limit])
    assert np.abs(noisy.room - found.room).max() > 1e-4


def test_an_autopilot_that_is_too_weak_is_refused_in_words_to_act_on(tmp_path):
    problem = design_problem(campaign(tmp_path, ('kd = "3 rad s/rad"', 'kd = "0.6 rad s/rad"')))
    with pytest.raises(
        InputError,
        match=r"% of the vehicles [^$]*yaw \(heading\)[^$]*double kd \(derivative gain\) of \[autopilot.psi\]",
    ) as refused:
        check_autopilot(problem, SILENT)
    trim = np.array([value for _, value in problem.trim_of(problem.family)])
    growth = loop_growth(problem.plan(), trim, problem.draws[:VEHICLES])
    (doubling,) = re.findall(r"a small motion there doubles in (\S+) s", str(refused.value))
    assert np.exp(float(doubling) * np.median(growth.rate[growth.unstable])) == pytest.approx(2, rel=0.05)


def test_an_autopilot_that_no_change_of_one_gain_mends_is_at_fault_and_not_the_priors():
    assert _advice(None, 1.0).startswith("the autopilot is unstable for all values of the priors")
    assert _advice(None, 1.0).endswith("no single gain, if reversed, halved or doubled, helps")
    assert "narrow the priors" not in _advice(GainChange("psi", ("kp",), 2.0, 0.95), 1.0)
    assert "narrow the priors" in _advice(None, 0.3)
    turned = _advice(GainChange("psi", ("kp", "kd"), -1.0, 0.02), 1.0)
    assert turned.startswith(
        "turn the sign of kp (proportional gain) and kd (derivative gain) of [autopilot.psi]: 2% remain"
    )


@pytest.mark.proof
def test_from_design_to_estimate_and_back_from_a_log_of_set_points(tmp_path):
    made = campaign(tmp_path)
    found = design_first(made)
    assert "psi_set" in found.lines()[0]
    assert found.safety
    design = found.best
    schedule = Schedule(design.family.time(), {"psi_set": design.best_controls()[:, -1]})
    record = run_trial(made, Scheduled("one", "one.csv", schedule), "one", "key")
    rows = np.column_stack([record.time, *(record.channel(name) for name in ("u", "psi_set", "v", "r", "psi"))])
    lines = [",".join("" if np.isnan(x) else f"{x:.12g}" for x in row) for row in rows]
    (tmp_path / "log.csv").write_text("\n".join(["t,u,psi_set,v,r,psi", *lines]) + "\n")
    channels = {"u": "m/s", "psi_set": "rad", "v": "m/s", "r": "rad/s", "psi": "rad"}
    mapped = "\n".join(f'channels.{name} = {{ column = "{name}", unit = "{unit}" }}' for name, unit in channels.items())
    imports = (
        f'[import]\nfit = ["1"]\n[[import.files]]\npath = "log.csv"\ntime = {{ column = "t", unit = "s" }}\n{mapped}\n'
    )
    sea = campaign(tmp_path, more=imports)
    (read,) = import_trials(sea).fit
    np.testing.assert_allclose(read.channel("delta_r"), record.channel("delta_r"), atol=1e-9)
    (answer,) = posterior_modes(sea, import_trials(sea))
    published = {"Y_uv": -28.6, "N_uv": -24.0, "N_uudelta_r": -6.15}
    for name, _, pairs in answer.rows:
        if name in published:
            value, sd = pairs[0]
            assert abs(value - published[name]) < 4 * sd, name
            assert sd < 0.15 * abs(published[name]), name


@pytest.mark.proof
def test_a_rehearsal_through_the_autopilot(tmp_path):
    goal = '[goal]\nsd = { Y_uv = "1 %" }\ntrials = 2\n'
    made = campaign(
        tmp_path, ("[estimation]", '[estimation]\ninertia_error = "exact"\nscale_error = "exact"'), more=goal
    )
    found = rehearse(made, 2)
    data = found.data
    assert (found.needed == 2).all()
    z = (data["estimate"].values[:, :, -1] - data["truth"].values[:, None]) / data["sd"].values[:, :, -1]
    assert np.abs(z).max() < 5
    assert (data["sd"].values[:, :, 1] < data["sd"].values[:, :, 0]).all()
