"""Are the stated probabilities of terms true? `python docs/term_probabilities.py [--records N] [--full N]`, or `--redraw`.

Vehicles draw which of four terms they have, and their coefficients, from the priors of the model. A plain loop that shares no code with
seatrial simulates three runs of each: with white noise, with a slow error of the sensor, with a mass that is not the stated one, with a
force that drifts, and with a thruster that lags. Of all 16 structures the evidence within the model is found, and the one with every error;
the probabilities of the terms that follow are compared with the truth. What is done is kept in outputs/term_probabilities. Writes the
numbers in docs/dev/term_probabilities.json, and from these the table in docs/dev/term_probabilities.md and
docs/dev/term_probabilities.svg; `--redraw` writes only what is made from the numbers.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import study_numbers
from matplotlib.figure import Figure
from scipy import stats
from scipy.special import expit, logit

import seatrial as st
from seatrial.core.files import write_text
from seatrial.estimation.diagnostics.error_evidence import log_evidence_gains
from seatrial.estimation.diagnostics.error_sources import StatedErrors
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.report.drawing import draw_svg
from seatrial.report.figures.style import (
    BAND,
    BLUE,
    INK,
    MUTED,
    ORANGE,
    POINT,
    SMALL,
    draw_dots,
    own_settings,
    style_axes,
)
from seatrial.selection.importance import ImportanceSettings, importance_evidence

HERE = Path(__file__).parent
STATE = HERE.parent / "outputs" / "term_probabilities"
KINDS = {"within the model": False, "with every error": True}
"""Kinds of probabilities, and whether every error is in them."""
STEP, FINE, SAMPLES, RUNS = 0.1, 5, 400, 3
"""Interval of the samples, s; steps of the simulation in one; samples of a run; runs of a vehicle."""
NOISE, MASS, DEDUCTION, TRIM = 0.02, 31.41, 0.1, 125.0
"""Of the speed sensor, m/s; effective mass, kg; share of the thrust that the hull takes; speed of the propeller, rad/s."""
ALWAYS = {"X_uabsu": st.Normal(-2.93, 0.5), "T_nabsn": st.Normal(6.28e-4, 6e-5)}
OPTIONAL = {
    "X_u": st.Normal(-1.2, 0.6),
    "X_u3": st.Normal(-0.5, 0.3),
    "T_un": st.Normal(-0.01, 0.006),
    "X_0": st.Normal(0.0, 0.7),
}
NUISANCES = {"sigma_u": st.LogUniform(0.002, 0.5), "u_0": st.Normal(1.5, 0.3)}
EDGES = (0.05, 0.25, 0.75, 0.95)
"""Of the bins of stated probabilities."""
CHANNELS = (st.Channel("n", "rad/s", "control"), st.Channel("u", "m/s", "measurement"))
OWN = st.Provenance("a plain loop", "")


class Arm(NamedTuple):
    """What is wrong with the model: sizes of each vehicle's error, none where 0.

    Attributes:
        words: in the table.
        slow: standard deviation of a slow error of the sensor, m/s, and its memory, s.
        mass: error of the stated mass, as a share, to either side.
        force: standard deviation of a force that drifts, N, and its memory, s.
        lag: of the thruster, s, from and to.
    """

    words: str
    slow: tuple[float, float] = (0.0, 1.0)
    mass: float = 0.0
    force: tuple[float, float] = (0.0, 1.0)
    lag: tuple[float, float] = (0.0, 0.0)


ARMS = {
    "A": Arm("nothing: white noise"),
    "B": Arm("a slow error of the sensor", slow=(0.03, 5.0)),
    "C": Arm("a mass 5 % off", mass=0.05),
    "D": Arm("a force that drifts", force=(0.5, 5.0)),
    "E": Arm("a thruster that lags", lag=(0.3, 1.0)),
}


def vehicle(arm: str, number: int) -> tuple[list[bool], list[st.Record]]:
    """Return which of the optional terms a vehicle has, and its runs."""
    about, random = ARMS[arm], np.random.default_rng([ord(arm), number])
    present = random.random(len(OPTIONAL)) < 0.5
    values = {
        name: float(prior.mean + prior.sd * random.standard_normal()) for name, prior in {**ALWAYS, **OPTIONAL}.items()
    }
    values |= {name: 0.0 for name, is_there in zip(OPTIONAL, present, strict=True) if not is_there}
    mass = MASS * (1.0 + about.mass * random.choice([-1.0, 1.0]))
    lag = random.uniform(*about.lag)
    return present.tolist(), [run(about, values, mass, lag, each, random) for each in range(RUNS)]


def run(
    about: Arm, values: Mapping[str, float], mass: float, lag: float, number: int, random: np.random.Generator
) -> st.Record:
    """Return one run of a vehicle, by midpoint steps."""
    hold = (3.0, 5.0, 8.0)[number % 3]
    time = np.arange(SAMPLES) * STEP
    command = TRIM + random.uniform(-60.0, 60.0, int(time[-1] / hold) + 1)[(time / hold).astype(int)]
    push = drift(*about.force, SAMPLES * FINE, STEP / FINE, random)
    h, u, n, shown = STEP / FINE, 1.5, command[0], np.empty(SAMPLES)
    for i, wanted in enumerate(command):
        shown[i] = u
        for j in range(FINE):
            turning = n if lag else wanted

            def rate(u: float, n: float = turning, push: float = push[i * FINE + j]) -> float:
                thrust = (1 - DEDUCTION) * (values["T_nabsn"] * n * abs(n) + values["T_un"] * u * n)
                drag = values["X_u"] * u + values["X_uabsu"] * u * abs(u) + values["X_u3"] * u**3 + values["X_0"]
                return (thrust + drag + push) / mass

            u += h * rate(u + h / 2 * rate(u))
            n += (wanted - n) * (1.0 - np.exp(-h / lag)) if lag else 0.0
    measured = shown + drift(*about.slow, SAMPLES, STEP, random) + NOISE * random.standard_normal(SAMPLES)
    return st.make_record(time, {"n": command, "u": measured}, CHANNELS, OWN, f"run {number}", between={"n": "held"})


def drift(sd: float, memory: float, count: int, step: float, random: np.random.Generator) -> np.ndarray:
    """Return an Ornstein-Uhlenbeck process."""
    kept, now, result = np.exp(-step / memory), sd * random.standard_normal(), np.empty(count)
    for i in range(count):
        result[i] = now
        now = kept * now + sd * np.sqrt(1 - kept**2) * random.standard_normal()
    return result


def structures(records: list[st.Record]) -> tuple[list[tuple[bool, ...]], list[Posterior]]:
    """Return all structures: which optional terms each has, and its posterior."""
    priors = ALWAYS | OPTIONAL
    model = st.load_vehicle("remus100_surge").build(free=list(priors))
    whole = st.make_posterior(model, records, priors | NUISANCES, [st.Sensor("u")])
    sets = [*product([False, True], repeat=len(OPTIONAL))]
    absent = [{name for name, is_there in zip(OPTIONAL, each, strict=True) if not is_there} for each in sets]
    return sets, [
        replace(whole, present=np.array([float(name not in none) for name in whole.names])) for none in absent
    ]


def judge(present: list[bool], records: list[st.Record], draws: int) -> dict:
    """Return the truth and the log evidences of all structures: within the model, by Laplace or importance sampling, and their gains."""
    sets, posteriors = structures(records)
    modes, near = [], None
    for one in posteriors[::-1]:  # the full one first
        mode = st.find_mode(one, key=1, starts=16 if near else 256, tries=1 if near else 3, near=near)
        near = near or mode.by_name
        modes.insert(0, mode)
    pairs, size = [*zip(posteriors, modes, strict=True)], ImportanceSettings(draws, 1024)
    full = [importance_evidence(one, jax.random.key(7), mode, size).log_value for one, mode in pairs] if draws else None
    return {
        "present": present,
        "sets": sets,
        "within": [mode.log_evidence for mode in modes],
        "full": full,
        "gain": log_evidence_gains(posteriors, modes, StatedErrors()),
    }


def probabilities(rows: list[dict], of: str = "within", with_errors: bool = True) -> np.ndarray:
    """Return the probability of each term, shape (vehicles, terms)."""
    result = []
    for row in rows:
        logs = np.array(row[of]) + (np.array(row["gain"]) if with_errors else 0.0)
        weight = np.exp(logs - logs.max())
        result.append(weight / weight.sum() @ np.array(row["sets"], float))
    return np.clip(result, 1e-6, 1 - 1e-6)


def scored(stated: np.ndarray, truth: np.ndarray) -> dict:
    """Return how well stated probabilities, shape (vehicles, terms), agree with the truth.

    The slope is that of a logistic regression of the truth on the logit of the probability, with the standard error of vehicles that are
    independent of each other; the expected log score is the entropy of the stated probabilities.
    """
    x, (intercept, slope) = logit(stated), (0.0, 0.0)
    for _ in range(50):
        p = expit(intercept + slope * x)
        design = np.stack([np.ones_like(x), x], -1)
        curvature = np.einsum("vt,vti,vtj->ij", p * (1 - p), design, design)
        each = np.einsum("vt,vti->vi", truth - p, design)
        step = np.linalg.solve(curvature, each.sum(0))
        intercept, slope = intercept + step[0], slope + step[1]
        if np.abs(step).max() < 1e-9:
            break
    inverse = np.linalg.inv(curvature)
    slope_error = float(np.sqrt((inverse @ each.T @ each @ inverse)[1, 1]))
    score = -np.where(truth, np.log(stated), np.log1p(-stated)).mean(1)
    expected = -(stated * np.log(stated) + (1 - stated) * np.log1p(-stated)).mean(1)
    places = np.digitize(stated, EDGES)
    bins = [(truth[places == i].mean(), stated[places == i].mean(), (places == i).sum()) for i in {*places.ravel()}]
    return {
        "vehicles": len(stated),
        "slope": [float(slope), slope_error],
        "score": float(score.mean()),
        "expected": float(expected.mean()),
        "difference_error": float((score - expected).std(ddof=1) / np.sqrt(len(stated))),
        "bins": [[float(true), float(said), int(count)] for true, said, count in sorted(bins, key=lambda one: one[1])],
    }


def main() -> None:
    """Simulate and judge what is not done yet, and write numbers, table and picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--full", type=int, default=10, help="vehicles with importance sampling too")
    parser.add_argument("--redraw", action="store_true", help="only write table and picture again from the numbers")
    asked = parser.parse_args()
    if not asked.redraw:
        st.configure()
        study_numbers.keep("term_probabilities", results(asked.records, asked.full))
    found = study_numbers.kept("term_probabilities")
    with own_settings():
        write_text(HERE / "dev" / "term_probabilities.svg", draw_svg(reliability_figure(found), "term-probabilities"))
    study_numbers.show("term_probabilities", tables(found))


