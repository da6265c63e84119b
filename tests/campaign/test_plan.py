"""The plan of a campaign: its budgets, what it drops first, and whether the chance it promises is the share that meets the goals."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import binom

import seatrial as st
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.schema import Goal
from seatrial.campaign.design.plan import goal_of, plan_trials, stated_share
from seatrial.campaign.design.problem import plan_of, prior_draws
from seatrial.campaign.rehearsal.run import known_after
from seatrial.campaign.rehearsal.vehicles import Vehicle, run_trial
from seatrial.core.errors import InputError
from seatrial.estimation.diagnostics.error_budget import EXACT, error_budget
from seatrial.estimation.diagnostics.error_sources import StatedErrors
from seatrial.estimation.simulation.sensor_errors import noise_name
from seatrial.messages.designs import plan_lines
from tests.campaign.small import write_small
from tests.campaigns import joined, normal, priors

POSSIBLE = (
    ("lower = -3.6\nupper = 1.2", "lower = -2.4\nupper = -0.6"),
    ("lower = -8.8\nupper = 0.0", "lower = -4.5\nupper = -1.5"),
    ("lower = 2.0e-4\nupper = 12.0e-4", "lower = 5.0e-4\nupper = 8.0e-4"),
    ('always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]', 'always = ["X_u", "X_uabsu", "T_nabsn"]'),
)
"""Vehicles none of which runs away."""
TRUE = {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4}
POWER = '[power]\nhotel = "20 W"\npropulsion = "60 W"\nat = "1500 rpm"\n'
INPUTS = "[estimation]", '[estimation]\ninertia_error = "exact"\nscale_error = "exact"'
TRUTH = ("[truth]\nX_u = -1.21\nX_uabsu = -2.93\nT_nabsn = 6.28e-4\n", "")


def campaign(folder, goal="sd = { X_u = 0.1 }\ntrials = 20", plan="", *others):
    write_small(folder, *POSSIBLE, *others, INPUTS)
    file = folder / "campaign.toml"
    file.write_text(f"{file.read_text()}\n[goal]\n{goal}\n" + (f"[plan]\n{plan}\n" if plan else ""))
    return load_campaign(folder)


def test_it_needs_neither_truth_nor_records_and_writes_its_schedules(tmp_path):
    found = plan_trials(campaign(tmp_path, "sd = { X_u = 0.1 }\ntrials = 20", "", TRUTH))
    assert found.chance >= 0.85
    assert not found.ended_by
    assert found.joules is None
    assert found.seconds == 30.0 * len(found.steps)
    assert all(step.schedule.is_file() for step in found.steps)
    assert all(step.without <= found.chance for step in found.steps)


def test_time_battery_and_trials_each_end_it_and_it_says_what_would_do(tmp_path):
    free = plan_trials(campaign(tmp_path / "free"))
    count = len(free.steps)
    assert count >= 2
    by_time = plan_trials(campaign(tmp_path / "time", plan=f'time = "{(count - 1) * 90 + 1} s"\nturnaround = "1 min"'))
    assert len(by_time.steps) == count - 1
    assert by_time.further[:2] == (count, 90.0 * count)
    assert by_time.ended_by.startswith("the ")
    assert by_time.chance < free.chance
    powered = (f'battery = "{(count - 1) * 0.44} W h"\n' + POWER).replace("\n[power]", "\n\n[power]")
    by_battery = plan_trials(campaign(tmp_path / "battery", plan=powered))
    assert len(by_battery.steps) < count
    assert by_battery.joules <= (count - 1) * 0.44 * 3600
    # 20 W and the cube of the speed: at trim alone, 1194 of 1500 rpm, 60 W * 0.504; the excitation adds to the cube's mean
    assert by_battery.joules > len(by_battery.steps) * 30 * (20 + 60 * 0.796**3)
    by_trials = plan_trials(campaign(tmp_path / "trials", f"sd = {{ X_u = 0.1 }}\ntrials = {count - 1}"))
    assert len(by_trials.steps) == count - 1
    assert "[goal] trials" in by_trials.ended_by


def test_a_goal_out_of_reach_is_said_to_be(tmp_path):
    found = plan_trials(campaign(tmp_path, "sd = { X_u = 1e-4, T_nabsn = 1e-3 }\ntrials = 2"))
    assert found.chance == 0.0
    assert found.further is None
    assert "Change goals, sensors or designs" in "\n".join(plan_lines(found))
    assert found.goals == {"X_u": 0.0, "T_nabsn": 1.0}
    assert found.without_goal["X_u"] == 1.0


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ('battery = "100 W h"', r"plan.battery[^$]*without \[power\]"),
        ('time = "-1 h"', "plan.time"),
        ('turnaround = "-1 s"', "plan.turnaround"),
        ("chance = 1.5", "plan.chance"),
    ],
)
def test_what_no_day_allows_is_refused(tmp_path, plan, message):
    with pytest.raises(InputError, match=message):
        campaign(tmp_path, plan=plan)


def test_a_goal_is_for_the_noise_what_errors_of_stated_inputs_leave(tmp_path):
    """Those of a coefficient are what an estimate from hardly any noise has; a goal below them is refused."""
    asked = load_campaign(write_small(tmp_path, *POSSIBLE))
    model, random = asked.model(asked.full), np.random.default_rng(0)
    time = np.arange(0.0, 60.0, 0.1)
    n = 125.0 + np.repeat(random.choice([-30.0, 30.0], time.size // 50), 50)
    record = st.simulate(model, TRUE | {"sigma_u": 1e-3}, st.Schedule(time, {"n": n}), ["u"], start={"u": 1.5})
    wide = {name: st.Normal(value, abs(value)) for name, value in TRUE.items()}
    posterior = st.make_posterior(model, record, wide | {"sigma_u": st.LogUniform(1e-4, 0.1)}, ["u"], start={"u": 1.5})
    mode = st.find_mode(posterior, key=1)
    without, whole = (error_budget(posterior, mode, one) for one in (EXACT, StatedErrors(clock=0.0, force=0.0)))
    for name, value in TRUE.items():
        within = float(mode.sd[mode.names.index(name)])
        stated = np.sqrt(whole.sd(name, within) ** 2 - without.sd(name, within) ** 2)
        assert stated == pytest.approx(stated_share(asked, model, name) * abs(value), rel=0.05)
    shares = {"X_u": 0.13, "X_uabsu": 0.1}
    left = goal_of(replace(asked, goal=Goal(shares)))
    assert left.shares == pytest.approx({"X_u": 0.12, "X_uabsu": (0.01 - 0.0026) ** 0.5})
    with pytest.raises(InputError, match=r"5 %, but errors of stated inputs already make 5 %"):
        goal_of(replace(asked, goal=Goal({"X_u": 0.05})))


def test_without_a_goal_there_is_nothing_to_plan(tmp_path):
    with pytest.raises(InputError, match=r"goal.sd"):
        plan_trials(campaign(tmp_path, "trials = 3"))


@pytest.mark.proof
def test_the_promised_share_of_vehicles_meets_the_goals(tmp_path):
    """Fit every vehicle as the product does, after the planned trials and no others."""
    asked = campaign(tmp_path, 'sd = { X_u = "6 %", X_uabsu = "4 %" }\ntrials = 20', 'time = "190 s"')
    found, vehicles = plan_trials(asked), 120
    assert 0.3 < found.chance < 0.9  # so that the test can fail to both sides
    model, names = asked.model(asked.full), [term.text for term in asked.model(asked.full).coefficients]
    draws = np.asarray(prior_draws(replace(asked, seed=99), model))[:vehicles]
    controls = [np.loadtxt(step.schedule, delimiter=",", skiprows=1) for step in found.steps]
    time = asked.family.time()
    met = 0
    for number, values in enumerate(draws):
        known = dict(zip(names, values, strict=True)) | {noise_name("u"): asked.noise["u"]}
        vehicle = Vehicle(known, jax.random.fold_in(jax.random.key(7), number), 0)
        records = [
            run_trial(asked, vehicle, place, np.interp(time, rows[:, 0], rows[:, 1])[:, None] * 2 * np.pi / 60)
            for place, rows in enumerate(controls, 1)
        ]
        estimate, cov = known_after(asked, records, len(records))
        told = {name: (estimate[i], float(np.sqrt(cov[i, i]))) for i, name in enumerate(names)}
        met += not goal_of(asked).unmet(told)
    assert_inside(met, vehicles, found)


def assert_inside(met, vehicles, found):
    """The share lies in the 99.9 % range of the chance, widened by twice the chance's own error."""
    low, high = (
        binom.ppf(p, vehicles, np.clip(found.chance + 2 * s * found.chance_error, 0, 1))
        for p, s in ((0.0005, -1), (0.9995, 1))
    )
    assert low <= met <= high, (met / vehicles, found.chance)


