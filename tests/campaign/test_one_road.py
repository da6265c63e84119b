"""A campaign is the library with a folder: each step calls a public function, and Python alone gets the same bits without one."""

import dis
import functools
import inspect
from importlib import import_module
from types import CodeType
from typing import Any

import numpy as np
import pytest
from jax.random import fold_in

import seatrial as st
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.inference.profile import profile_all
from seatrial.campaign.inference.quick_estimates import posterior_modes
from seatrial.campaign.workflow.steps import STEPS, Workflow
from seatrial.compiled.random_keys import random_key
from seatrial.core.reporter import no_progress
from seatrial.estimation.diagnostics.error_budget import error_budget
from seatrial.estimation.diagnostics.error_sources import StatedErrors
from seatrial.estimation.posterior.noncentred import in_posterior, uncouple
from seatrial.estimation.posterior.sample_posterior import spread_starts
from seatrial.sampling import sampler
from seatrial.sampling.names import DEFAULT
from seatrial.sampling.sampler import SAMPLERS
from seatrial.selection.log_evidence import EvidenceTask, Keys, run_task
from seatrial.vehicles.catalogue import load_surge
from tests.campaign.small import NO_X_U, write_small

# What each step of a campaign calls of the library to get its numbers. A step that only reads others calls none.
ROADS = {
    "first": ["design_trial", "GridSearch"],
    "trials": ["simulate_trial", "join_logs"],
    "screening": ["make_posterior", "screen", "screen_about_mode"],
    "candidates": ["make_posterior", "screen", "screen_about_mode"],
    "estimates": ["make_posterior", "find_mode", "uncouple", "spread_starts", "error_budget", "diagnose"],
    "selection": ["make_posterior", "run_task", "select"],
    "chosen": [],
    "average": [],
    "full": [],
    "known": ["make_posterior", "identify"],
    "promised": ["identifiability_of_design"],
    "filter": ["run_filter"],
    "predictions": ["predict", "judge_fit", "judge_runs"],
    "baselines": ["fit_baselines"],
    "next": ["design_trial", "GridSearch"],
    "contenders": ["design_trial", "simulate"],
    "prior": ["simulate"],
    "design": ["design_trial", "GridSearch"],
    "own": ["design_trial", "OwnSearch"],
    "free_form": ["design_trial", "FreeFormSearch"],
    "relay": ["design_trial", "RelaySearch"],
    "searched": ["design_trial", "GlobalSearch"],
    "measures": ["design_trial", "MeasureSearch"],
    "batch": ["design_trial", "BatchSearch"],
    "plan": ["design_trial", "PlanSearch"],
    "sensors": ["design_trial", "SensorSearch"],
    "rehearsal": ["simulate_trial", "replicate", "find_mode"],
    "profiles": ["profile_likelihood"],
    "criteria": ["aic", "bic", "psis_loo", "waic"],
    "cross_validation": ["make_posterior", "find_mode", "leave_one_run_out"],
    "calibration": ["find_method", "replicate", "ranks_of"],
}
# Modules of campaigns that compute by JAX themselves, and what; all others leave that to the library.
PRIVATE = {
    "campaign.data.check": "nothing: it gives arrays to the checks of records",
    "campaign.data.rebuilt_controls": "the controls of an autopilot along a log, which nothing else asks for",
    "campaign.design.problem": "controls under an autopilot, of the library's `TrialPlan`",
    "campaign.inference.calibration": "replicates of a posterior with trials of their own",
    "campaign.inference.estimate": "curves of all priors at once, of the library's `prior_curve`",
    "campaign.prior.predictive": "gauges of an aquarium of vehicles drawn from the priors",
    "campaign.rehearsal.run": "information of a campaign's designs about a simulated vehicle",
    "campaign.rehearsal.vehicles": "which vehicles of the prior stay below a speed in every design",
    "campaign.selection.criteria": "nothing: it gives arrays to the criteria",
    "campaign.selection.runner_up": "designs that tell two structures apart",
}