def results(records: int, full: int) -> dict:
    """Return the scores of each arm, after what is not done yet; so many vehicles of each, and so many with importance sampling too."""
    found, apart, both = {}, [], 0
    for count, draws in ((records, 0), (full, 4096)):
        for number in range(count):
            for arm in ARMS:
                _judged(arm, number, draws)
    for arm in ARMS:
        done = _done(arm, 0)
        truth = np.array([row["present"] for row in done])
        for words, with_errors in KINDS.items():
            found[f"{arm}, {words}"] = scored(probabilities(done, with_errors=with_errors), truth)
        if again := _done(arm, 4096):
            both += len(again)
            apart.append(float(np.abs(probabilities(again, "full") - probabilities(again)).max()))
    return found | {
        "largest difference of the full route": max(apart, default=None),
        "vehicles of the full route": both,
    }


def tables(found: dict) -> str:
    """Return picture and table of the page."""
    heads = "| the model lacks | probabilities | vehicles | slope | log score | expected | "
    heads += " | ".join(["below .05", ".05 to .25", ".25 to .75", ".75 to .95", "above .95"]) + " |\n"
    rows = [_row(about.words, words, found[f"{arm}, {words}"]) for arm, about in ARMS.items() for words in KINDS]
    last = (
        f"Of {found['vehicles of the full route']} vehicles, importance sampling moves a probability by "
        f"{found['largest difference of the full route']:.2f} at most.\n"
        if found["vehicles of the full route"]
        else ""
    )
    picture = "![Share of terms that are there by stated probability](term_probabilities.svg)"
    return f"{picture}\n\n{heads}|{'---|' * 11}\n" + "\n".join(rows) + f"\n\n{last}"


