"""Closed-loop campaigns on vehicles drawn from the priors: coverage, what moving several set-points together saves, and time of safety.

python benchmarks/closed_loop.py coverage remus --vehicles 200
python benchmarks/closed_loop.py coverage rov --vehicles 200
python benchmarks/closed_loop.py together rov
python benchmarks/closed_loop.py together remus
python benchmarks/closed_loop.py rehearsed rov --vehicles 200
python benchmarks/closed_loop.py safety
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from scipy.stats import binom, norm

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import check_text
from seatrial.campaign.design.problem import plan_of, prior_draws
from seatrial.campaign.rehearsal.run import known_after, rehearse
from seatrial.campaign.rehearsal.vehicles import draw_vehicle, run_trial
from seatrial.compiled.random_keys import random_key
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.robust import information_table
from seatrial.design.safety import judge_safety
from seatrial.design.sweep import all_controls
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.family import design_words
from seatrial.vehicles.linearise import linearise

FOLDER = Path(__file__).parents[1] / "outputs" / "closed_loop"
"""Campaigns whose rehearsals are kept."""
LEVEL, BAND = 0.90, 0.99
"""Of the intervals, and probability with which a right answer is inside its band."""
DESIGN = """
[design]
control = "{control}"
{more}
families = ["repeated-doublet", "multisine"]
utility = "fisher-d"
duration = "{duration:g} s"
active = "{active:g} s"
sample_time = "0.1 s"
amplitude = {{ from = {least}, to = {most}, points = 3 }}
period = {{ from = "8 s", to = "20 s", points = 3 }}
[goal]
sd = {{ {wanted} }}
trials = 2
"""
PITCH_SENSORS = """[sensors]
w = { noise = "0.02 m/s" }
q = { noise = "0.004 rad/s" }
theta = { noise = "0.5 deg" }"""
PITCH_LOOP = """[autopilot.theta]
drives = { delta_s = -1 }
kp = "1 rad/rad"
kd = "2 rad s/rad"
derivative = "q"
limit = "13 deg"
[limits.delta_s]
lower = "-13.6 deg"
upper = "13.6 deg"
[prior.process_w]
distribution = "log-uniform"
lower = 0.003
upper = 0.03
[prior.process_q]
distribution = "log-uniform"
lower = 0.003
upper = 0.03
[prior.process_theta]
distribution = "log-uniform"
lower = 0.0001
upper = 0.001
[prior.process_phi]
distribution = "log-uniform"
lower = 0.0001
upper = 0.001
[limits.delta_r]"""
REMUS = """
[campaign]
name = "REMUS 100, unstable in yaw, under its autopilot"
seed = 1
[vehicle]
catalogue = "remus100_hall_anstee"
moves = ["v", "r"]
measured_inputs = ["u"]
published_prior_sd = "20 %"
trim = { u = "1.5 m/s" }
[structure]
always = ["Y_uv", "Y_uudelta_r", "N_uv", "N_ur", "N_uudelta_r"]
[prior]
process_v = { distribution = "log-uniform", lower = 0.003, upper = 0.03 }
process_r = { distribution = "log-uniform", lower = 0.003, upper = 0.03 }
process_psi = { distribution = "log-uniform", lower = 0.0001, upper = 0.001 }
[sensors]
v = { noise = "0.02 m/s" }
r = { noise = "0.004 rad/s" }
psi = { noise = "0.5 deg" }
[autopilot.psi]
drives = { delta_r = -1 }
kp = "1 rad/rad"
kd = "3 rad s/rad"
derivative = "r"
limit = "13 deg"
[limits.delta_r]
lower = "-13.6 deg"
upper = "13.6 deg"
[estimation]
initial = "measured"
likelihood = "filter-error"
inertia_error = "exact"
scale_error = "exact"
"""
ROV = """
[campaign]
name = "BlueROV2 under depth and heading hold"
seed = 1
[vehicle]
catalogue = "bluerov2_heavy"
moves = ["w", "r"]
positions = ["z"]
published_prior_sd = "40 %"
trim = { f_5 = "0.3 N", f_6 = "0.3 N", f_7 = "0.3 N", f_8 = "0.3 N", z = "5 m" }
[structure]
always = ["Z_w", "Z_wabsw", "N_r", "N_rabsr"]
[prior.N_r]
distribution = "normal"
mean = -1.0
sd = 0.3
[sensors]
z = { noise = "0.01 m" }
psi = { noise = "1 deg" }
r = { noise = "0.5 deg/s" }
[autopilot.psi]
drives = { f_1 = -1, f_2 = 1, f_3 = 1, f_4 = -1 }
kp = "6 N/rad"
ki = "0.5 N/(rad s)"
kd = "3 N s/rad"
derivative = "r"
limit = "15 N"
[autopilot.z]
drives = { f_5 = -1, f_6 = -1, f_7 = -1, f_8 = -1 }
kp = "15 N/m"
ki = "1 N/(m s)"
kd = "6 N s/m"
interval = "0.2 s"
limit = "20 N"
[limits.z]
lower = "3 m"
upper = "7 m"
[estimation]
inertia_error = "exact"
scale_error = "exact"
"""
VEHICLES = {
    "remus": (REMUS, {"duration": 50.0, "active": 42.0, "more": "", "wanted": 'Y_uv = "0.1 %"'}),
    "rov": (
        ROV,
        {
            "duration": 40.0,
            "active": 34.0,
            "more": 'together = { z_set = "0.8 m" }',
            "wanted": 'Z_w = "0.001 %"',
        },
    ),
}


def campaign_of(folder, name, changes=(), control="psi_set", more=None, most='"40 deg"'):
    text, settings = VEHICLES[name]
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    more = settings["more"] if more is None else more
    least = most.replace(most.split()[0], f'"{float(most.split()[0][1:]) / 2.5:g}')
    design = DESIGN.format(**{**settings, "more": more}, control=control, least=least, most=most)
    path = Path(folder) / f"{name}_{control}_{len(more)}"
    path.mkdir(exist_ok=True)
    (path / "campaign.toml").write_text(text + design)
    return check_text(path, text + design)


def coverage(name, vehicles):
    """Return how many true coefficients lie inside intervals of each strategy after its trials; an interrupted count goes on."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    campaign = campaign_of(FOLDER, name)
    data = rehearse(campaign, vehicles).data
    truth, estimate, sd = (data[one].values for one in ("truth", "estimate", "sd"))
    names, half, found = list(data["coefficient"].values), norm.ppf((1 + LEVEL) / 2), {}
    for at, strategy in enumerate(data["strategy"].values):
        inside = (np.abs(estimate[:, at, -1] - truth) <= half * sd[:, at, -1]).sum(0)
        share = np.mean(sd[:, at, -1] / np.abs(truth), axis=0)
        found[str(strategy)] = {one: [int(inside[i]), round(float(share[i]), 5)] for i, one in enumerate(names)}
    low, high = binom.ppf([(1 - BAND) / 2, (1 + BAND) / 2], vehicles, LEVEL)
    unstable = round(float(open_loop_unstable(campaign, truth)), 3) if name == "remus" else 0.0
    return {"vehicles": vehicles, "right": [int(low), int(high)], "unstable": unstable, "inside and sd": found}