def used_of(code: CodeType) -> tuple[set[str], list[tuple[str, str]]]:
    """Names that some code looks up, and what it imports from where; of the functions inside it too."""
    names, imported, module = set(code.co_names), [], ""
    for step in dis.get_instructions(code):
        module = step.argval if step.opname == "IMPORT_NAME" else module
        imported += [(module, step.argval)] if step.opname == "IMPORT_FROM" else []
    for inside in (one for one in code.co_consts if isinstance(one, CodeType)):
        more = used_of(inside)
        names, imported = names | more[0], imported + more[1]
    return names, imported


def functions_of(thing: object) -> list:
    """The functions that a function, a partial one or a class is made of."""
    while isinstance(thing, functools.partial):
        thing = thing.func
    thing = inspect.unwrap(thing) if callable(thing) else thing
    if inspect.isclass(thing):
        parts = (getattr(one, "fget", None) or getattr(one, "__func__", None) or one for one in vars(thing).values())
        return [one for one in parts if inspect.isfunction(one)]
    return [thing] if inspect.isfunction(thing) else []


def road_of(step: str) -> tuple[set[str], set[str]]:
    """Public functions of the library that a step may call, and the modules of campaigns on its way."""
    called, modules, seen, todo = set(), set(), set(), functions_of(STEPS[step].work.compute)
    while todo:
        function = todo.pop()
        if function in seen:
            continue
        seen.add(function)
        modules |= {function.__module__} if function.__module__.startswith("seatrial.campaign.") else set()
        names, imported = used_of(function.__code__)
        things = [function.__globals__.get(name) for name in names]
        things += [cell.cell_contents for cell in function.__closure__ or ()]
        things += [getattr(import_module(of), name) for of, name in imported if of.startswith("seatrial.")]
        for thing in things:
            home = getattr(thing, "__module__", None) or ""
            if home.startswith("seatrial.campaign."):
                todo += functions_of(thing)
            elif home.startswith("seatrial.") and not getattr(thing, "__name__", "_").startswith("_"):
                called.add(thing.__name__)
    return called, modules


def test_every_step_has_a_road():
    assert set(ROADS) == set(STEPS)


@pytest.mark.parametrize("step", ROADS)
def test_a_step_calls_public_functions(step):
    called, _ = road_of(step)
    assert set(ROADS[step]) <= called


def test_no_other_module_of_campaigns_computes_by_jax():
    modules = set().union(*(road_of(step)[1] for step in STEPS))
    own = {one for one in modules if any(hasattr(import_module(one), name) for name in ("jnp", "program"))}
    assert {one.removeprefix("seatrial.") for one in own} == set(PRIVATE)


# What each command does to the small campaign, in Python, without a folder.

