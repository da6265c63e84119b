"""A made-up outcome of an imported campaign, with names that try to break the page; nothing is computed to make it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.coefficient_csv import averaged_rows, quote_rows
from seatrial.campaign.selection.runner_up import NEXT, contending
from seatrial.campaign.store.estimates import Estimate, StoredCoefficient
from seatrial.campaign.store.predictions import Fit, FittedBaselines
from seatrial.campaign.store.summary import NextTrial, Summary
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.coefficients import CoefficientName
from seatrial.core.findings import Finding
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.design.sweep import Sweep
from seatrial.design.trial_design import TrialDesign
from seatrial.estimation.diagnostics.known import Direction, Known, KnownParameter
from seatrial.estimation.prediction.baseline_comparison import Comparison, Predicted, Run, compare
from seatrial.estimation.prediction.fit_verdict import Pooled, judge_fit, judge_runs
from seatrial.estimation.prediction.prediction_scores import PredictedRun, Score, unscored
from seatrial.selection.contenders import Contenders, SpeedDifference
from seatrial.selection.cross_validation import OWN, Candidate, CrossValidation, LeaveOneRunOut, LeftOutRun
from seatrial.selection.screened import Screened
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Evidence, Selection, select

EVIL = "<script>alert(1)</script>"
FITTED, HELD = ("1", '<b>$x_1$ & "y"'), "held_2"
CAMPAIGN = """
[campaign]
name = "<script>alert(1)</script>"
seed = 1
[vehicle]
mass = "unknown"
[structure]
always = ["X_tau_X"]
optional = ["X_u", "X_uabsu"]
[prior.X_tau_X]
distribution = "uniform"
lower = 0.0
upper = 0.1
[prior.X_u]
distribution = "uniform"
lower = -3.0
upper = 0.0
[prior.X_uabsu]
distribution = "normal"
mean = -4.0
sd = 3.0
[prior.delay]
distribution = "uniform"
lower = 0.0
upper = 1.0
[sensors.u]
noise = "0.02 m/s"
[sensors.udot]
noise = "0.05 m/s^2"
[limits.tau_X]
lower = "-20 N"
upper = "20 N"
[design]
control = "tau_X"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = { from = "5 N", to = "30 N", points = 5 }
period = { from = "2 s", to = "20 s", points = 4 }
[estimation]
initial = "estimated"
[import]
fit = ["1"]
[[import.files]]
path = "run.csv"
time = { column = "t", unit = "s" }
channels.u = { column = "u", unit = "m/s" }
"""
METHODS = {
    name: {"log_value": value, "std_error": 0.1, "difference": value + 3.0, "joint_errors": apart, "status": ""}
    for name, value, apart in (("importance", -3.0, 0.0), ("smc", -3.1, -0.7))
}
TRUE = {"X_tau_X": 0.0148, "X_u": -0.54, "X_uabsu": -3.5, "delay": 0.38, "sigma_u": 0.027, "sigma_udot": 2.6e-5}
UNITS = {"delay": "s", "sigma_u": "m/s", "sigma_udot": "m/s^2"}
LABELS = {"delay": r"t_{\mathrm{delay}}", "sigma_u": r"\sigma_{u}", "sigma_udot": r"\sigma_{\dot{u}}"}


def make_outcome(folder: Path, alarms: tuple[str, ...] = (), gain: float = 1.0) -> Outcome:
    """Return an outcome of two fitted records and one held back, four structures, and a next trial of the given gain."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    campaign = load_campaign(folder)
    random = np.random.default_rng(5)
    trials = Trials(tuple(_record(label, random) for label in FITTED), (_record(HELD, random),), "key")
    estimates = tuple(_estimate(structure, random) for structure in campaign.structures)
    evidences = [Evidence(-3.0 * index, 0.1, "made up", {"methods": METHODS}) for index in range(len(estimates))]
    selection = select(campaign.structures, evidences, campaign.structure.optional)
    labels = tuple(f"{one.structure.label}: " for one in estimates)
    estimates = tuple(
        replace(one, alarms=tuple(text.removeprefix(label) for text in alarms if text.startswith(label)))
        for one, label in zip(estimates, labels, strict=True)
    )
    selection = replace(selection, alarms=tuple(text for text in alarms if not text.startswith(labels)))
    chosen, next_design = estimates[selection.chosen], _designs(campaign, gain)
    fits = tuple(
        _fit(record.label, channel) for record in (*trials.fit, *trials.predict) for channel in campaign.channels
    )
    averages, coefficients = averaged_rows(estimates, selection), tuple(_row(chosen, name) for name in chosen.names)
    summary = Summary(
        name=campaign.name,
        chosen=chosen.structure.label,
        terms=chosen.structure.terms,
        coefficients=coefficients,
        structures=selection.rows,
        inclusion=selection.inclusion,
        inclusion_error=selection.inclusion_error,
        verdicts=selection.verdicts,
        cautions=(f"held-back run {HELD} is predicted poorly: 40% of the variance of u explained",),
        findings=(),
        alarms=alarms,
        choice_alarms=(),
        usable=not any(text.startswith(f"{chosen.structure.label}: ") for text in alarms),
        known=make_known(chosen),
        fits=fits,
        pooled=make_pooled(0.02),
        baselines=make_compared(0.02),
        next_trial=NextTrial(
            "", False, replace(next_design.design(next_design.best), sd_after=dict.fromkeys(next_design.names, 0.01))
        ),
        averaged=averages,
        quoted=selection.quoted,
        quote=quote_rows(selection.quoted, coefficients, averages),
    )
    return Outcome(
        campaign,
        trials,
        estimates,
        selection,
        chosen,
        _filter(campaign, trials, random),
        fits,
        _predictions(campaign, trials),
        make_pooled(0.02),
        make_baselines(),
        make_compared(0.02),
        make_known(chosen),
        None,
        None,
        next_design,
        make_screened(),
        (),
        make_contenders(campaign, selection),
        summary,
        cross_validation=make_cross_validation(),
    )