def reliability_figure(found: dict) -> Figure:
    """Draw, for each arm, the share of terms that are there by the stated probability, and the 95 % bands of a binomial share."""
    width, panel, left, top, bottom = 640.0, 108.0, 34.0, 22.0, 52.0
    height, gap = panel + top + bottom, (width - left - 8 - 5 * panel) / 4
    figure = Figure(figsize=(width * POINT, height * POINT), dpi=72)
    for i, (arm, about) in enumerate(ARMS.items()):
        x = left + i * (panel + gap)
        axes = style_axes(figure.add_axes((x / width, bottom / height, panel / width, panel / height)))
        axes.plot([0, 1], [0, 1], color=MUTED, linewidth=0.8)
        for words, color, aside in zip(KINDS, (ORANGE, BLUE), (0.012, -0.012), strict=True):
            for true, said, count in found[f"{arm}, {words}"]["bins"]:
                low, high = stats.binom(count, said).ppf([0.025, 0.975]) / count
                axes.plot([said + aside] * 2, [low, high], color=color, alpha=BAND, linewidth=5, solid_capstyle="butt")
                draw_dots(axes, np.array([said + aside]), np.array([true]), color=color, size=3.0)
        axes.set_xlim(-0.04, 1.04)
        axes.set_ylim(-0.04, 1.04)
        axes.set_xticks([0, 0.5, 1], ["0", ".5", "1"])
        axes.set_yticks([0, 0.5, 1], ["0", ".5", "1"] if i == 0 else ["", "", ""])
        axes.set_title(about.words, fontsize=SMALL - 1, color=INK, pad=4, loc="left")
    figure.text(
        0.5,
        24 / height,
        "stated probability; upwards: share of terms that are there",
        fontsize=SMALL,
        color=INK,
        ha="center",
    )
    words = "blue: with every error; orange: within the model; bars: 95 % of the shares if the probability is right"
    figure.text(0.5, 8 / height, words, fontsize=SMALL, color=INK, ha="center")
    return figure


def _judged(arm: str, number: int, draws: int) -> None:
    """Judge a vehicle if that is not done yet."""
    if number == len(done := _done(arm, draws)):
        STATE.mkdir(parents=True, exist_ok=True)
        write_text(_path(arm, draws), json.dumps([*done, judge(*vehicle(arm, number), draws)]))


def _done(arm: str, draws: int) -> list[dict]:
    return json.loads(_path(arm, draws).read_text()) if _path(arm, draws).exists() else []


def _path(arm: str, draws: int) -> Path:
    return STATE / f"{arm}{'-full' if draws else ''}.json"


def _row(lacks: str, words: str, one: dict) -> str:
    """Return one line of the table; of each bin the share that is true, and how many probabilities it has."""
    slope, error = one["slope"]
    cells = [""] * (len(EDGES) + 1)
    for true, said, count in one["bins"]:
        cells[int(np.digitize(said, EDGES))] = f"{true:.2f} of {count}"
    numbers = f"{slope:.2f} ± {error:.2f} | {one['score']:.3f} | {one['expected']:.3f}"
    return f"| {lacks} | {words} | {one['vehicles']} | {numbers} | " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
