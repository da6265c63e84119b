"""Section V, the iteration the paper proposes, and the readings of the units it does not print.

Select, redesign to tell the structures apart, re-estimate with both trials. Every second trial is judged beforehand by the
standard deviation it would leave for the doubted coefficient, from the Fisher information of both trials together; the best is
simulated and fitted jointly with the first. For as much sea time, the first trial is also run a second time.
"""

from textwrap import fill
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.special import logsumexp

from seatrial.design.sweep import sweep_family
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.numerics.integrate import euler_step
from seatrial.report.figures.style import BLUE, DOTS, INK, MUTED, ORANGE, PURPLE, limit_ticks
from seatrial.selection.importance import (
    ImportanceSettings,
    Weights,
    evidence_of,
    importance_evidence,
    importance_sample,
)
from studies.remus100.designs import ACTIVE, PERIODS, POINTS, design_space, true_state
from studies.remus100.filters import FIRST_SEED, filter_space, in_printed_units, make_trials, run_over_seeds
from studies.remus100.fisher import fisher_information
from studies.remus100.panels import PAGE, TEXT, key, name_axes, panels, symbol, with_unit
from studies.remus100.reading import NAMES, READINGS, Reading
from studies.remus100.study import Item, Number, Study
from studies.remus100.trial import (
    DURATION,
    STEP,
    around,
    doublets,
    paper_posterior,
    paper_trial,
    stamps,
    wide,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LONGER = 58.0  # Window of the redesigned doublets, s
SECOND_PERIODS = (5.0, 8.0, 10.0, 14.0, 19.0, 29.0, 58.0)
WEIGHING = ImportanceSettings(draws=8192, pilot=2048)
FITS = ("one trial", "the same trial twice", "redesigned second trial")
COLOURS = (BLUE, ORANGE, PURPLE, INK)
ALONE = {"color": DOTS, "marker": "o", "markersize": 4, "linestyle": "none"}
FIRST = {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2))}


def iteration_part(study: Study) -> xr.Dataset:
    """Predicted gain of each second trial, and what the fits say before and after the best of them."""
    reading, report = study.reading, study.progress("iteration")
    value, model = reading.doubted_values[0], reading.model(reading.doubted)
    truth = {**reading.truth, reading.doubted: value}
    relay = study.part("relay")
    first = doublets(reading)
    candidates = {f"doublets of {period:g} s": doublets(reading, period, LONGER) for period in SECOND_PERIODS}
    candidates["self-oscillating test"] = relay["n"].values
    report(0, 4)
    information = fisher_information(
        model,
        truth,
        np.stack([first, *candidates.values()])[..., None],
        STEP,
        [reading.hull.trim["u"]],
        {"u": reading.sigma},
    )
    names = tuple(term.text for term in model.coefficients)
    scale = np.array([reading.print_scales[name] for name in names])
    alone, both = _sds(information[1:]) / scale, _sds(information[0] + information[1:]) / scale
    doubted = names.index(reading.doubted)
    best = int(np.argmin(both[:, doubted]))
    control = list(candidates.values())[best]
    report(1, 4)
    one = paper_trial(reading, value)
    seconds = {
        FITS[0]: [one],
        FITS[1]: [one, paper_trial(reading, value, 2, label="second")],
        FITS[2]: [one, paper_trial(reading, value, 2, control, label="second")],
    }
    rows, key = [], study.random_key("iteration")
    for done, records in enumerate(seconds.values()):
        full, reduced = (paper_posterior(reading, records, prior) for prior in (wide(reading), None))
        weighted = [
            importance_sample(posterior, jax.random.fold_in(key, done), settings=WEIGHING)
            for posterior in (full, reduced)
        ]
        evidences = [evidence_of(weights) for weights in weighted]
        odds = evidences[1].log_value - evidences[0].log_value
        p = 1.0 / (1.0 + np.exp(odds))
        by_name = [
            dict(zip(posterior.names, _weighted_sd(posterior, weights), strict=True))
            for posterior, weights in zip((full, reduced), weighted, strict=True)
        ]
        rows.append(
            xr.Dataset(
                {
                    "probability": ((), p),
                    "error": ((), p * (1 - p) * np.hypot(evidences[0].std_error, evidences[1].std_error)),
                    "full_sd": ("coefficient", [by_name[0][name] / s for name, s in zip(names, scale, strict=True)]),
                    "reduced_sd": (
                        "coefficient",
                        [by_name[1].get(name, np.nan) / s for name, s in zip(names, scale, strict=True)],
                    ),
                }
            )
        )
        report(done + 2, 4)
    return (
        xr.concat(rows, xr.IndexVariable("fit", list(FITS)))
        .assign(
            alone=(("design", "coefficient"), alone),
            both=(("design", "coefficient"), both),
            first_sd=("coefficient", _sds(information[:1])[0] / scale),
            first=("time", first),
            second=("time", control),
        )
        .assign_coords(design=list(candidates), coefficient=list(names), time=stamps())
    )