def print_coverage(name, vehicles):
    start, found = time.process_time(), coverage(name, vehicles)
    low, high = found["right"]
    print(f"unstable without the autopilot: {found['unstable']:.0%} of the vehicles")
    print(f"{vehicles} vehicles; right intervals hold the truth in {low} to {high} of them ({BAND:.0%})")
    for strategy, coefficients in found["inside and sd"].items():
        for coefficient, (count, share) in coefficients.items():
            verdict = "inside" if low <= count <= high else "OUTSIDE"
            print(f"{strategy:9s} {coefficient:12s} {count:3d} of {vehicles} {verdict}; sd {share:.1%}")
    print(f"{time.process_time() - start:.0f} processor seconds")


def open_loop_unstable(campaign, truth):
    model = campaign.model(campaign.full)
    names = [term.text for term in model.coefficients]
    controls = [value for _, value in campaign.control_trim(model)][: len(model.controls)]
    lost = []
    for values in truth:
        slopes, _ = linearise(model, dict(zip(names, values, strict=True)), campaign.state_trim(model), controls)
        lost.append(np.linalg.eigvals(np.asarray(slopes)).real.max() > 1.0 / campaign.family.duration)
    return np.mean(lost)


BOTH_PLANES = (
    ('moves = ["v", "r"]', 'moves = ["v", "w", "q", "r"]'),
    ('"N_uudelta_r"]', '"N_uudelta_r", "Z_uw", "Z_uudelta_s", "M_uw", "M_uq", "M_uudelta_s"]'),
    ("[sensors]", PITCH_SENSORS),
    ("[limits.delta_r]", PITCH_LOOP),
)
"""What makes the REMUS of the steering plane one of both planes."""


