"""Repeat every estimator of evidence where the evidence is known: `python docs/evidence.py`.

Some 25 minutes on two quiet cores; an interrupted run resumes from outputs/evidence, which is to be deleted to begin anew. Writes
docs/dev/evidence.svg and the tables in docs/dev/evidence.md; exits with 3 where errors are stated too small, or where agreement is wrong in
silence. With a number, `python docs/evidence.py 3`, at most so many repeats are made and shown, and nothing is written. With names of
hard targets, `python docs/evidence.py "egg box, 2"`, only these are run, and their rows in the page are replaced.
"""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import evidence_targets as known
import jax
import jax.numpy as jnp
import numpy as np
from evidence_report import DEFAULT, Case, Run, failures, score_figure, tables

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
RESULTS = "<!-- results -->"
"""Where the results begin in the page."""
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
    "egg box, 2": known.egg_box,
}
METHODS = ("importance", "smc", "bridge", "nested", "prior")
SLOW = ("normal, 10", "normal, 20", "phase transition, 10")
CHEAP = {"importance": 100, "prior": 100, "savage-dickey": 100}
USUAL, FEW = 40, 20
RARE = {"shells, 2": 10, "shells, 5": 5, "shells, 10": 3, "egg box, 2": 8}
"""Repeats of what is not cheap, of targets that take longest."""
TERM_CHAINS = ChainSettings(warmup=2000, draws=2000, thin=4)
BRIDGE_CHAINS = ChainSettings(chains=32, warmup=3000, draws=12000, thin=4)
PRIOR_DRAWS = 100_000
LEAST = {
    ("smc", "normal, 20"): 12,
    ("agreement", "normal, 20"): 8,
    ("nested", "normal, 20"): 8,
    ("nested", "phase transition, 10"): 8,
}


class Answer(NamedTuple):
    """What a user gets: value and stated error, nats, complaints and diagnostics."""

    value: float
    stated: float
    status: str
    diagnostics: dict[str, Any]


def main() -> None:
    """Run all cases, two at once, or those of some targets, and write what was found."""
    named = [one for one in sys.argv[1:] if one in HARD]
    most = int(sys.argv[1]) if sys.argv[1:] and not named else None
    cases = [(method, target) for target in named or (*BENIGN, *HARD) for method in methods_for(target)]
    done = run_side_by_side([partial(run_case, *case, most) for case in cases])
    found = dict(zip(cases, done, strict=True))
    text = tables(found, list(BENIGN), list(HARD))
    failed = failures(found, list(BENIGN))
    print(text, *failed, sep="\n")
    page = HERE / "dev" / "evidence.md"
    before = page.read_text(encoding="utf-8")
    if named:
        kept = [line for line in before.splitlines() if not line.startswith(tuple(f"| {target} |" for target in named))]
        rows = [line for line in text.splitlines() if line.startswith(tuple(f"| {target} |" for target in named))]
        write_text(page, "\n".join([*kept, *rows]) + "\n")
    elif most is None:
        rows = [target for target in (*BENIGN, *HARD) if target != TERM]
        with own_settings():
            write_text(HERE / "dev" / "evidence.svg", draw_svg(score_figure(found, rows), "evidence"))
        picture = "![Errors of up to 40 runs of each in units of what each stated](evidence.svg)"
        write_text(page, f"{before[: before.index(RESULTS)]}{RESULTS}\n\n{picture}\n\n{text}")
    sys.exit(3 if failed else 0)


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
        first_nested = method == "nested" and not seed
        posterior = replace(problem.posterior, likelihood=counted) if first_nested else problem.posterior
        began = perf_counter()
        answer = estimate(method, posterior, jax.random.key(seed))
        seconds = perf_counter() - began
        kept.setdefault("evaluations", counted.count or evaluations(method, posterior.dim, answer))
        error = _or_none(answer.value - problem.log_evidence)
        kept["runs"].append([error, _or_none(answer.stated), answer.status, seconds])
        write_json(path, kept)
    return Case([Run(*map(_or_nan, run)) for run in kept["runs"][:repeats]], kept["evaluations"])


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
    """Densities that a run evaluates, those of the search for the mode aside; None for nested sampling, which is counted."""
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