def make_cross_validation() -> CrossValidation:
    """Two structures of which the evidence prefers the one that predicts runs left out worse."""
    candidates = []
    for label, evidence, size in (("M-0", -100.0, 1.0), ("M-1", -104.0, 20.0)):
        scores = {"u": replace(unscored(100, ""), crps=0.02, coverage_50=0.5, coverage=0.7)}
        runs = (
            LeftOutRun(name, size + more, 0.1, 0.2, False, scores)
            for name, more in zip("abc", (0.0, 1.0, 1.5), strict=True)
        )
        left = LeaveOneRunOut(tuple(runs), {pooled.channel: pooled for pooled in make_pooled(0.5)}, evidence, "")
        candidates.append(Candidate(Structure(label, ("X_u",)), OWN, (), left))
    return CrossValidation(("a", "b", "c"), tuple(candidates), ())


def make_pooled(scale: float) -> tuple[Pooled, ...]:
    """Held-back runs whose errors are of this size, and noise that was found to be 0.02."""
    time, random = np.arange(150) * 0.1, np.random.default_rng(3)
    motion, none = 0.2 * np.sin(time), np.zeros(150)
    runs = [PredictedRun(time, motion + scale * random.normal(size=150), motion, none, 0.02) for _ in range(3)]
    return (judge_runs(runs, "u"),)


def make_compared(error: float) -> tuple[Comparison, ...]:
    """A model whose speed is off by this, beside a lag that is off by 0.05 and a mean."""
    time, random = np.arange(150) * 0.1, np.random.default_rng(4)
    motion, sd = 0.2 * np.sin(time), np.full(150, 0.05)
    runs = [Run(time, motion + 0.02 * random.normal(size=150)) for _ in range(3)]

    def of(mean: np.ndarray) -> list[Predicted]:
        return [Predicted(mean, sd)] * 3

    lag = "a first-order lag of the controls"
    return (
        compare("u", runs, of(motion + error), {lag: of(motion + 0.05), "the mean of the fitted runs": of(0 * motion)}),
    )