class Compared(NamedTuple):
    """Trials that move both set-points of a vehicle, and trials that move one, of the same length.

    Attributes:
        campaign: of the trials that move both; those of one set-point differ in the schedule alone.
        plan: of any of them.
        draws: coefficients of vehicles drawn from the priors, SI, shape (S, k).
        controls: commands of a trial by what it moves, "both", "first" and "second", SI, shape (n, c).
    """

    campaign: Campaign
    plan: TrialPlan
    draws: np.ndarray
    controls: dict[str, np.ndarray]


def compared(folder, name, trials, vehicles=200, few=8):
    """Choose designs: of both set-points the largest Bayesian D gain, of one at a time the pair that takes least time to tell as much."""
    changes = BOTH_PLANES if name == "remus" else ()
    other, size = ("theta_set", '"12 deg"') if name == "remus" else ("z_set", '"0.8 m"')
    turn = '"40 deg"'
    moved = {
        "both": ("psi_set", f"together = {{ {other} = {size} }}", turn),
        "first": ("psi_set", "", turn),
        "second": (other, "", size),
    }
    words, controls, found = {}, {}, {}
    for kind, (control, more, most) in moved.items():
        campaign = campaign_of(folder, name, changes, control, more, most)
        model = campaign.model(campaign.full)
        plan, draws = plan_of(campaign, model), prior_draws(campaign, model)[:vehicles]
        words[kind], controls[kind] = all_designs(campaign, plan)
        found[kind] = information_table(plan, controls[kind], draws[:few])
    cov = np.cov(draws, rowvar=False)
    best = int(np.argmax(find_criterion("fisher-d", cov)(found["both"]).mean(1)))
    wanted = [sds(np.linalg.inv(cov) + trials * one) for one in found["both"][best]]

    def needed(pair):
        ones, twos = found["first"][pair[0]], found["second"][pair[1]]
        each = zip(ones, twos, wanted, strict=True)
        return np.median([trials_needed(np.linalg.inv(cov), one, two, 0.5, sd) for one, two, sd in each])

    first, second = min(np.ndindex(len(words["first"]), len(words["second"])), key=needed)
    chosen = {"both": best, "first": first, "second": second}
    for kind, at in chosen.items():
        print(f"{kind}: {words[kind][at]}", flush=True)
    campaign = campaign_of(folder, name, changes, *moved["both"])
    return Compared(campaign, plan, draws, {kind: controls[kind][at] for kind, at in chosen.items()})


def together(name, trials=2):
    """Time of trials of one set-point at a time that know every coefficient as well as trials that move both."""
    with tempfile.TemporaryDirectory() as folder:
        _, plan, draws, controls = compared(folder, name, trials)
        found = {kind: information_table(plan, one[None], draws)[0] for kind, one in controls.items()}
    prior = np.linalg.inv(np.cov(draws, rowvar=False))
    ratios = []
    for both, one, two in zip(found["both"], found["first"], found["second"], strict=True):
        wanted = sds(prior + trials * both)
        ratios.append(min(trials_needed(prior, one, two, share, wanted) for share in np.linspace(0.05, 0.95, 19)))
    ratios = np.array(ratios) / trials
    low, middle, high = np.quantile(ratios, [0.05, 0.5, 0.95])
    print(f"one at a time takes {middle:.2f} times as long ({low:.2f} to {high:.2f}, 90 % of {len(draws)} vehicles)")
    print(f"saved: {1 - 1 / middle:.0%} ({1 - 1 / low:.0%} to {1 - 1 / high:.0%})")
    mean = {kind: information.mean(0) * trials for kind, information in found.items()}
    for kind, information in {**mean, "one at a time": 0.5 * (mean["first"] + mean["second"])}.items():
        cov = np.linalg.inv(prior + information)
        correlation = np.abs(cov / np.outer(*2 * [np.sqrt(np.diag(cov))]) - np.eye(len(cov)))
        i, j = np.unravel_index(correlation.argmax(), correlation.shape)
        left = np.sqrt(np.diag(cov) / np.diag(np.linalg.inv(prior)))
        each = ", ".join(f"{name} {share:.1%}" for name, share in zip(plan.names, left, strict=True))
        print(f"{trials} trials, {kind}: of prior sds are left {each}; ", end="")
        print(f"strongest correlation {correlation[i, j]:.2f}, {plan.names[i]} with {plan.names[j]}")


