"""Whether the ± and the stated bands hold for vehicles that the model does not contain.

`python docs/held_back.py coefficients` counts how often the ± contains the true coefficients, and `... bands` how often the bands hold
on new runs. Vehicles with a late thruster, a backlash, waves, a drifting current, a dead zone, drag of other powers, another mass than
stated, and more, are simulated by a plain loop that shares no code with seatrial. Three runs of each are fitted by a model that lacks the
effect. For the bands three new ones are predicted, the verdict is read, and what it claims is checked on further runs, which neither the
fit nor the verdict has seen. About a second for each vehicle; what is done is kept in outputs/held_back. Writes the numbers in
docs/dev/held_back_coefficients.json or docs/dev/held_back_bands.json, and from these the tables in docs/dev/held_back.md; of the
coefficients one for effects in the list of those tried, and one for the others.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import jax
import numpy as np
import study_numbers

import seatrial as st
from seatrial.core.files import write_text
from seatrial.estimation.diagnostics.error_budget import EXACT, error_budget
from seatrial.estimation.diagnostics.error_sources import StatedErrors
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior, values_of
from seatrial.estimation.prediction.fit_verdict import judge_runs
from seatrial.estimation.prediction.prediction import Prediction
from seatrial.sampling.run import Draws
from seatrial.selection.importance import ImportanceSettings, importance_sample

HERE = Path(__file__).parent
COMMAND = "python docs/held_back.py"
STATE = HERE.parent / "outputs" / "held_back"
SAVED_EVERY = 10
"""Vehicles after which what is done is kept."""
FITTED, JUDGED = 3, 3
"""Runs that are fitted, and that the verdict is about."""
DRAWS = 200
"""Draws of the posterior by which a run is predicted."""
SIZE = ImportanceSettings(draws=1024, pilot=512, refits=1)
"""Weighted draws of which these are taken."""
STEP, FINE = 0.1, 5
"""Interval of the samples, s; steps of the simulation in one interval."""
NOISE, MASS, DEDUCTION = 0.02, 31.41, 0.1
"""Standard deviation of the speed sensor, m/s; effective mass, kg; share of the thrust that the hull takes."""
TRIM = 125.0
"""Speed of the propeller about which it is moved, rad/s."""
LEVEL, MARGIN = 0.9, 0.05
"""Share of the samples that a band has to hold, and by how much it may be off."""
CHANNELS = (st.Channel("n", "rad/s", "control"), st.Channel("u", "m/s", "measurement"))
OWN = st.Provenance("a plain loop", "")
TRUE = {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4}
"""Coefficients about which those of the vehicles are drawn, by a tenth of each, SI."""


@dataclass(frozen=True)
class Kind:
    """What vehicles of one kind have and the model lacks; each array has one value for each vehicle.

    Attributes:
        words: in the table.
        size: largest size of the effect; each vehicle's own is drawn between `least` of it and all of it.
        of: what the size is: the time constant of the thruster, s; the standard deviation of a current, m/s, with a memory of 40 s; half
            the backlash of the propeller, rad/s; the error of the mass or of the sensor's scale, a share with either sign.
        thrust: speed of the propeller and own size of the effect, to the speed that gives the thrust.
        inflow: the vehicle's speed and own size, to the share of the thrust that is left.
        force: time, vehicle's speed, own size and phase, to a further force, N.
        least: smallest size, a share of the largest.
        duration: of each run, s.
        further: runs on which the verdict is checked: as many as tell a share of 90 % to a few per cent.
        share: of the vehicles that are asked for.
        is_tried: whether the effect is in the list of those over which the ± averages.
        is_seen: whether the residuals show it; else only stated errors cover it.
    """

    words: str
    size: float
    of: Literal["", "lag", "current", "backlash", "mass", "scale"] = ""
    thrust: Callable = lambda n, size: n
    inflow: Callable = lambda u, size: 1.0
    force: Callable = lambda t, u, size, phase: 0.0
    least: float = 1 / 3
    duration: float = 60.0
    further: int = 10
    share: float = 1.0
    is_tried: bool = False
    is_seen: bool = True


KINDS = {
    "nothing": Kind("nothing", 0.0, is_tried=True),
    "lag": Kind("a thruster that lags", 2.0, of="lag", is_tried=True),
    "waves": Kind("waves of 7 s", 3.0, force=lambda t, u, size, phase: size * np.sin(2 * np.pi * t / 7.0 + phase)),
    "current": Kind("a current that drifts", 0.15, of="current", further=60),
    "current, long runs": Kind(
        "a current that drifts, runs of 5 min", 0.15, of="current", duration=300.0, further=30, share=0.3
    ),
    "dead zone": Kind("a dead zone", 90.0, thrust=lambda n, size: np.where(np.abs(n) < size, 0.0, n)),
    "cubic": Kind("cubic drag", 2.0, force=lambda t, u, size, phase: -size * u**3, is_tried=True),
    "mass": Kind("mass off by 2 to 7 %", 0.07, of="mass", least=2 / 7, is_seen=False),
    "scale": Kind("sensor's scale off by 1 to 3 %", 0.03, of="scale", is_seen=False),
    "inflow": Kind(
        "thrust falls with the inflow", 0.3, inflow=lambda u, size: 1 - size * (u / 1.5) * (1 - u / 3.0), is_seen=False
    ),
    "power": Kind(
        "drag as u^1.5", 2.0, force=lambda t, u, size, phase: -size * np.abs(u) ** 1.5, least=1 / 4, is_seen=False
    ),
    "sway": Kind(
        "coupled with sway",
        0.5,
        force=lambda t, u, size, phase: -12.0 * (size * np.sin(2 * np.pi * t / 20.0 + phase)) ** 2,
        least=0.4,
        is_seen=False,
    ),
    "backlash": Kind("backlash of the thruster", 15.0, of="backlash", is_tried=True),
}
ERRORS = {
    "white": {"sigma_u": st.LogUniform(0.002, 0.5), "u_0": st.Normal(1.5, 0.3)},
    "coloured": {"sigma_u": st.LogUniform(0.002, 0.5), "tau_u": st.LogUniform(0.05, 30.0), "u_0": st.Normal(1.5, 0.3)},
    "drifting": {
        "sigma_u": st.LogUniform(0.002, 0.5),
        "drift_u": st.LogUniform(0.0001, 0.5),
        "drift_time_u": st.LogUniform(0.1, 180.0),
        "u_0": st.Normal(1.5, 0.3),
    },
}
"""Models of the error, by what they add to the priors."""
DRIFT = 40.0
"""Memory of the current, s."""


BAND_ERRORS = ("white", "drifting")
"""Models of the error with which bands are judged."""
BANDS = ("nothing", "lag", "waves", "current", "current, long runs", "dead zone", "cubic")
"""Kinds of which the bands are judged."""
PRIORS = {"X_u": st.Normal(-1.2, 1.5), "X_uabsu": st.Normal(-3.0, 3.0), "T_nabsn": st.Normal(6e-4, 3e-4)}
STATED = {"exact": EXACT, "default": StatedErrors()}
"""What is stated of errors that no residual shows."""


def main() -> None:
    """Simulate, fit and predict what is not done yet, and write a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", choices=["coefficients", "bands"])
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--kinds", nargs="*")
    parser.add_argument("--errors", nargs="*", default=[*BAND_ERRORS])
    asked = parser.parse_args()
    st.configure()
    study_numbers.commit()
    is_bands, numbers = asked.table == "bands", {}
    kinds = asked.kinds or [*(BANDS if is_bands else KINDS)]
    for kind in kinds:
        count = round(asked.vehicles * KINDS[kind].share)
        for error in asked.errors if is_bands else ["white"]:
            path = STATE / f"{asked.table}-{kind}-{error}-{count}.json"
            found = json.loads(path.read_text()) if path.exists() else []
            runs = FITTED + (JUDGED + KINDS[kind].further) * is_bands
            for number, trial in enumerate(vehicles(kind, count, runs)):
                if number >= len(found):
                    found.append(judged(*trial, error) if is_bands else covered(*trial))
                    if len(found) in (count, *range(0, count, SAVED_EVERY)):
                        path.parent.mkdir(parents=True, exist_ok=True)
                        write_text(path, json.dumps(found))
            if is_bands:
                numbers[f"{kind}, {error}"] = band_numbers(found)
                print(band_row(kind, error, numbers), end="", flush=True)
            else:
                numbers[kind] = coefficient_numbers(found)
                print(coefficient_row(kind, numbers), end="", flush=True)
    if not asked.kinds and asked.errors == [*BAND_ERRORS]:
        numbers["ranges"] = band_ranges(numbers) if is_bands else coefficient_ranges(numbers)
        study_numbers.keep(f"held_back_{asked.table}", numbers)
        study_numbers.show("held_back", tables(asked.table, numbers), f"{COMMAND} {asked.table}")