def make_screened(cautions: str = "") -> Screened:
    """Two optional terms and one that is always there; one coefficient changes its sign along the prior's width."""
    names, scale = ["X_u", "X_uabsu", "X_tau_X"], np.array([0.1, 0.3, 1.0, 3.0, 10.0])
    member = np.array([[1, 1, 1], [1, 0, 1], [0, 1, 1], [0, 0, 1]], bool)
    inclusion = np.stack([[0.9, 0.4, 1.0]] * scale.size) * np.linspace(1.0, 0.5, scale.size)[:, None]
    inclusion[:, 2] = 1.0
    zeros = np.zeros(3)
    return Screened(
        xr.Dataset(
            {
                "always": ("term", [False, False, True]),
                "inclusion": ("term", inclusion[2]),
                **dict.fromkeys(
                    ("within", "between", "fit", "fit_sd", "bias", "bias_error", "inclusion_by_unit_information"),
                    ("term", zeros),
                ),
                "mean": ("term", np.array([-0.5, -3.0, 0.015])),
                "probability": ("model", np.array([0.6, 0.25, 0.1, 0.04])),
                "member": (("model", "term"), member),
                "inclusion_at": (("scale", "term"), inclusion),
                "mean_at": (("scale", "term"), np.array([-0.5, -3.0, 0.015]) * np.linspace(-0.2, 1.0, 5)[:, None]),
            },
            coords={"term": names, "scale": scale},
            attrs={"count": 4, "rows": cautions, "noise": "", "sampling": "", "left_out": "", "r2": 0.9},
        )
    )


def make_contenders(campaign: Campaign, selection: Selection, nats: float = 5.0) -> Contenders:
    """Two structures whose speeds differ by a sine, and a grid whose last column breaks a limit."""
    best, runner = contending(selection)
    time, (amplitude, period) = np.arange(100) * 0.3, campaign.design.grid()
    told = nats * np.linspace(0.1, 1.0, amplitude.size * period.size).reshape(amplitude.size, period.size)
    told[-1] = np.nan
    differences = []
    for i, words in enumerate([*(f"run {label}" for label in FITTED), NEXT], 1):
        gap = 0.01 * i * np.sin(time)
        curves = time, 1.0 + gap, gap, gap - 0.004, gap + 0.004
        differences.append(SpeedDifference(words, float(i), *curves, largest=0.01 * i, rms=0.007 * i))
    grid = amplitude, period, told
    return Contenders(best, runner, "u", 0.02, tuple(differences), *grid, "repeated doublet of ±20 N")


def make_baselines() -> FittedBaselines:
    """None that could be fitted."""
    nothing = np.empty((0, 1)), np.empty(0, int), np.empty((0, 0, 1))
    refused = {"nomoto": f"no yaw rate r is among the channels {EVIL}"}
    return FittedBaselines(("u",), (HELD,), (), {}, {}, *nothing, refused)


def make_known(estimate: Estimate) -> Known:
    """A parameter that is known, one known only together with the next, and others that the data do not touch."""
    names, units = estimate.names, map(str, estimate.data["unit"].values)
    numbers = [(0.5, 0.01, 0.02, 0.1, 0.1), (0.5, 0.4, 0.8, 0.5, -0.97)] + [(0.0, 9.0, 1e300, 1.0, 0.2)] * len(names)
    rows = tuple(
        KnownParameter(name, unit, *found[:-1], names[(i + 1) % len(names)], found[-1])
        for i, (name, unit, found) in enumerate(zip(names, units, numbers, strict=False))
    )
    directions = (
        Direction(0.01, ((names[0], 0.01), (names[1], -0.004)), (True, True)),
        Direction(2.0, ((names[1], 1.9), (names[2], 0.3)), (True, False)),
    )
    verdict = (f"known only in combination: {names[0]} + {names[1]} to 2 %; to separate them, run <b>faster</b>",)
    return Known("after", estimate.structure.label, rows, directions, verdict)


