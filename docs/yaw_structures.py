"""Which terms turn a real ship? Chosen on four zigzags, tried on two others: `SEATRIAL_DATA=... python docs/yaw_structures.py`.

Free-running zigzags of a KVLCC2 model (HSVA, SIMMAN 2008): 10/5, 20/5, 20/10 and 35/5 are fitted, 10/10 and 25/5 only predicted. Sway
and yaw are driven by the rudder and the measured surge speed; nothing measured of sway or yaw enters a prediction but its first sample.
Every model is fitted alike: output error with coloured residuals, at the posterior mode. Writes the numbers in docs/dev/yaw.json, and
from these the tables in docs/dev/yaw.md.
"""

import gzip
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import study_numbers

import seatrial
from seatrial.core.coefficients import CoefficientName
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import LogUniform, Normal
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.selection.rules import TermLibrary, compile_rules, parse_rules
from seatrial.selection.screening import Screening, TermPrior, screen
from seatrial.vehicles.axis_equation import AxisEquation, axes_vehicle, axis_equation
from seatrial.vehicles.simulate import simulate

HERE = Path(__file__).parent
DATA = Path(os.environ.get("SEATRIAL_DATA", "")) / "kvlcc2_hsva"
FITTED, HELD = ("10_05", "20_05", "20_10_P", "35_05"), ("10_10_P", "25_05")
CHANNELS = tuple(
    Channel(name, unit, kind)
    for name, unit, kind in (
        ("u", "m/s", "measurement"),
        ("v", "m/s", "measurement"),
        ("r", "rad/s", "measurement"),
        ("delta_r", "rad", "control"),
    )
)
NOISE = {"u": 1.5e-4, "v": 1.8e-4, "r": 1e-5}
"""Of the optical tracking, by differences of neighbouring samples."""
# A constant, linear and quadratic damping, cross-flow drag, hull lift, and the rudder with and without speed.
TERMS = {
    "Y": ("0", "v", "r", "vabsv", "rabsr", "vabsr", "rabsv", "uv", "ur", "uudelta_r", "udelta_r", "delta_r"),
    "N": ("0", "r", "v", "rabsr", "vabsv", "rabsv", "vabsr", "ur", "uv", "uudelta_r", "udelta_r", "delta_r"),
}
RULES = """
at most one of Y_delta_r Y_udelta_r Y_uudelta_r
at most one of N_delta_r N_udelta_r N_uudelta_r
"""
NOMOTO = {
    "linear Nomoto": ("N_r", "N_delta_r"),
    "cubic Nomoto": ("N_0", "N_r", "N_r3", "N_delta_r"),
    "cubic Nomoto, with speed": ("N_0", "N_ur", "N_r3", "N_uudelta_r"),
}
SPEED, LENGTH = 1.18, 7.0
"""Approach speed, m/s, and length between perpendiculars, m: sizes for priors."""
SEARCHES = (1, 2, 3)
"""Keys of the searches for a mode, of which the highest is taken: one in three ends at a lower peak."""
SHOWN = 3
"""Most probable structures that are shown."""
WIDTH = 10.0
"""Standard deviation of a prior, in shares of the force that its term would need to make all of the motion alone."""


class Tried(NamedTuple):
    """One model: its terms, and the share of the variance of the yaw rate explained in each run."""

    name: str
    terms: tuple[str, ...]
    explained: dict[str, float]


def main() -> None:
    """Screen, fit, predict, and write what is found."""
    seatrial.configure()
    records = {run: zigzag(run) for run in FITTED + HELD}
    fitted = [records[run] for run in FITTED]
    screened, library = screen_turning(fitted)
    best = screened.posterior.terms(0)
    median = tuple(name for name in library.names if screened.inclusion.get(name, 1.0) > 0.5)
    models = {"screened: most probable": best, "screened: median-probability": median} | NOMOTO
    tried = [try_out(name, terms, records) for name, terms in models.items()]
    study_numbers.keep("yaw", numbers := numbers_of(screened, tried))
    study_numbers.show("yaw", tables(numbers))
    print(tables(numbers))


def zigzag(run: str) -> Record:
    """Body velocities from heading and earth-fixed velocities; the rudder's sign as recorded."""
    path = DATA / f"HSVA_CPMC_KVLCC2_Z_{run}.dat.gz"
    with gzip.open(path, "rt", encoding="cp1252") as stream:
        table = np.loadtxt(stream, skiprows=4)
    heading, rate, rudder = np.radians(table[:, [3, 6, 8]]).T
    east, north = table[:, 5], table[:, 4]
    columns = {
        "u": north * np.cos(heading) + east * np.sin(heading),
        "v": east * np.cos(heading) - north * np.sin(heading),
        "r": rate,
        "delta_r": rudder,
    }
    return make_record(table[:, 0], columns, CHANNELS, Provenance(path.name, "0" * 64), run)