def vehicles(kind: str, count: int, number_of_runs: int) -> Iterator[tuple[dict[str, float], list[st.Record]]]:
    """Yield the true coefficients and the runs of each vehicle."""
    random = np.random.default_rng(hash_of(kind))
    about = KINDS[kind]
    truth = {name: value * (1 + 0.1 * random.standard_normal(count)) for name, value in TRUE.items()}
    size = about.size * random.uniform(about.least, 1, count)
    if about.of in ("mass", "scale"):
        size *= random.choice([-1, 1], count)
    time = np.arange(0.0, about.duration, STEP)
    runs = []
    for number in range(number_of_runs):
        command = TRIM + excitation(number, time)
        shown = simulated(about, truth, size, time, command, random)
        shown += NOISE * random.standard_normal(shown.shape)
        runs.append((command, shown))
    for vehicle in range(count):
        records = [
            st.make_record(
                time, {"n": command, "u": shown[:, vehicle]}, CHANNELS, OWN, f"run {number}", between={"n": "held"}
            )
            for number, (command, shown) in enumerate(runs)
        ]
        yield {name: float(value[vehicle]) for name, value in truth.items()}, records


def hash_of(kind: str) -> int:
    """Return a number of a kind that is the same in every process."""
    return int.from_bytes(kind.encode(), "little") % 2**32


