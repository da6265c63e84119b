"""Repeat every estimator of evidence where the evidence is known: `python docs/evidence.py`.

Some 40 minutes on two quiet cores; an interrupted run resumes from outputs/evidence, which is to be deleted to begin anew. Writes the
numbers in docs/dev/evidence.json, and from these docs/dev/evidence.svg and the tables in docs/dev/evidence.md; `--redraw` writes
only what is made from the numbers. Exits with 3 where errors are stated too small, or where agreement is wrong in silence. With a number,
`python docs/evidence.py 3`, at most so many repeats are made and shown, and nothing is written.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import evidence_report as report
import evidence_targets as known
import jax
import jax.numpy as jnp
import numpy as np
import study_numbers
from evidence_report import DEFAULT, Case, Run

from seatrial.core.errors import NumericalError
from seatrial.core.files import write_json, write_text
from seatrial.core.reporter import run_side_by_side
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.messages.render import sentences
from seatrial.report.drawing import draw_svg
from seatrial.report.figures.style import own_settings
from seatrial.sampling.diagnostics import chain_findings, diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.target import evaluate
from seatrial.selection.evidence import EvidenceSettings, smc_evidence
from seatrial.selection.importance import ImportanceSettings, importance_evidence
from seatrial.selection.log_evidence import Keys, log_evidence
from seatrial.selection.savage_dickey import savage_dickey
from seatrial.selection.verdict import Evidence

sys.path.insert(0, str(Path(__file__).parents[1]))
from studies.remus100.bridge import bridge_evidence
from studies.remus100.nested import nested_evidence
from studies.remus100.prior_monte_carlo import prior_evidence

HERE = Path(__file__).parent
FOLDER = HERE.parent / "outputs" / "evidence"
TERM = "term, 3"
BENIGN: dict[str, Callable[[], known.Problem]] = {
    "normal, 2": partial(known.normal, 2),
    "normal, 5": partial(known.normal, 5),
    "normal, 10": partial(known.normal, 10),
    "normal, 20": partial(known.normal, 20),
    "regression, 4": known.regression,
    "banana, 2": known.banana,
    TERM: known.term,
}
HARD: dict[str, Callable[[], known.Problem]] = {
    "beyond the edge, 2": known.beyond_the_edge,
    "two peaks, 2": known.two_peaks,
    "phase transition, 10": known.phase_transition,
    "wide regression, 4": known.wide_regression,
    "shells, 2": partial(known.shells, 2),
    "shells, 5": partial(known.shells, 5),
    "shells, 10": partial(known.shells, 10),
    "shells, 20": partial(known.shells, 20),
    "egg box, 2": known.egg_box,
}
GROUPS = {"easy": [*BENIGN], "shells": ["shells, 2", "shells, 5", "shells, 10"]}
"""Targets over which runs are counted together."""
METHODS = ("importance", "smc", "bridge", "nested", "prior")
SLOW = ("normal, 10", "normal, 20", "phase transition, 10")
CHEAP = {"importance": 100, "prior": 100, "savage-dickey": 100}
USUAL, FEW = 40, 20
RARE = {"shells, 2": 10, "shells, 5": 5, "shells, 10": 3, "shells, 20": 3, "egg box, 2": 8}
"""Repeats of what is not cheap, of targets that take longest."""
TERM_CHAINS = ChainSettings(warmup=2000, draws=2000, thin=4)
BRIDGE_CHAINS = ChainSettings(chains=32, warmup=3000, draws=12000, thin=4)
PRIOR_DRAWS = 100_000
COUNTED = ("nested", DEFAULT)
"""Estimators of which the first run counts its densities."""
LEAST = {
    ("smc", "normal, 20"): 12,
    ("agreement", "normal, 20"): 8,
    ("nested", "normal, 20"): 8,
    ("nested", "phase transition, 10"): 8,
    ("importance", "shells, 20"): 20,
    ("nested", "shells, 20"): 2,
}


class Answer(NamedTuple):
    """What a user gets: value and stated error, nats, complaints and diagnostics."""

    value: float
    stated: float
    status: str
    diagnostics: dict[str, Any]


def main() -> None:
    """Run all cases, two at once, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("repeats", type=int, nargs="?")
    parser.add_argument("--redraw", action="store_true")
    asked = parser.parse_args()
    if asked.redraw:
        numbers = study_numbers.kept("evidence")
    else:
        study_numbers.commit()
        names = [(method, target) for target in (*BENIGN, *HARD) for method in methods_for(target)]
        done = run_side_by_side([partial(run_case, *name, asked.repeats) for name in names])
        numbers = report.numbers_of(dict(zip(names, done, strict=True)), GROUPS)
        if asked.repeats is None:
            study_numbers.keep("evidence", numbers)
    failed = report.failures(numbers, list(BENIGN))
    print(tables(numbers), *failed, sep="\n")
    if asked.repeats is None:
        rows = [target for target in (*BENIGN, *HARD) if target != TERM]
        with own_settings():
            write_text(HERE / "dev" / "evidence.svg", draw_svg(report.score_figure(numbers["cases"], rows), "evidence"))
        study_numbers.show("evidence", tables(numbers))
    sys.exit(3 if failed else 0)


def tables(numbers: dict[str, Any]) -> str:
    """Return the picture and the tables of the page."""
    picture = f"![Errors of up to {report.DRAWN} runs of each in units of what each stated](evidence.svg)"
    return f"{picture}\n\n{report.tables(numbers, list(BENIGN), list(HARD))}"


