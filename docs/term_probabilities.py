"""Are the stated probabilities of terms true? `python docs/term_probabilities.py [--records N] [--full N]`, or `--redraw`.

Vehicles draw which of four terms they have, and their coefficients, from the priors of the model. A plain loop that shares no code with
seatrial simulates a few runs of each (`plain_vehicles.py`): in surge with white noise, with a slow error of the sensor, with a mass that
is not the stated one, with a force that drifts, and with a thruster that lags; in surge, sway and yaw with white noise, and with slow
errors. Of all 16 structures the evidence within the model is found, and the one with every error; the probabilities of the terms that
follow are compared with the truth. That is the fast route; some vehicles take the full one of `seatrial select` too. What is done is kept
in outputs/term_probabilities. Writes the numbers in docs/dev/term_probabilities.json, and from these the tables in
docs/dev/term_probabilities.md and docs/dev/term_probabilities.svg; `--redraw` writes only what is made from the numbers.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import plain_vehicles
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

HERE = Path(__file__).parent
STATE = HERE.parent / "outputs" / "term_probabilities"
KINDS = {"within the model": False, "with every error": True}
"""Kinds of probabilities, and whether every error is in them."""
EDGES = (0.05, 0.25, 0.75, 0.95)
"""Of the bins of stated probabilities."""
TRIM = 125.0
"""Speed of the propeller about which it is held, rad/s."""
OWN = st.Provenance("a plain loop", "")
START = {"u_0": st.Normal(1.5, 0.3)}


class Family(NamedTuple):
    """Vehicles of one kind: what they have always, and what half of them have, with the priors of which each is drawn.

    Attributes:
        always: terms of all.
        optional: terms of half of them.
        nuisances: other unknowns.
        noise: standard deviation of each sensor's white noise, SI.
        controls: units of the controls by name.
        vehicle: the model before the terms are chosen.
    """

    always: Mapping[str, st.Normal]
    optional: Mapping[str, st.Normal]
    nuisances: Mapping[str, st.Prior]
    noise: Mapping[str, float]
    controls: Mapping[str, str]
    vehicle: Callable[[], st.Vehicle]

    @property
    def channels(self) -> tuple[st.Channel, ...]:
        """What a record has."""
        measured = [st.Channel(name, "rad/s" if name == "r" else "m/s", "measurement") for name in self.noise]
        return (*(st.Channel(name, unit, "control") for name, unit in self.controls.items()), *measured)

    def draw(self, random: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
        """Draw which optional terms a vehicle has, and all its coefficients, 0 of those that it lacks."""
        present = random.random(len(self.optional)) < 0.5
        priors = {**self.always, **self.optional}
        values = {name: float(prior.mean + prior.sd * random.standard_normal()) for name, prior in priors.items()}
        return present, values | {
            name: 0.0 for name, is_there in zip(self.optional, present, strict=True) if not is_there
        }

    def posteriors(self, records: Sequence[st.Record]) -> tuple[list[tuple[bool, ...]], list[Posterior]]:
        """Return all structures: which optional terms each has, and its posterior."""
        priors = {**self.always, **self.optional}
        model = self.vehicle().build(free=list(priors))
        whole = st.make_posterior(model, records, priors | {**self.nuisances}, [st.Sensor(one) for one in self.noise])
        sets = [*product([False, True], repeat=len(self.optional))]
        return sets, masked(whole, [*self.optional], sets)


def masked(whole: Posterior, optional: Sequence[str], sets: Sequence[Sequence[bool]]) -> list[Posterior]:
    """Return the posterior of each structure: that of all terms without the optional ones that the structure lacks."""
    absent = [{name for name, is_there in zip(optional, one, strict=True) if not is_there} for one in sets]
    return [replace(whole, present=np.array([float(name not in none) for name in whole.names])) for none in absent]


SURGE = Family(
    {"X_uabsu": st.Normal(-2.93, 0.5), "T_nabsn": st.Normal(6.28e-4, 6e-5)},
    {
        "X_u": st.Normal(-1.2, 0.6),
        "X_u3": st.Normal(-0.5, 0.3),
        "T_un": st.Normal(-0.01, 0.006),
        "X_0": st.Normal(0.0, 0.7),
    },
    {"sigma_u": st.LogUniform(0.002, 0.5), **START},
    {"u": 0.02},
    {"n": "rad/s"},
    lambda: st.load_vehicle("remus100_surge"),
)
THREE_AXES = Family(
    {
        "X_uabsu": st.Normal(-2.9, 0.4),
        "T_nabsn": st.Normal(6.3e-4, 5e-5),
        "Y_uv": st.Normal(-60.0, 8.0),
        "Y_uudelta_r": st.Normal(12.0, 2.0),
        "N_uv": st.Normal(-10.0, 2.0),
        "N_ur": st.Normal(-12.0, 2.0),
        "N_uudelta_r": st.Normal(-8.0, 1.0),
    },
    {
        "X_vr": st.Normal(6.0, 4.0),
        "Y_ur": st.Normal(8.0, 4.0),
        "Y_vabsv": st.Normal(-60.0, 40.0),
        "N_rabsr": st.Normal(-6.0, 4.0),
    },
    {
        "sigma_u": st.LogUniform(0.003, 0.5),
        "sigma_v": st.LogUniform(0.003, 0.5),
        "sigma_r": st.LogUniform(0.002, 0.3),
        **START,
        "v_0": st.Normal(0.0, 0.05),
        "r_0": st.Normal(0.0, 0.05),
    },
    {"u": 0.03, "v": 0.03, "r": 0.02},
    {"n": "rad/s", "delta_r": "rad"},
    lambda: st.make_vehicle(
        "three axes",
        plain_vehicles.MASS,
        plain_vehicles.ADDED,
        inertia=(None, None, plain_vehicles.INERTIA),
        centre_of_gravity=(plain_vehicles.CENTRE, 0.0, 0.0),
        thrust_deduction=plain_vehicles.DEDUCTION,
        moves=("u", "v", "r"),
    ),
)


class Arm(NamedTuple):
    """What is wrong with the model: sizes of each vehicle's error, none where 0.

    Attributes:
        words: in the table.
        family: of the vehicles.
        slow: standard deviation of a slow error of each sensor, over that of its white noise, and its memory, s.
        mass: error of the stated mass, as a share, to either side.
        force: standard deviation of a force that drifts, N, and its memory, s.
        lag: of the thruster, s, from and to.
    """

    words: str
    family: Family = SURGE
    slow: tuple[float, float] = (0.0, 1.0)
    mass: float = 0.0
    force: tuple[float, float] = (0.0, 1.0)
    lag: tuple[float, float] = (0.0, 0.0)


ARMS = {
    "A": Arm("nothing: white noise"),
    "B": Arm("a slow error of the sensor", slow=(1.5, 5.0)),
    "C": Arm("a mass 5 % off", mass=0.05),
    "D": Arm("a force that drifts", force=(0.5, 5.0)),
    "E": Arm("a thruster that lags", lag=(0.3, 1.0)),
    "F": Arm("three axes: white noise", THREE_AXES),
    "G": Arm("three axes: slow errors", THREE_AXES, slow=(1.5, 5.0)),
}
CHECKED = ("A", "B", "F")
"""Arms of which a few vehicles are compared by the full route."""


def vehicle(about: Arm, seed: str, number: int) -> tuple[list[bool], list[st.Record]]:
    """Return which of the optional terms a vehicle has, and its runs."""
    random = np.random.default_rng([ord(seed), number])
    present, values = about.family.draw(random)
    run = turning_runs if "r" in about.family.noise else surge_runs
    return present.tolist(), run(about, values, random)


def surge_runs(about: Arm, values: Mapping[str, float], random: np.random.Generator) -> list[st.Record]:
    """Return three runs of 40 s in surge, sampled at 10 Hz."""
    step, samples, fine = 0.1, 400, 5
    mass = plain_vehicles.SURGE_MASS * (1.0 + about.mass * random.choice([-1.0, 1.0]))
    lag, records = random.uniform(*about.lag), []
    for number, hold in enumerate((3.0, 5.0, 8.0)):
        n = held(TRIM, 60.0, hold, samples, step, random)
        push = plain_vehicles.drift(*about.force, samples * fine, step / fine, random)
        u = plain_vehicles.surge(values, n, step, mass=mass, lag=lag, push=push, fine=fine)
        records.append(measured(about, {"n": n}, u[:, None], step, random, number))
    return records


def turning_runs(about: Arm, values: Mapping[str, float], random: np.random.Generator) -> list[st.Record]:
    """Return two runs of 40 s with propeller and rudder, sampled at 5 Hz."""
    step, samples, records = 0.2, 200, []
    for number, hold in enumerate((4.0, 7.0)):
        n = held(TRIM, 60.0, 2.0 * hold, samples, step, random)
        rudder = held(0.0, 0.23, hold, samples, step, random)
        motion = plain_vehicles.three_axes(values, n, rudder, step)
        records.append(measured(about, {"n": n, "delta_r": rudder}, motion, step, random, number))
    return records


def held(
    centre: float, reach: float, hold: float, samples: int, step: float, random: np.random.Generator
) -> np.ndarray:
    """Return a control that is drawn anew after each `hold` seconds."""
    time = np.arange(samples) * step
    return centre + random.uniform(-reach, reach, int(time[-1] / hold) + 1)[(time / hold).astype(int)]


def measured(
    about: Arm,
    controls: dict[str, np.ndarray],
    motion: np.ndarray,
    step: float,
    random: np.random.Generator,
    number: int,
) -> st.Record:
    """Return a run with the errors of its sensors."""
    shown, (ratio, memory) = {}, about.slow
    for true, (name, noise) in zip(motion.T, about.family.noise.items(), strict=True):
        slow = plain_vehicles.drift(ratio * noise, memory, true.size, step, random)
        shown[name] = true + slow + noise * random.standard_normal(true.size)
    time, between = np.arange(len(motion)) * step, dict.fromkeys(controls, "held")
    return st.make_record(time, controls | shown, about.family.channels, OWN, f"run {number}", between=between)


def judge(family: Family, present: list[bool], records: list[st.Record]) -> dict:
    """Return the truth and the log evidences of all structures by the fast route: within the model, by Laplace, and their gains."""
    sets, posteriors = family.posteriors(records)
    modes, near = [], None
    for one in posteriors[::-1]:  # the full one first
        mode = st.find_mode(one, key=1, starts=16 if near else 256, tries=1 if near else 3, near=near)
        near = near or mode.by_name
        modes.insert(0, mode)
    return {
        "present": present,
        "sets": sets,
        "within": [mode.log_evidence for mode in modes],
        "gain": log_evidence_gains(posteriors, modes, StatedErrors()),
    }


def compared(family: Family, present: list[bool], records: list[st.Record]) -> dict:
    """Return the same by the full route: importance sampling, and tempered SMC where a decision needs it, as `seatrial select` does."""
    sets, posteriors = family.posteriors(records)
    found = st.compare({str(i): one for i, one in enumerate(posteriors)}).evidences
    return {
        "present": present,
        "sets": sets,
        "within": [one.log_value for one in found],
        "gain": [one.weighed - one.log_value for one in found],
        "checked": sum("smc" in one.diagnostics["methods"] for one in found),
    }


def probabilities(rows: list[dict], with_errors: bool = True) -> np.ndarray:
    """Return the probability of each term, shape (vehicles, terms)."""
    result = []
    for row in rows:
        logs = np.array(row["within"]) + (np.array(row["gain"]) if with_errors else 0.0)
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
    parser.add_argument("--records", type=int, default=400)
    parser.add_argument("--full", type=int, default=7, help="vehicles of some arms that take the full route too")
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
    """Return the scores of each arm, after what is not done yet; so many vehicles of each, and so many of some by the full route too."""
    for number in range(records):
        for arm in ARMS:
            _judge_next(arm, number, judge, _path(arm))
    for number in range(full):
        for arm in CHECKED:
            _judge_next(arm, number, compared, _path(arm, "-full"))
    found, routes = {}, {}
    for arm in ARMS:
        if not (done := _done(_path(arm))):
            continue
        truth = np.array([row["present"] for row in done])
        for words, with_errors in KINDS.items():
            found[f"{arm}, {words}"] = scored(probabilities(done, with_errors), truth)
        if again := _done(_path(arm, "-full")):
            apart = np.abs(probabilities(again) - probabilities(done[: len(again)]))
            routes[arm] = {
                "vehicles": len(again),
                "largest": float(apart.max()),
                "mean": float(apart.mean()),
                "checked": sum(row["checked"] > 0 for row in again),
            }
    outside = {words: _outside(found, words) for words in KINDS}
    return found | {"outside": outside, "full route": routes}


def tables(found: dict) -> str:
    """Return picture and tables of the page."""
    bins = ["below .05", ".05 to .25", ".25 to .75", ".75 to .95", "above .95"]
    heads = ["the model lacks", "probabilities", "vehicles", "slope", "log score", "less expected", *bins]
    rows = [
        _row(about.words, words, found[f"{arm}, {words}"]) for arm, about in _arms(found).items() for words in KINDS
    ]
    text = "![Share of terms that are present, by stated probability](term_probabilities.svg)\n\n"
    text += " ".join(
        f"Shares outside their bars {words}: {out} of {count}." for words, (out, count) in found["outside"].items()
    )
    text += f"\n\n{_table(heads, rows)}\nComparison of the full route with the fast one, with every error:\n\n"
    heads = ["the model lacks", "vehicles", "checked by tempered SMC"]
    heads += ["largest difference of a probability", "mean difference"]
    return text + _table(
        heads,
        [
            [
                ARMS[arm].words,
                f"{one['vehicles']}",
                f"{one['checked']}",
                f"{one['largest']:.3f}",
                f"{one['mean']:.4f}",
            ]
            for arm, one in found["full route"].items()
        ],
    )


def reliability_figure(found: dict, columns: int = 4) -> Figure:
    """Draw, for each arm, the share of terms that are there by the stated probability, and the 95 % bands of a binomial share."""
    width, left, top, bottom, gap = 640.0, 34.0, 24.0, 24.0, 20.0
    panel, rows = (width - left - 8 - (columns - 1) * gap) / columns, -(-len(_arms(found)) // columns)
    height = rows * (panel + top + bottom) + 46.0
    figure = Figure(figsize=(width * POINT, height * POINT), dpi=72)
    for i, (arm, about) in enumerate(_arms(found).items()):
        x = left + i % columns * (panel + gap)
        y = height - (i // columns + 1) * (panel + top + bottom) + bottom
        axes = style_axes(figure.add_axes((x / width, y / height, panel / width, panel / height)))
        axes.plot([0, 1], [0, 1], color=MUTED, linewidth=0.8)
        for words, color, aside in zip(KINDS, (ORANGE, BLUE), (0.012, -0.012), strict=True):
            for true, said, count in found[f"{arm}, {words}"]["bins"]:
                low, high = band(said, count)
                axes.plot([said + aside] * 2, [low, high], color=color, alpha=BAND, linewidth=5, solid_capstyle="butt")
                draw_dots(axes, np.array([said + aside]), np.array([true]), color=color, size=3.0)
        axes.set_xlim(-0.04, 1.04)
        axes.set_ylim(-0.04, 1.04)
        axes.set_xticks([0, 0.5, 1], ["0", ".5", "1"])
        axes.set_yticks([0, 0.5, 1], ["0", ".5", "1"] if i % columns == 0 else ["", "", ""])
        axes.set_title(about.words, fontsize=SMALL, color=INK, pad=4, loc="left")
    words = "stated probability; upwards: share of terms that are there"
    figure.text(0.5, 26 / height, words, fontsize=SMALL, color=INK, ha="center")
    words = "blue: with every error; orange: within the model; bars: 95 % of the shares if the probability is right"
    figure.text(0.5, 9 / height, words, fontsize=SMALL, color=INK, ha="center")
    return figure


def band(said: float, count: int) -> tuple[float, float]:
    """Return between which shares 95 % of those of so many independent terms lie if the stated probability is right."""
    low, high = stats.binom(count, said).ppf([0.025, 0.975]) / count
    return float(low), float(high)


def _arms(found: dict) -> dict[str, Arm]:
    """Return the arms of which vehicles were judged."""
    return {arm: about for arm, about in ARMS.items() if f"{arm}, {next(iter(KINDS))}" in found}


def _outside(found: dict, words: str) -> tuple[int, int]:
    """Return how many shares lie outside their bars, and how many there are."""
    bins = [one for arm in _arms(found) for one in found[f"{arm}, {words}"]["bins"]]
    inside = [low <= true <= high for true, said, count in bins for low, high in [band(said, count)]]
    return inside.count(False), len(inside)


def _judge_next(
    arm: str, number: int, route: Callable[[Family, list[bool], list[st.Record]], dict], path: Path
) -> None:
    """Judge a vehicle if that is not done yet."""
    if number == len(done := _done(path)):
        STATE.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps([*done, route(ARMS[arm].family, *vehicle(ARMS[arm], arm, number))]))


def _done(path: Path) -> list[dict]:
    return json.loads(path.read_text()) if path.exists() else []


def _path(arm: str, route: str = "") -> Path:
    return STATE / f"{arm}{route}.json"


def _row(lacks: str, words: str, one: dict) -> list[str]:
    """Return one line of the table; of each bin the share that is true, and how many probabilities it has."""
    slope, error = one["slope"]
    cells = [""] * (len(EDGES) + 1)
    for true, said, count in one["bins"]:
        cells[int(np.digitize(said, EDGES))] = f"{true:.2f} of {count}"
    numbers = f"{one['vehicles']}", f"{slope:.2f} ± {error:.2f}", f"{one['score']:.3f}"
    excess = f"{one['score'] - one['expected']:.3f} ± {one['difference_error']:.3f}"
    return [lacks, words, *numbers, excess, *cells]


def _table(heads: list[str], rows: list[list[str]]) -> str:
    """Return a table of Markdown."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (heads, *rows)]
    return "\n".join([lines[0], f"|{'---|' * len(heads)}", *lines[1:]]) + "\n"


if __name__ == "__main__":
    main()