def excitation(number: int, time: np.ndarray) -> np.ndarray:
    """Return the change of the propeller's speed in one run, rad/s: steps of another length and seed in each, 60 at most."""
    random = np.random.default_rng(number)
    hold = (3.0, 5.0, 8.0, 4.0, 6.0, 10.0)[number % 6]
    levels = random.uniform(-60.0, 60.0, int(time[-1] / hold) + 1)
    return levels[(time / hold).astype(int)]


def simulated(
    kind: Kind,
    truth: dict[str, np.ndarray],
    size: np.ndarray,
    time: np.ndarray,
    command: np.ndarray,
    random: np.random.Generator,
) -> np.ndarray:
    """Return the measured speed over ground of all vehicles without the sensor's noise, by midpoint steps, shape (n, vehicles)."""
    h, count = STEP / FINE, size.size
    current = size * random.standard_normal(count) if kind.of == "current" else np.zeros(count)
    phase = random.uniform(0, 2 * np.pi, count)
    mass = MASS * (1 + size * (kind.of == "mass"))
    scale = 1 + size * (kind.of == "scale")
    slack = size * (kind.of == "backlash")
    n = np.full(count, command[0])
    u = np.full(count, 1.5)
    shown = np.empty((time.size, count))
    for i, (t, wanted) in enumerate(zip(time, command, strict=True)):
        shown[i] = (u + current) * scale
        for j in range(FINE):
            if kind.of != "lag":
                n = np.clip(n, wanted - slack, wanted + slack)
            acting = kind.thrust(n, size)
            thrust = (1 - DEDUCTION) * truth["T_nabsn"] * acting * np.abs(acting)

            def rate(at: float, u: np.ndarray, thrust: np.ndarray = thrust) -> np.ndarray:
                drag = truth["X_u"] * u + truth["X_uabsu"] * u * np.abs(u)
                return (thrust * kind.inflow(u, size) + drag + kind.force(at, u, size, phase)) / mass

            at = t + j * h
            u = u + h * rate(at + h / 2, u + h / 2 * rate(at, u))
            if kind.of == "lag":
                n = n + h * (wanted - n) / size
            if kind.of == "current":
                current = current + h * -current / DRIFT + size * np.sqrt(2 * h / DRIFT) * random.standard_normal(count)
    return shown