def readings_part(study: Study) -> xr.Dataset:
    """Return the standard deviations of filter and fit, entropy reductions, and the probability of M-0, under both readings."""
    report, rows = study.progress("both readings of the units"), []
    for done, reading in enumerate(READINGS.values()):
        report(done, len(READINGS))
        rows.append(_numbers(study, reading))
    report(len(READINGS), len(READINGS))
    return xr.concat(rows, xr.IndexVariable("reading", list(READINGS))).assign_coords(coefficient=list(NAMES))


def iteration(study: Study) -> Item:
    """Select, redesign, re-estimate: what a second, redesigned trial adds to the first."""
    data, doubted = study.part("iteration"), study.reading.doubted
    both = data["both"].sel(coefficient=doubted)
    best = str(both["design"].values[int(both.values.argmin())])
    sds = {fit: float(data["full_sd"].sel(fit=fit, coefficient=doubted)) for fit in FITS}
    p = {fit: (float(data["probability"].sel(fit=fit)), float(data["error"].sel(fit=fit))) for fit in FITS}
    numbers = [
        Number(f"predicted sd of {doubted} after {name} too", None, float(both.sel(design=name)))
        for name in both["design"].values
    ]
    for fit in FITS:
        numbers.append(Number(f"P(M-0) under the wide prior, {fit}", None, *p[fit]))
        numbers += [
            Number(f"sd of {name} in M-0, {fit}", None, float(data["full_sd"].sel(fit=fit, coefficient=name)))
            for name in (*NAMES, doubted)
        ]
        numbers += [
            Number(f"sd of {name} in M-1, {fit}", None, float(data["reduced_sd"].sel(fit=fit, coefficient=name)))
            for name in NAMES
        ]
    gain = sds[FITS[1]] / sds[FITS[2]]
    holds = gain > 1
    return Item(
        "iteration",
        "Section V: the two stages repeated",
        "not comparable" if holds else "contradicted",
        f"the paper proposes it and shows no result: after one trial the sd of {doubted} is {sds[FITS[0]]:.2f} and P(M-0) "
        f"{p[FITS[0]][0]:.2f}; the best second trial "
        f"({best}) brings them to {sds[FITS[2]]:.2f} and {p[FITS[2]][0]:.3f}, the first trial repeated only to "
        f"{sds[FITS[1]]:.2f} and {p[FITS[1]][0]:.2f}",
        tuple(numbers),
        {"reading": study.reading.name, "data_seeds": [1, 2], doubted: study.reading.doubted_values[0]},
    )


def readings(study: Study) -> Item:
    """Both readings of the unprinted units side by side."""
    data, numbers = study.part("readings"), []
    for name in map(str, data["reading"].values):
        one = data.sel(reading=name)
        numbers += [
            Number(f"{name}: sd of {c} by the SRUKF of Table I", None, float(one["filter_sd"].sel(coefficient=c)))
            for c in NAMES
        ]
        numbers += [Number(f"{name}: sd of {c} in M-1", None, float(one["fit_sd"].sel(coefficient=c))) for c in NAMES]
        numbers += [
            Number(f"{name}: sd of {c} in M-0", None, float(one["full_fit_sd"].sel(coefficient=c))) for c in NAMES
        ]
        numbers += [
            Number(f"{name}: gain of the 10 s doublet [nat]", None, float(one["gain_10_s"])),
            Number(f"{name}: gain of the 20 s doublet [nat]", None, float(one["gain_20_s"])),
        ]
        numbers += [
            Number(f"{name}: P(M-0) at X_du3 = {value:g}", None, float(one["probability"].sel(value=value)))
            for value in one["value"].values
        ]
    spread = float(np.abs(data["probability"] - data["probability"].mean("reading")).max())
    ratio = float((data["fit_sd"].sel(reading="B") / data["fit_sd"].sel(reading="A")).mean())
    return Item(
        "readings",
        "Readings A and B of the unprinted units",
        "not comparable" if spread < 0.05 else "contradicted",
        f"units of T and n are not printed: under B the same rpm excite the vehicle less, and standard deviations are {ratio:.2f} "
        f"times those under A; those under A are nearer to the tables; P(M-0) moves by {2 * spread:.3f} at most"
        + (
            ", so no verdict on the models depends on it"
            if spread < 0.05
            else ", so the verdict on the models depends on it"
        ),
        tuple(numbers),
        {
            "readings": {"A": "T in 1e-2 N/(rev/s)^2, 750 rpm", "B": "T in 1e-4 N/(rad/s)^2, 1194 rpm"},
            "filter_seeds": [FIRST_SEED, FIRST_SEED + study.sizes.tuning_seeds - 1],
            "data_seed": 1,
        },
    )


def draw_iteration(study: Study) -> "Figure":
    """Draw the predicted standard deviations of every second trial, and fits of one trial, of two, and of the redesigned two."""
    data = study.part("iteration")
    figure, grid = panels(PAGE, [82, 82], 2, left=112, between=64, gap=14, right=14, share_x=False, bottom=40)
    grid[0, 0].remove()
    axes = grid[1, 0]
    low, high = axes.get_position(), grid[0, 1].get_position()
    axes.set_position((low.x0, low.y0, low.width, high.y1 - low.y0))
    _candidates(axes, data.sel(coefficient=study.reading.doubted))
    name_axes(axes, with_unit(study.reading, study.reading.doubted, "predicted sd of "))
    _fits(grid[0, 1], grid[1, 1], data)
    key(
        figure,
        {
            "with the first trial": {"color": BLUE, "linewidth": 6, "alpha": 0.6},
            "alone": ALONE,
            "first trial alone": FIRST,
        },
    )
    return figure