def _fit(label: str, channel: str) -> Fit:
    """A poor prediction; of the second channel of the first record nothing was measured."""
    held_back = label == HELD
    if label == FITTED[0] and channel == "udot":
        score = unscored(0, "nothing was measured")
    else:
        numbers = {"explained": 0.4, "nrmse": 0.2254, "rmse": 0.03, "crps": 0.02, "log_score": 1.0, "noise_share": 0.1}
        numbers |= {"noise_sd": 0.02, "coefficient_share": 0.1, "white": 1e-9, "sd_factor": 4.4, "p_value": 0.01}
        bands = {"coverage_50": 0.3, "coverage": 0.7, "lower": 0.46, "upper": 0.88, "variance": 2.2, "pit": (0.1,) * 10}
        score = Score(150, 20.0, **numbers, **bands, widen=1.5, widen_lower=1.2, widen_upper=1.8)
    verdict = judge_fit(score, channel, held_back, "white")
    return Fit(**vars(score), record=label, held_back=held_back, channel=channel, verdict=verdict)


def _record(label: str, random: np.random.Generator) -> Record:
    time = np.arange(150) * 0.1
    control = np.where(np.sin(time) > 0, 15.0, -15.0)
    u = 0.2 * np.sin(time) + 0.02 * random.normal(size=time.size)
    u[::3] = np.nan
    channels = (
        Channel("tau_X", "N", "control"),
        Channel("u", "m/s", "measurement"),
        Channel("udot", "m/s^2", "measurement"),
    )
    provenance = Provenance(f"{EVIL}.csv", "0" * 64, {"note": EVIL, "start": 2.0, "end": 30.0, "available": 40.0})
    return make_record(time, {"tau_X": control, "u": u, "udot": 0.2 * np.cos(time)}, channels, provenance, label)


NOISE, MODEL = [1.0, 0.0, 0.0, 0.0], [0.1, 0.0, 0.0, 0.9]  # What standard deviations are made of


def _estimate(structure: Structure, random: np.random.Generator) -> Estimate:
    names = [*structure.terms, *UNITS, *(f"u_0[{label}]" for label in FITTED)]
    truth = np.array([TRUE.get(name, 0.01) for name in names])
    common = random.normal(size=(4, 300, 1))
    draws = truth + 0.1 * np.abs(truth) * (0.8 * common + 0.6 * random.normal(size=(4, 300, len(names))))
    terms = {name: CoefficientName.parse(name) for name in structure.terms}
    label = [terms[name].label if name in terms else LABELS.get(name, name) for name in names]
    unit = ["1/kg" if name == "X_tau_X" else UNITS.get(name, "1/s") for name in names]
    columns = {
        "mode": truth,
        "laplace_sd": 0.1 * np.abs(truth),
        "mean": draws.mean((0, 1)),
        "sd": np.where(np.arange(len(names)) % 3, draws.std((0, 1)), 0.3 * np.abs(truth)),
        "draws_sd": draws.std((0, 1)),
        "prior_mean": 1.2 * truth,
        "prior_sd": np.abs(truth),
        "prior_lower": truth - 2.0 * np.abs(truth),
        "prior_upper": np.where(np.arange(len(names)) % 2, np.inf, truth + 2.0 * np.abs(truth)),
        "r_hat": np.full(len(names), 1.002),
        "ess_bulk": np.full(len(names), 900.0),
        "ess_tail": np.full(len(names), 800.0),
        "geweke": np.ones(len(names)),
        "mcse": np.full(len(names), 1e-4),
    }
    data = xr.Dataset(
        {
            "draws": (("chain", "draw", "parameter"), draws),
            **{name: ("parameter", column) for name, column in columns.items()},
            "shares": (("parameter", "origin"), np.where(np.arange(len(names))[:, None] % 3, NOISE, MODEL)),
            "prior_value": (("parameter", "point"), truth[:, None] + np.abs(truth)[:, None] * np.linspace(-2, 2, 9)),
            "prior_density": (("parameter", "point"), np.full((len(names), 9), 0.25) / np.abs(truth)[:, None]),
        },
        coords={
            "parameter": names,
            "unit": ("parameter", unit),
            "label": ("parameter", label),
            "prior_kind": ("parameter", ["Uniform"] * len(names)),
        },
        attrs={"acceptance": 0.23, "laplace_log_evidence": 1.0, "key": structure.label},
    )
    cause = Finding("main-error", "note", tuple(names[:1]), {"effects": (("force", "X_u3"),)}, ("add-force",))
    return Estimate(
        structure,
        data,
        contains="± contains what is made up.",
        causes=dict.fromkeys(names[::3], "a force X_u3"),
        cause_findings=(cause,),
        tried_effects=("a force X_u3", "a lag of the actuator of n"),
    )