def methods_for(target: str) -> Sequence[str]:
    """Estimators that are run on a target."""
    if target == TERM:
        return ("savage-dickey",)
    return (*METHODS, DEFAULT)


def repeats_of(method: str, target: str) -> int:
    """Repeats that the time allows."""
    usual = CHEAP.get(method, RARE.get(target, FEW if target in SLOW else USUAL))
    return LEAST.get((method, target), usual)


def run_case(method: str, target: str, most: int | None) -> Case:
    """Repeat one estimator on one target; what earlier runs of this script found is kept."""
    path = FOLDER / f"{method}-{target.replace(', ', '-').replace(' ', '-')}.json"
    kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"runs": []}
    repeats = min(repeats_of(method, target), most or sys.maxsize)
    problem = (BENIGN | HARD)[target]()
    while (seed := len(kept["runs"])) < repeats:
        counted = Counted(problem.posterior.likelihood)
        counts = method in COUNTED and not seed
        posterior = replace(problem.posterior, likelihood=counted) if counts else problem.posterior
        answer = estimate(method, posterior, jax.random.key(seed))
        kept.setdefault("evaluations", counted.count or evaluations(method, posterior.dim, answer))
        error = _or_none(answer.value - problem.log_evidence)
        kept["runs"].append([error, _or_none(answer.stated), answer.status])
        write_json(path, kept)
    runs = [Run(_or_nan(error), _or_nan(stated), bool(status)) for error, stated, status in kept["runs"][:repeats]]
    return Case(runs, kept["evaluations"])


def estimate(method: str, posterior: Posterior, key: jax.Array) -> Answer:
    """Return what a user gets; a refusal is an answer too."""
    try:
        found = ESTIMATE[method](posterior, key)
    except NumericalError as error:
        return Answer(np.nan, np.nan, str(error), {})
    return Answer(found.log_value, found.std_error, found.status, found.diagnostics)


def bridge(posterior: Posterior, key: jax.Array) -> Evidence:
    """Bridge sampling from chains that start at the best of many prior draws: nothing is known of the mode."""
    start_key, chain_key, key = jax.random.split(key, 3)
    chains = BRIDGE_CHAINS.chains
    drawn = np.asarray(posterior.sample_prior(start_key, 16 * chains))
    starts = jnp.asarray(drawn[np.argsort(-evaluate(posterior, drawn))[:chains]])
    draws = sample(SAMPLERS["adaptive-metropolis"], posterior, starts, jnp.eye(posterior.dim), chain_key, BRIDGE_CHAINS)
    found = bridge_evidence(posterior, draws.z, key)
    said = [*sentences(chain_findings(posterior.names, diagnose(draws.z))[:1]), *filter(None, [found.status])]
    return replace(found, status="; ".join(said))


def bayes_factor(posterior: Posterior, key: jax.Array) -> Any:
    """Savage-Dickey ratio of the middle coefficient, from chains that start at the prior."""
    start_key, key = jax.random.split(key)
    starts = posterior.sample_prior(start_key, TERM_CHAINS.chains)
    draws = sample(SAMPLERS["adaptive-metropolis"], posterior, starts, jnp.eye(posterior.dim), key, TERM_CHAINS)
    return savage_dickey(posterior, "c1", draws.z)


def evaluations(method: str, d: int, answer: Answer) -> int | None:
    """Densities that a run evaluates, those of the search for the mode aside; None if there is no formula."""
    size, smc = ImportanceSettings(), EvidenceSettings()
    match method:
        case "importance" if answer.diagnostics:
            return size.draws + size.pilot * (1 + answer.diagnostics["refits"])
        case "smc" if answer.diagnostics:
            steps = sum(answer.diagnostics["temperatures"])
            return smc.smc.particles_for(d) * (steps * smc.smc.moves_for(d) + smc.repeats)
        case "bridge":
            return BRIDGE_CHAINS.chains * (BRIDGE_CHAINS.warmup + BRIDGE_CHAINS.draws + 16) + 20_000
        case "savage-dickey":
            return TERM_CHAINS.chains * (TERM_CHAINS.warmup + TERM_CHAINS.draws)
        case "prior":
            return PRIOR_DRAWS
    return None


ESTIMATE: dict[str, Callable[[Posterior, jax.Array], Evidence]] = {
    "importance": importance_evidence,
    "smc": smc_evidence,
    "bridge": bridge,
    "nested": nested_evidence,
    "prior": partial(prior_evidence, draws=PRIOR_DRAWS),
    "savage-dickey": bayes_factor,
    DEFAULT: lambda posterior, key: log_evidence(posterior, key=Keys(*jax.random.split(key))),
}
"""What is run, by name; the last is what `seatrial select` does for a structure, its pieces in order."""


class Counted:
    """A likelihood that counts the points at which it is evaluated; its values are unchanged."""

    def __init__(self, likelihood: Callable[[dict[str, Any], Any], Any]) -> None:
        self.likelihood, self.count = likelihood, 0

    def __call__(self, values: dict[str, Any], data: Any) -> Any:
        """Log-likelihood, plus a zero that comes from counting."""
        first = jax.lax.stop_gradient(next(iter(values.values())))
        zero = jax.pure_callback(self._add, jax.ShapeDtypeStruct((), float), first, vmap_method="expand_dims")
        return self.likelihood(values, data) + zero

    def _add(self, x: Any) -> np.ndarray:
        self.count += np.size(x)
        return np.zeros(np.shape(x))


def _or_none(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _or_nan(x: Any) -> Any:
    return np.nan if x is None else x


if __name__ == "__main__":
    main()