TERMS, SEED, LENGTH, RPM = ("X_uabsu", "T_nabsn"), 3, 100, np.pi / 30
PRIORS = {
    "X_uabsu": st.Uniform(-8.8, 0.0),
    "T_nabsn": st.Uniform(2.0e-4, 12.0e-4),
    "sigma_u": st.Uniform(0.0, 0.25),
}
TRUTH = {"X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.05}


# The random key of a piece of work, of the campaign's seed and the name of the work.
key_of = functools.partial(random_key, SEED)


@pytest.fixture(scope="module")
def flow(tmp_path_factory):
    shorter = (("warmup = 500", f"warmup = {LENGTH}"), ("draws = 1000", f"draws = {LENGTH}"))
    return Workflow(load_campaign(write_small(tmp_path_factory.mktemp("road") / "small", *NO_X_U, *shorter)))


@pytest.fixture(scope="module")
def model():
    return st.load_vehicle("remus100_surge").without("X_u").build(free=TERMS)


@pytest.fixture(scope="module")
def start():
    return {"u": load_surge("remus100_surge").hull.trim["u"]}


@pytest.fixture(scope="module")
def design(flow, model, start):
    campaign = flow.campaign
    beliefs = {name: PRIORS[name] for name in TERMS}
    limits = st.Limits(0.0, 1500 * RPM)
    amplitude, period = campaign.design.grid()
    problem = st.make_design_problem(
        model, beliefs, campaign.families, amplitude, period, {"u": 0.05}, start=start, limits=limits, key=SEED
    )
    return st.design_trial(problem)


@pytest.fixture(scope="module")
def record(design, model, start):
    return st.simulate(model, TRUTH, design.schedule, ["u"], start=start, key=[key_of("noise u")])


@pytest.fixture(scope="module")
def posterior(record, model, start):
    return st.make_posterior(model, record, PRIORS, ["u"], start=start)


@pytest.fixture(scope="module")
def mode(posterior):
    return st.find_mode(posterior, key=key_of(f"mode {TERMS}"))


def test_design(flow, design):
    (sweep,), (alone,) = flow.get("first").sweeps, design.sweeps
    for name in ("amplitude", "period", "gain", "worth", "final_sd"):
        np.testing.assert_array_equal(getattr(sweep, name), getattr(alone, name))


def test_simulate(flow, record):
    (kept,) = flow.get("trials").fit
    assert record.channels == kept.channels
    for channel in ("n", "u"):
        np.testing.assert_array_equal(record.channel(channel), kept.channel(channel))


def test_estimate_by_mode(flow, posterior, mode):
    (answer,) = posterior_modes(flow.campaign, flow.get("trials"))
    assert [name for name, *_ in answer.rows] == list(posterior.names)
    budget = error_budget(posterior, mode, StatedErrors())
    sds = [budget.sd(name, float(sd)) for name, sd in zip(mode.names, mode.sd, strict=True)]
    np.testing.assert_allclose([pair for _, _, (pair,) in answer.rows], np.stack([mode.values, sds], 1), rtol=1e-12)
    assert answer.log_evidence == mode.log_evidence


def test_estimate(flow, posterior, mode):
    (estimate,) = flow.get("estimates")
    draws = estimate.data["draws"].values
    target, there = uncouple(posterior, mode)
    key = key_of(f"chains {TERMS}")
    starts = spread_starts(target, there, draws.shape[0], fold_in(key, 2**31))
    settings = st.ChainSettings(draws.shape[0], LENGTH, draws.shape[1])
    chains = sampler.sample(SAMPLERS[DEFAULT], target, starts, there.cov, key, settings)
    np.testing.assert_array_equal(in_posterior(target, chains).values, draws)
    budget, sd = error_budget(posterior, mode, StatedErrors()), draws.std(axis=(0, 1))
    whole = [budget.sd(name, float(one)) for name, one in zip(posterior.names, sd, strict=True)]
    np.testing.assert_allclose(estimate.data["sd"].values, whole, rtol=1e-12)


def test_select(flow, posterior, mode):
    (evidence,) = flow.get("selection").evidences
    table = flow.campaign.selection
    keys = Keys(key_of(f"evidence {TERMS}"), key_of(f"importance {TERMS}"))
    settings = st.EvidenceSettings(table.repeats, st.SMCSettings(particles=table.particles), table.draws)
    alone: Any = run_task(posterior, EvidenceTask("importance", modes=(mode,)), keys, settings, no_progress)
    assert (evidence.log_value, evidence.std_error) == (alone.evidence.log_value, alone.evidence.std_error)


def test_predict(flow, posterior, record, start):
    (estimate,) = flow.get("estimates")
    data = flow.get("predictions").data
    draws = dict(zip(estimate.names, estimate.draws().T, strict=True))
    predicted = st.predict(posterior, draws, record, start=start, key=key_of("predict trial"))
    for name in ("mean", "motion_sd", "sd"):
        np.testing.assert_array_equal(getattr(predicted, name), data[name].values)
    (fit,) = flow.get("predictions").fits
    assert vars(predicted.score("u")).items() <= vars(fit).items()


def test_profile(flow, posterior, mode):
    profiles = profile_all(flow.campaign, flow.get("trials"), ["X_uabsu"])
    (alone,) = st.profile_likelihood(posterior, mode, ["X_uabsu"])
    np.testing.assert_array_equal(profiles.profiles[0].values, alone.values)