def _row(estimate: Estimate, name: str) -> StoredCoefficient:
    row = estimate.data.sel(parameter=name)
    mean, sd = float(row["mean"]), float(row["sd"])
    numbers = {key: float(row[key]) for key in ("r_hat", "ess_bulk", "ess_tail")}
    others = dict.fromkeys(("mcse", "mode", "prior_mean", "prior_sd", "geweke"), 0.0)
    ends = {"lower_95": mean - 2 * sd, "upper_95": mean + 2 * sd}
    texts = {key: str(row[key].values) for key in ("unit", "label")}
    made_of = {"shares": estimate.shares(name), "cause": estimate.causes.get(name, "")}
    return StoredCoefficient(name=name, mean=mean, sd=sd, **texts, **numbers, **others, **ends, **made_of)


def _filter(campaign: Campaign, trials: Trials, random: np.random.Generator) -> xr.Dataset:
    names = list(campaign.structures[0].terms)
    count = sum(record.time.size for record in trials.fit)
    sd = 1.0 / np.sqrt(1.0 + np.arange(count))[:, None] * np.ones(len(names))
    return xr.Dataset(
        {
            "time": ("sample", np.concatenate([record.time for record in trials.fit])),
            "nis": ("sample", np.ones(count)),
            "record": ("sample", np.repeat([0, 1], count // 2)),
            "n_measured": ("sample", np.ones(count)),
            "mean": (("sample", "coefficient"), 0.1 * sd * random.normal(size=sd.shape)),
            "sd": (("sample", "coefficient"), sd),
        },
        coords={"coefficient": names},
        attrs={"failures": 0, "records": json.dumps(FITTED), "filter": "square-root UKF"},
    )


def _predictions(campaign: Campaign, trials: Trials) -> xr.Dataset:
    records = [*trials.fit, *trials.predict]
    measured = np.concatenate(
        [np.column_stack([record.channel(name) for name in campaign.channels]) for record in records]
    )
    time = np.concatenate([record.time for record in records])
    mean = 0.2 * np.column_stack([np.sin(time), np.cos(time)])
    return xr.Dataset(
        {
            "time": ("sample", time),
            "record": ("sample", np.repeat(np.arange(len(records)), [r.time.size for r in records])),
            "measured": (("sample", "channel"), measured),
            "mean": (("sample", "channel"), mean),
            "sd": (("sample", "channel"), np.full(mean.shape, 0.02)),
        },
        coords={"channel": list(campaign.channels)},
    )


def _designs(campaign: Campaign, gain: float) -> TrialDesign:
    amplitude, period = campaign.design.grid()
    values = gain * np.linspace(0.5, 1.0, amplitude.size * period.size).reshape(amplitude.size, period.size)
    values[amplitude > 20.0] = np.nan
    sd = np.full((*values.shape, 3), 0.01)
    sweep = Sweep(
        campaign.family,
        amplitude,
        period,
        values,
        np.ones(values.shape),
        sd,
        ((campaign.family.control, campaign.family.trim),),
    )
    names = ("X_tau_X", "X_u", "X_uabsu")
    return TrialDesign(
        (sweep,),
        {"chirp": "its periods are too long"},
        dict.fromkeys(names, 0.02),
        {name: campaign.units[name] for name in names},
        basis="a posterior",
    )