WHOLE = joined(
    """[campaign]
name = "whole"
seed = 4

[vehicle]
catalogue = "remus100_hall_anstee"
published_prior_sd = "30 %"
trim = { u = "1.5 m/s", n = "1500 rpm", delta_r = "0 deg", delta_s = "0 deg" }

[structure]
always = ["X_uabsu", "T_nabsn", "Y_uv", "N_uv", "N_ur", "N_uudelta_r", "Z_uw", "M_uw", "M_uq", "M_uudelta_s"]
""",
    priors(N_ur=normal(-6.0, 2.0), M_uq=normal(-6.0, 2.0)),
    """[sensors]
u = { noise = "0.02 m/s" }
v = { noise = "0.02 m/s" }
w = { noise = "0.02 m/s" }
q = { noise = "0.004 rad/s" }
r = { noise = "0.004 rad/s" }
theta = { noise = "0.004 rad" }

[limits.n]
lower = "900 rpm"
upper = "1800 rpm"

[limits.delta_r]
lower = "-12 deg"
upper = "12 deg"

[limits.delta_s]
lower = "-8 deg"
upper = "8 deg"

[design]
control = "n"
utility = "fisher-d"
duration = "40 s"
active = "30 s"
sample_time = "0.2 s"
amplitude = { from = "100 rpm", to = "250 rpm", points = 2 }
period = { from = "6 s", to = "18 s", points = 2 }

[estimation]
inertia_error = "exact"
scale_error = "exact"

[goal]
sd = { X_uabsu = "3 %", N_uv = "6 %", N_ur = "6 %", M_uw = "6 %" }
trials = 12
""",
)