def _sds(information: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))


def _numbers(study: Study, reading: Reading) -> xr.Dataset:
    trials = make_trials(reading, study.sizes.tuning_seeds)
    trace = run_over_seeds(SquareRootUnscentedKalmanFilter(), filter_space(reading), trials)
    family = Family("n", reading.turns, duration=DURATION, active=ACTIVE["medium"], sample_time=STEP)
    sweep = sweep_family(
        design_space(reading, euler_step),
        family,
        np.linspace(reading.lowest, reading.highest, POINTS),
        PERIODS,
        truth=true_state(reading),
    )
    scale = np.array([reading.print_scales[name] for name in NAMES])
    fitted = find_mode(
        paper_posterior(reading, [paper_trial(reading, None)], None), key=study.random_key("readings")
    ).sd
    small = paper_trial(reading, reading.doubted_values[0])
    full = find_mode(paper_posterior(reading, [small], wide(reading)), key=study.random_key("readings")).sd
    probability, logs = [], []
    for value in reading.doubted_values:
        record = paper_trial(reading, value)
        pair = [
            importance_evidence(
                paper_posterior(reading, [record], prior),
                jax.random.fold_in(study.random_key("odds"), 0),
                settings=WEIGHING,
            )
            for prior in (around(value), None)
        ]
        logs.append([one.log_value for one in pair])
        probability.append(1.0 / (1.0 + np.exp(pair[1].log_value - pair[0].log_value)))
    return xr.Dataset(
        {
            "filter_sd": ("coefficient", in_printed_units(reading, trace.sds[:, -1, 1:]).mean(0)),
            "fit_sd": ("coefficient", fitted[: len(NAMES)] / scale),
            "full_fit_sd": ("coefficient", full[: len(NAMES)] / scale),
            "gain_10_s": ((), float(sweep.gain[-1, np.searchsorted(PERIODS, 10.0)])),
            "gain_20_s": ((), float(sweep.gain[-1, -1])),
            "probability": ("value", probability),
            "log_value": (("value", "model"), logs),
        },
        {"value": list(reading.doubted_values)},
    )


def _candidates(axes: "Axes", one: xr.Dataset) -> None:
    designs = [str(name) for name in one["design"].values]
    at = -np.arange(len(designs))
    axes.barh(at, one["both"].values, height=0.6, color=BLUE, alpha=0.6, label="with the first trial")
    axes.plot(one["alone"].values, at, label="alone", **ALONE)
    axes.axvline(float(one["first_sd"]), label="first trial alone", **FIRST)
    axes.set_yticks(at, designs)
    axes.set_xlim(0, 1.08 * max(float(one["alone"].max()), float(one["first_sd"])))
    axes.grid(False, axis="y")
    limit_ticks(axes.xaxis, 5)


def _fits(upper: "Axes", lower: "Axes", data: xr.Dataset) -> None:
    """Draw the standard deviations of M-0 over those of one trial, and the probability of M-0 below."""
    fits = [str(name) for name in data["fit"].values]
    at = np.arange(len(fits))
    for colour, name in zip(COLOURS, map(str, data["coefficient"].values), strict=False):
        sd = data["full_sd"].sel(coefficient=name).values
        upper.plot(at, sd / sd[0], color=colour, linewidth=1.1, marker="o", markersize=3.5, label=name)
    upper.set_ylim(0, 1.08)
    upper.set_xticks(at, [])
    upper.legend(
        [symbol(str(name)) for name in data["coefficient"].values],
        loc="lower left",
        ncols=2,
        frameon=False,
        fontsize=TEXT,
        labelcolor=INK,
        borderaxespad=0.1,
        labelspacing=0.2,
        handlelength=1.4,
        columnspacing=1.0,
    )
    p = data["probability"].values
    lower.axhline(0.5, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), label="undecided")
    lower.errorbar(at, p, yerr=data["error"].values, color=BLUE, linewidth=1.1, marker="o", markersize=4, label="M-0")
    lower.set(xlim=(-0.4, at[-1] + 0.4), ylim=(0, 1))
    upper.set_xlim(lower.get_xlim())
    lower.set_xticks(at, [fill(name, 12) for name in fits])
    name_axes(upper, y="sd of M-0,\none trial = 1")
    name_axes(lower, y="probability\nof M-0")


def _weighted_sd(posterior: Posterior, weights: Weights) -> Float[np.ndarray, " d"]:
    """Return the posterior standard deviations of the parameters in their own units, shape (d,)."""
    share = np.exp(weights.smoothed - float(logsumexp(weights.smoothed)))
    values = np.asarray(posterior.constrain(jnp.asarray(weights.z)))
    return np.sqrt(share @ (values - share @ values) ** 2)