def rehearsed(name, vehicles, trials=2):
    """Errors of coefficients and coverage of their intervals, estimated by mode from trials that vehicles of the priors run."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        campaign, plan, draws, controls = compared(folder, name, trials)
        both, *apart = controls.values()
        strategies = {
            f"{trials} trials of both": [both] * trials,
            f"{trials} trials, one at a time": apart * (trials // 2),
            f"{2 * trials} trials, one at a time": apart * trials,
        }
        key, errors, spreads = random_key(campaign.seed, "rehearsal"), [], []
        for index in range(vehicles):
            vehicle = draw_vehicle(campaign, plan, np.stack([both, *apart]), jax.random.fold_in(key, index))
            truth = np.array([vehicle.values[one] for one in plan.names])
            found = []
            for commands in strategies.values():
                records = [run_trial(campaign, vehicle, i + 1, control) for i, control in enumerate(commands)]
                found.append(known_after(campaign, records, 2 * trials))
            print(f"{index + 1} of {vehicles}", file=sys.stderr)
            errors.append([values - truth for values, _ in found])
            spreads.append([np.sqrt(np.diag(cov)) for _, cov in found])
    errors, spreads = np.array(errors), np.array(spreads)
    low, high = binom.ppf([(1 - BAND) / 2, (1 + BAND) / 2], vehicles, LEVEL)
    print(f"{vehicles} vehicles; right intervals hold the truth in {low:.0f} to {high:.0f} of them ({BAND:.0%})")
    inside = (np.abs(errors) <= norm.ppf((1 + LEVEL) / 2) * spreads).sum(0)
    rms, stated = (np.sqrt(np.mean(one**2, 0)) / draws.std(0) for one in (errors, spreads))
    for at, strategy in enumerate(strategies):
        for axis in dict.fromkeys(one[0] for one in plan.names):
            of = [i for i, one in enumerate(plan.names) if one[0] == axis]
            print(f"{strategy}, {axis}: ", end="")
            print(
                ", ".join(
                    f"{plan.names[i]} {rms[at, i]:.2%} ({stated[at, i]:.2%} stated; {inside[at, i]})" for i in of
                ),
                end="",
            )
            print(f"; together {np.sqrt(np.mean(rms[at, of] ** 2)):.2%} of a prior sd")
    print(f"{time.process_time() - start:.0f} processor seconds")


def all_designs(campaign, plan):
    """Return every design of the grid: its words and its commands."""
    words, controls, trim = [], [], campaign.control_trim(plan.model)
    for family in campaign.families:
        amplitude, period = (axis.ravel() for axis in np.meshgrid(*campaign.design.grid(), indexing="ij"))
        words += [design_words(family, *settings) for settings in zip(amplitude, period, strict=True)]
        controls.append(all_controls(family, trim, amplitude, period))
    return words, np.concatenate(controls)


def sds(precision):
    return np.sqrt(np.diag(np.linalg.inv(precision)))


def trials_needed(prior, one, two, share, wanted):
    """Trials, of which a share moves one set-point and the rest the other, after which no coefficient is known worse than wanted."""
    low, high = 0.0, 1e4
    for _ in range(50):
        middle = 0.5 * (low + high)
        enough = (sds(prior + middle * (share * one + (1 - share) * two)) <= wanted).all()
        low, high = (low, middle) if enough else (middle, high)
    return high


def safety(designs=400, vehicles=200):
    """Time the closed-loop check of many designs on many vehicles, when its program is there."""
    with tempfile.TemporaryDirectory() as folder:
        for name in VEHICLES:
            campaign = campaign_of(folder, name)
            model = campaign.model(campaign.full)
            plan, draws = plan_of(campaign, model), prior_draws(campaign, model)[:vehicles]
            size = np.sqrt(designs)
            grid = np.meshgrid(np.linspace(0.2, 0.7, int(size)), np.linspace(8.0, 20.0, int(size)))
            controls = all_controls(campaign.family, campaign.control_trim(model), *(x.ravel() for x in grid))
            limits = campaign.motion_limits or default_limits()
            judge_safety(plan, controls, draws, limits)
            begin, wall = time.process_time(), time.perf_counter()
            judge_safety(plan, controls, draws, limits)
            spent = time.process_time() - begin, time.perf_counter() - wall
            print(f"{name}: {len(controls)} designs x {vehicles} vehicles x {controls.shape[1]} samples: ", end="")
            print(f"{spent[0]:.1f} processor seconds, {spent[1]:.1f} s")


def default_limits():
    return (MotionLimit("psi", -1.5, 1.5),)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["coverage", "together", "rehearsed", "safety"])
    parser.add_argument("vehicle", nargs="?", choices=list(VEHICLES))
    parser.add_argument("--vehicles", type=int, default=40)
    asked = parser.parse_args()
    if asked.what == "safety":
        safety()
    elif asked.what == "together":
        together(asked.vehicle)
    elif asked.what == "rehearsed":
        rehearsed(asked.vehicle, asked.vehicles)
    else:
        print_coverage(asked.vehicle, asked.vehicles)


if __name__ == "__main__":
    main()
