"""Two configurations fitted together: `python docs/configurations.py [--pairs N]`, or `--redraw`.

A frame of one vertical axis has common drag and another net weight with its payload. Drag and net weights are drawn from the priors; a
plain loop simulates a record of each configuration, with white noise. Each pair is fitted three times by the posterior mode and its normal
approximation: each record alone, both together, and both as if they were one configuration. Writes docs/dev/configurations.json and the
table in docs/dev/configurations.md; a few minutes of one core.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import study_numbers
from scipy import stats

import seatrial as st
from seatrial.core.files import write_text

STATE = Path(__file__).parents[1] / "outputs" / "configurations.json"
MASS, ADDED, NOISE, STEP, SAMPLES, HOLD, FINE = 13.5, 18.68, 0.01, 0.1, 200, 15, 10
"""kg; added mass of heave, kg; noise of the speed, m/s; interval, s; samples; samples of a command; steps from sample to sample."""
MODEL = st.load_vehicle("bluerov2_heavy").build(moves=["w"], free=["Z_w", "Z_wabsw"], unknowns=("net_weight",))
CONFIGURATIONS = ("empty", "loaded")
COMMON = {"Z_w": st.Normal(-33.0, 10.0), "Z_wabsw": st.Normal(-190.0, 60.0)}
PRIORS = {**COMMON, "net_weight": st.Normal(3.0, 4.0), "sigma_w": st.LogUniform(0.003, 0.03)}
WAYS = {"alone": "each alone", "together": "together", "pooled": "as one configuration"}


def heave(drag: float, square: float, weight: float, push: np.ndarray) -> np.ndarray:
    """Return the downward speed at the samples, m/s, by midpoint steps of a plain loop.

    Args:
        drag: Z_w, kg/s.
        square: Z_wabsw, kg/m.
        weight: weight less buoyancy, N.
        push: downward force from each sample to the next, N.
    """
    h, w, shown = STEP / FINE, 0.0, np.empty(push.size)
    for i, force in enumerate(push):
        shown[i] = w
        for _ in range(FINE):
            half = w + h / 2 * (drag * w + square * w * abs(w) + weight + force) / (MASS + ADDED)
            w += h * (drag * half + square * half * abs(half) + weight + force) / (MASS + ADDED)
    return shown


def pair(number: int) -> tuple[dict[str, float], list[st.Record]]:
    """Return the true values of a pair, and its two records."""
    random = np.random.default_rng(number)
    truth = {name: float(prior.mean + prior.sd * random.standard_normal()) for name, prior in COMMON.items()}
    records = []
    for configuration in CONFIGURATIONS:
        prior = PRIORS["net_weight"]
        weight = truth[f"net_weight@{configuration}"] = float(prior.mean + prior.sd * random.standard_normal())
        command = np.repeat(random.uniform(-6.0, 6.0, -(-SAMPLES // HOLD)), HOLD)[:SAMPLES]
        speed = heave(truth["Z_w"], truth["Z_wabsw"], weight, -len(MODEL.controls) * command)
        columns = {"t": STEP * np.arange(SAMPLES), "w": speed + NOISE * random.standard_normal(SAMPLES)}
        columns |= dict.fromkeys(MODEL.controls, command)
        units = {name: (name, "m/s" if name == "w" else "N") for name in columns if name != "t"}
        record = st.record(columns, commanded=MODEL.controls, label=configuration, **units)
        records.append(record.in_configuration(configuration))
    return truth, records


def fit(records: list[st.Record], truth: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Return value and standard deviation of each parameter at the mode, which is followed from near the truth."""
    posterior = st.make_posterior(MODEL, records, PRIORS, ["w"], start={"w": 0.0})
    near = {name: value for name, value in truth.items() if name in posterior.names}
    mode = st.find_mode(posterior, key=1, starts=16, tries=1, near=near)
    return dict(zip(mode.names, zip(map(float, mode.values), map(float, mode.sd), strict=True), strict=True))


def judge(number: int) -> dict[str, dict[str, list[float]]]:
    """Return of each common coefficient, by way of fitting, its errors in standard deviations and these deviations."""
    truth, records = pair(number)
    plain = [replace(record, configuration="") for record in records]
    by_way = {
        "alone": [fit([record], truth) for record in plain],
        "together": [fit(records, truth)],
        "pooled": [fit(plain, truth)],
    }
    return {
        name: {
            way: [x for one in fits for x in ((one[name][0] - truth[name]) / one[name][1], one[name][1])]
            for way, fits in by_way.items()
        }
        for name in COMMON
    }


def counted(rows: list[dict]) -> dict:
    """Return coverage of 90 % intervals by way of fitting, and how much narrower they are together."""
    result: dict = {"pairs": len(rows)}
    for name in COMMON:
        errors = {way: np.array([row[name][way][::2] for row in rows]).ravel() for way in WAYS}
        alone = np.array([row[name]["alone"][1::2] for row in rows])
        ratio = np.array([row[name]["together"][1] for row in rows]) / alone.min(1)
        result[name] = {
            "inside": {way: [int((np.abs(one) < stats.norm.ppf(0.95)).sum()), one.size] for way, one in errors.items()},
            "narrower": int((ratio < 1).sum()),
            "ratio": [float(one) for one in np.quantile(ratio, [0.5, 0.05, 0.95])],
        }
    return result


def band(count: int) -> tuple[int, int]:
    """Return the central 95 % range of how many of so many 90 % intervals hold the truth."""
    low, high = stats.binom.interval(0.95, count, 0.9)
    return int(low), int(high)


def tables(found: dict) -> str:
    """Return the table of the page."""
    text = "| coefficient | narrower than either alone | ratio of the ± to the better alone |"
    text += "".join(f" inside 90 %, {words} |" for words in WAYS.values()) + "\n|---|---|---|---|---|---|\n"
    for name in COMMON:
        one = found[name]
        text += f"| `{name}` | {one['narrower']} of {found['pairs']} | {{:.2f}} ({{:.2f}} to {{:.2f}}) |".format(
            *one["ratio"]
        )
        for count, size in one["inside"].values():
            low, high = band(size)
            text += f" {count} of {size} (expected {low} to {high}) |"
        text += "\n"
    return text


def main() -> None:
    """Simulate and fit, and write numbers and table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=150)
    parser.add_argument("--redraw", action="store_true", help="only write the table again from the numbers")
    asked = parser.parse_args()
    if not asked.redraw:
        st.configure()
        study_numbers.commit()
        rows = json.loads(STATE.read_text()) if STATE.exists() else []
        while len(rows) < asked.pairs:
            rows.append(judge(len(rows)))
            STATE.parent.mkdir(parents=True, exist_ok=True)
            write_text(STATE, json.dumps(rows))
        study_numbers.keep("configurations", counted(rows))
    study_numbers.show("configurations", tables(study_numbers.kept("configurations")))


if __name__ == "__main__":
    main()