def posterior_of(records: list[st.Record], error: str) -> Posterior:
    """Return the posterior of runs, by a model that lacks the effect."""
    model = st.load_vehicle("remus100_surge").build(free=list(PRIORS))
    added = ERRORS[error]
    kind = "drifting" if "drift_u" in added else "coloured" if "tau_u" in added else "white"
    return st.make_posterior(model, records, PRIORS | added, [st.Sensor("u", kind)])


def covered(truth: dict[str, float], records: list[st.Record]) -> dict:
    """Fit runs, and return how far the coefficients are off and how wide the ± with all errors is, over the one of the model."""
    posterior = posterior_of(records, "white")
    mode = st.find_mode(posterior, key=1)
    own = [mode.names.index(name) for name in truth]
    found = {"off": [float((mode.values[i] - truth[mode.names[i]]) / mode.sd[i]) for i in own]}
    for words, stated in STATED.items():
        budget = error_budget(posterior, mode, stated)
        found[words] = [float(budget.ratio[budget.names.index(name)]) for name in truth]
    return found


def judged(truth: dict[str, float], records: list[st.Record], error: str) -> dict:
    """Fit some runs, judge the bands by others, and return the verdict, whether it is so, and which coefficients are covered."""
    fitted, new, further = records[:FITTED], records[FITTED : FITTED + JUDGED], records[FITTED + JUDGED :]
    posterior = posterior_of(fitted, error)
    draws = drawn(posterior, st.find_mode(posterior, key=1))
    found = judge_runs([predicted(posterior, draws, record).run("u") for record in new], "u")
    beyond = [predicted(posterior, draws, record) for record in further]
    beyond = np.abs(np.concatenate([(one.measured - one.mean)[:, 0] / one.sd[:, 0] for one in beyond]))
    held = {"as stated": 1.0, "widened": found.widen, "widened most": found.widen_upper}
    columns = {name: draws.array([name])[:, 0] for name in truth}
    return {
        "inside": {words: float(np.mean(beyond < 1.6449 * factor)) for words, factor in held.items()},
        "level": found.level,
        "effective": found.effective,
        "covered": [bool(abs(x.mean() - truth[name]) < 1.6449 * x.std()) for name, x in columns.items()],
    }


def predicted(posterior: Posterior, draws: Draws, record: st.Record) -> Prediction:
    """Return one run as it is predicted."""
    return st.predict(posterior, draws, record, n=DRAWS, key=2)


def drawn(posterior: Posterior, mode: Mode) -> Draws:
    """Return draws of the posterior: weighted ones about its mode, each taken as often as its weight says."""
    weighted = importance_sample(posterior, jax.random.key(3), mode, SIZE)
    edges = np.cumsum(np.exp(weighted.smoothed))
    places = np.searchsorted(edges / edges[-1], (np.arange(DRAWS) + 0.5) / DRAWS)
    z = weighted.z[np.random.default_rng(3).permutation(places)]
    values = np.asarray(values_of(posterior, z))
    return Draws(z[None], np.zeros((1, DRAWS)), 1.0, 0, mode.names, mode.units, values[None])


def coefficient_numbers(found: list[dict]) -> dict:
    """Return shares of coefficients inside the ± of the model and inside the one ±, all and each, and its width over the model's."""
    off = np.abs([one["off"] for one in found]) / 1.6449
    numbers = {"vehicles": len(found), "model": float(np.mean(off < 1))}
    for stated in STATED:
        ratio = np.array([one[stated] for one in found])
        numbers[stated] = {
            "covers": float(np.mean(off < ratio)),
            "each covers": np.mean(off < ratio, 0).tolist(),
            "width": float(np.median(ratio)),
            "each width": np.median(ratio, 0).tolist(),
        }
    return numbers