def screen_turning(records: Sequence[Record]) -> tuple[Screening, TermLibrary]:
    """All structures of sway and yaw together, in closed form; one propeller turns the ship a little, so it is not its own mirror image."""
    names = {axis: tuple(f"{axis}_{each}" for each in terms) for axis, terms in TERMS.items()}
    every = tuple(CoefficientName.parse(name) for one in names.values() for name in one)
    library = TermLibrary(every, ("u", "v", "r", "delta_r"))
    lines = [line for line in RULES.splitlines() if line.strip()]
    rules = compile_rules(library, parse_rules(lines, library))
    equations = [axis_equation(axis, one) for axis, one in names.items()]
    prior = {name: TermPrior(0.0, sd) for name, sd in prior_sds(equations, records).items()}
    return screen(equations, rules, records, NOISE, prior, jax.random.key(3)), library


def prior_sds(equations: Sequence[AxisEquation], records: Sequence[Record]) -> dict[str, float]:
    """`WIDTH` times the coefficient that would make accelerations of the size that the turning ship has, by its term alone."""
    rate = float(np.sqrt(np.mean(np.concatenate([record.channel("r") for record in records]) ** 2)))
    size = {"Y": rate * SPEED, "N": rate * SPEED / LENGTH}
    found = {}
    for equation in equations:
        for term in equation.terms:
            columns = [
                equation.regressor(term, {name: record.channel(name) for name in (*term.signals, "r")})
                for record in records
            ]
            found[term.text] = WIDTH * size[equation.axis] / float(np.sqrt(np.mean(np.concatenate(columns) ** 2)))
    return found


def try_out(name: str, terms: Sequence[str], records: dict[str, Record]) -> Tried:
    """Fit a model to the four runs and simulate all six from their first samples."""
    equations = [
        axis_equation(axis, [term for term in terms if term[0] == axis])
        for axis in "YN"
        if any(term[0] == axis for term in terms)
    ]
    model = axes_vehicle(name, equations)
    fitted = [records[run] for run in FITTED]
    sensors = [Sensor(state, "coloured") for state in model.states]
    starts = [[record.channel(state)[0] for state in model.states] for record in fitted]
    likelihood, data = output_error(model, fitted, sensors, starts)
    sds = prior_sds(equations, fitted)
    parameters = [
        Parameter(term.text, model.unit_of(term), term.label, Normal(0.0, sds[term.text]))
        for term in model.coefficients
    ]
    for state in model.states:
        parameters.append(Parameter(f"sigma_{state}", "", "", LogUniform(1e-4, 0.2)))
        parameters.append(Parameter(f"tau_{state}", "s", "", LogUniform(0.5, 100.0)))
    posterior = Posterior(tuple(parameters), likelihood, data)
    searches = [find_mode(posterior, key=key) for key in SEARCHES]
    mode = max(searches, key=lambda one: one.log_density)
    values = dict(zip(posterior.names, mode.values.tolist(), strict=True))
    explained = {}
    for run, record in records.items():
        control = np.column_stack([record.channel(given) for given in model.controls])
        begin = jnp.array([record.channel(state)[0] for state in model.states])
        motion = np.asarray(simulate(model, values, jnp.asarray(control), jnp.asarray(record.step), begin))
        rate = record.channel("r")
        miss = rate - motion[:, model.states.index("r")]
        explained[run] = 1.0 - float(np.mean(miss**2) / np.var(rate))
    return Tried(name, tuple(terms), explained)


def numbers_of(screened: Screening, tried: Sequence[Tried]) -> dict[str, Any]:
    """Return the probabilities of terms and of the first structures, and what each model explains of each run."""
    posterior = screened.posterior
    inclusion = sorted(screened.inclusion.items(), key=lambda item: -item[1])
    first = [{"probability": float(posterior.probability[i]), "terms": posterior.terms(i)} for i in range(SHOWN)]
    return {
        "structures": posterior.count,
        "terms": {name: float(p) for name, p in inclusion},
        "first": first,
        "rows": screened.fit.status,
        "models": {one.name: {"terms": one.terms, "explained": one.explained} for one in tried},
    }


def tables(numbers: dict[str, Any]) -> str:
    """Return what was screened, and what each model explains."""
    runs = [run.replace("_", "/") + (" (held back)" if run in HELD else "") for run in FITTED + HELD]
    lines = [
        f"{numbers['structures']:,} structures of sway and yaw were screened. Probability of each term:",
        f"{', '.join(f'{name} {p:.2f}' for name, p in numbers['terms'].items())}.",
        "",
        "| probability | terms |",
        "|---|---|",
        *(f"| {one['probability']:.3f} | {' '.join(one['terms'])} |" for one in numbers["first"]),
        "",
        f"The rows: {numbers['rows']}" if numbers["rows"] else "Rows have independent residuals.",
        "",
        f"| model | terms | {' | '.join(runs)} |",
        f"|---|---|{'---|' * len(runs)}",
    ]
    for name, model in numbers["models"].items():
        explained = " | ".join(f"{model['explained'][run]:.1%}" for run in FITTED + HELD)
        lines.append(f"| {name} | {' '.join(model['terms'])} | {explained} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