@pytest.mark.proof
def test_a_whole_vehicle_is_planned_in_stages_on_its_own_controls(tmp_path):
    (tmp_path / "campaign.toml").write_text(WHOLE)
    found = plan_trials(load_campaign(tmp_path))
    assert [stage.axes for stage in found.stages] == ["X", "NY", "ZM"]
    assert [stage.before for stage in found.stages] == [(), (0,), (0,)]
    assert [step.stage for step in found.steps] == sorted(step.stage for step in found.steps)
    assert "delta_r" in {step.control for step in found.steps if step.stage == 1}
    text = "\n".join(plan_lines(found))
    assert 'moves = ["v", "r"]; measured_inputs = ["u"]; priors_from = ["../stage_1"]' in text


@pytest.mark.proof
def test_the_promised_share_holds_for_stages_that_take_the_earlier_ones_as_known(tmp_path):
    """Fit stage after stage by least squares with priors, earlier coefficients fixed at their estimates."""
    (tmp_path / "campaign.toml").write_text(WHOLE.replace("trials = 12", "trials = 12\n[plan]\nchance = 0.6"))
    asked = load_campaign(tmp_path)
    found, vehicles, random = plan_trials(asked), 80, np.random.default_rng(11)
    assert 0.4 < found.chance < 0.9
    model = asked.model(asked.full)
    plan, priors = plan_of(asked, model), asked.coefficient_priors(model)
    mean, sd = np.array([one.mean for one in priors]), np.array([one.sd for one in priors])
    truths = np.asarray(prior_draws(replace(asked, seed=5), model))[:vehicles]
    slopes = jax.jit(jax.jacfwd(plan.outputs))
    trim = dict(asked.control_trim(model))
    held = [_controls(step.schedule, trim, plan.time) for step in found.steps]
    met = 0
    for truth in truths:
        shown = [np.asarray(plan.outputs(truth, one)) for one in held]
        shown = [one + random.standard_normal(one.shape) for one in shown]
        if not np.isfinite(shown).all():  # it diverges, and meets nothing
            continue
        known, told = truth.copy(), {}  # axes that a stage does not move, as its campaign has it, play no part in it
        for number, stage in enumerate(found.stages):
            free = [plan.names.index(name) for name in stage.sought]
            trials = [i for i, step in enumerate(found.steps) if step.stage == number]

            def values(x, known=known, free=free):
                full = known.copy()
                full[free] = mean[free] + sd[free] * x
                return full

            def residuals(x, values=values, trials=trials, shown=shown):
                return np.concatenate(
                    [x, *((np.asarray(plan.outputs(values(x), held[i])) - shown[i]).ravel() for i in trials)]
                )

            def jacobian(x, values=values, trials=trials, free=free):
                rows = [
                    np.asarray(slopes(values(x), held[i])).reshape(-1, len(mean))[:, free] * sd[free] for i in trials
                ]
                return np.concatenate([np.eye(len(free)), *rows])

            fit = least_squares(residuals, (truth[free] - mean[free]) / sd[free], jacobian, x_scale=1.0)
            spread = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac))) * sd[free]
            known = values(fit.x)
            told |= {name: (known[i], one) for name, i, one in zip(stage.sought, free, spread, strict=True)}
        met += not goal_of(asked).unmet(told)
    assert_inside(met, vehicles, found)


def _controls(path, trim, time):
    """Read a schedule, other controls at trim, SI."""
    factors = {"n_rpm": 2 * np.pi / 60, "delta_r_deg": np.pi / 180, "delta_s_deg": np.pi / 180}
    heads, rows = path.read_text().splitlines()[0].split(","), np.loadtxt(path, delimiter=",", skiprows=1)
    columns = {name: np.full(time.size, value) for name, value in trim.items()}
    for head, column in zip(heads[1:], rows.T[1:], strict=True):
        at = np.searchsorted(rows[:, 0], time + 1e-9, side="right") - 1
        columns[head.rpartition("_")[0]] = column[at] * factors[head]
    return np.column_stack(list(columns.values()))