def coefficient_ranges(found: dict) -> dict[str, list[float]]:
    """Return the least and the largest share over the kinds of effect, by what the residuals show, and of each coefficient."""
    wrong = [kind for kind in KINDS if kind != "nothing"]
    exact, default = ({kind: found[kind][stated] for kind in wrong} for stated in STATED)
    shares = {
        "model": [found[kind]["model"] for kind in wrong],
        "exact, residuals show it": [exact[kind]["covers"] for kind in wrong if KINDS[kind].is_seen],
        "exact, residuals hardly show it": [exact[kind]["covers"] for kind in wrong if not KINDS[kind].is_seen],
        "default": [default[kind]["covers"] for kind in wrong],
        "default, each": [share for kind in wrong for share in default[kind]["each covers"]],
    }
    return {words: [min(some), max(some)] for words, some in shares.items()}


def band_ranges(found: dict) -> dict[str, list[float]]:
    """Return the least and the largest share of samples inside the bands by white residuals, if the errors of all runs are alike."""
    some = [found[f"{kind}, white"]["inside 90 % bands"] for kind in BANDS if KINDS[kind].of != "current"]
    return {"inside, errors alike": [min(some), max(some)]}


def band_numbers(found: list[dict]) -> dict:
    """Return the number of vehicles, and the shares that `HEADS` names."""
    inside, widened, most = (np.array([one["inside"][key] for one in found]) for key in found[0]["inside"])
    level = np.array([one["level"] for one in found])
    failed, unjudged, passed = level == "fail", level == "unjudged", np.isin(level, ["pass", "caution"])
    shares = {
        "inside 90 % bands": inside.mean(),
        "held": np.mean(holds(inside)),
        "fail": failed.mean(),
        "unjudged": unjudged.mean(),
        "held or fail": np.mean(holds(inside) | failed),
        "false pass": np.mean(passed & (inside < LEVEL - MARGIN)),
        "pass, too wide": np.mean(passed & (inside > LEVEL + MARGIN)),
        "inside widened bands": widened.mean(),
        "widest hold 85 %": np.mean(most >= LEVEL - MARGIN),
        "interval covers": np.mean([one["covered"] for one in found]),
    }
    return {"vehicles": len(found), **{words: float(share) for words, share in shares.items()}}


def holds(inside: np.ndarray) -> np.ndarray:
    """Return whether a band of 90 % holds what is asked for."""
    return np.abs(inside - LEVEL) <= MARGIN


HEADS = {
    "coefficients": "| the model lacks | vehicles | model's ± covers | one ± covers, inputs exact | its width over the model's | "
    "one ± covers, defaults | its width over the model's |",
    "bands": "| the model lacks | error model | vehicles | inside 90 % bands | held | fail | unjudged | held or fail | false pass "
    "| pass, too wide | inside widened bands | widest hold 85 % | interval covers |",
}
PARTS = {"Effects in the list of those tried, and none:": True, "Effects outside that list:": False}
"""Words above the two tables of coefficients."""


def tables(table: str, found: dict) -> str:
    """Return one table; of coefficients one for effects in the list of those tried, and one for the others."""
    head = f"{HEADS[table]}\n|{'---|' * (HEADS[table].count('|') - 1)}\n"
    if table == "bands":
        return head + "".join(band_row(kind, error, found) for kind in BANDS for error in BAND_ERRORS)
    parts = {
        words: [coefficient_row(name, found) for name, kind in KINDS.items() if kind.is_tried == is_tried]
        for words, is_tried in PARTS.items()
    }
    return "\n".join(f"{words}\n\n{head}{''.join(rows)}" for words, rows in parts.items())


def coefficient_row(kind: str, found: dict) -> str:
    """Return one line of the table of coefficients."""
    numbers = found[kind]
    cells = [KINDS[kind].words, str(numbers["vehicles"]), f"{numbers['model']:.0%}"]
    for one in (numbers[stated] for stated in STATED):
        each = ", ".join(f"{100 * share:.0f}" for share in one["each covers"])
        widths = ", ".join(f"{width:.3g}" for width in one["each width"])
        cells += [f"{one['covers']:.0%} ({each})", f"{one['width']:.3g} ({widths})"]
    return f"| {' | '.join(cells)} |\n"


def band_row(kind: str, error: str, found: dict) -> str:
    """Return one line of the table of bands."""
    vehicles, *shares = found[f"{kind}, {error}"].values()
    return f"| {KINDS[kind].words} | {error} | {vehicles} | " + " | ".join(f"{share:.0%}" for share in shares) + " |\n"


if __name__ == "__main__":
    main()
