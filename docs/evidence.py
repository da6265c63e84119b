"""Repeat every estimator of evidence where the evidence is known: `python docs/evidence.py`.

Some 25 minutes on two quiet cores; an interrupted run resumes from outputs/evidence, which is to be deleted to begin anew. Writes
docs/evidence.svg and the tables in docs/evidence.md; exits with 3 where errors are stated too small, or where agreement is wrong in
silence. With a number, `python docs/evidence.py 3`, at most so many repeats are made and shown, and nothing is written.
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
from seatrial.core.progress import run_side_by_side
from seatrial.estimation.posterior import Posterior
from seatrial.report.drawing import draw_svg
from seatrial.report.figures.style import own_settings
from seatrial.sampling.diagnostics import complaints, diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.target import evaluate
from seatrial.selection.bridge import bridge_evidence
from seatrial.selection.combined_evidence import Keys, agreed_evidence
from seatrial.selection.evidence import Evidence, EvidenceSettings, smc_evidence
from seatrial.selection.importance import ImportanceSettings, importance_evidence
from seatrial.selection.laplace import laplace_evidence
from seatrial.selection.nested import nested_evidence
from seatrial.selection.prior_monte_carlo import prior_evidence
from seatrial.selection.savage_dickey import savage_dickey
from seatrial.selection.thermodynamic import LadderSettings, sample_ladder, stepping_stone, thermodynamic

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
}
METHODS = ("importance", "smc", "ladder", "bridge", "nested", "prior", "laplace")
"""What is run; one ladder gives both stepping-stone and thermodynamic integration."""
SLOW = ("normal, 10", "normal, 20", "phase transition, 10")
CHEAP = {"importance": 100, "laplace": 10, "prior": 100, "savage-dickey": 100}
USUAL, FEW = 40, 20
TERM_CHAINS = ChainSettings(warmup=2000, draws=2000, thin=4)
BRIDGE_CHAINS = ChainSettings(chains=32, warmup=3000, draws=12000, thin=4)
PRIOR_DRAWS = 100_000
LEAST = {
    ("smc", "normal, 20"): 12,
    ("agreement", "normal, 20"): 8,
    ("ladder", "normal, 20"): 8,
    ("nested", "normal, 20"): 8,
    ("ladder", "phase transition, 10"): 8,
    ("nested", "phase transition, 10"): 8,
}


class Answer(NamedTuple):
    """What a user gets: value and stated error, nats, complaints and diagnostics."""

    value: float
    stated: float
    status: str
    diagnostics: dict[str, Any]


def main() -> None:
    """Run all cases, two at once, and write what was found."""
    most = int(sys.argv[1]) if len(sys.argv) > 1 else None
    cases = [(method, target) for target in (*BENIGN, *HARD) for method in methods_for(target)]
    done = run_side_by_side([partial(run_case, *case, most) for case in cases])
    found = {key: case for results in done for key, case in results.items()}
    text = tables(found, list(BENIGN), list(HARD))
    failed = failures(found, list(BENIGN))
    print(text, *failed, sep="\n")
    if most is None:
        rows = [target for target in (*BENIGN, *HARD) if target != TERM]
        with own_settings():
            write_text(HERE / "evidence.svg", draw_svg(score_figure(found, rows), "evidence"))
        page = HERE / "evidence.md"
        before = page.read_text(encoding="utf-8")
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
    usual = CHEAP.get(method, FEW if target in SLOW else USUAL)
    return LEAST.get((method, target), usual)


def run_case(method: str, target: str, most: int | None) -> dict[tuple[str, str], Case]:
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
        answers = estimate(method, posterior, jax.random.key(seed))
        seconds = perf_counter() - began
        kept.setdefault("evaluations", counted.count or evaluations(method, posterior.dim, answers))
        kept["runs"].append(
            {
                name: [_or_none(one.value - problem.log_evidence), _or_none(one.stated), one.status, seconds]
                for name, one in answers.items()
            }
        )
        write_json(path, kept)
    return {
        (name, target): Case([Run(*map(_or_nan, run[name])) for run in kept["runs"][:repeats]], kept["evaluations"])
        for name in kept["runs"][0]
    }


def estimate(method: str, posterior: Posterior, key: jax.Array) -> dict[str, Answer]:
    """Answers by name; a refusal is one too."""
    names = ("stepping-stone", "thermodynamic") if method == "ladder" else (method,)
    try:
        found = ESTIMATE[method](posterior, key)
    except NumericalError as error:
        return {name: Answer(np.nan, np.nan, str(error), {}) for name in names}
    return {
        name: Answer(one.log_value, one.std_error, one.status, one.diagnostics)
        for name, one in zip(names, found if isinstance(found, tuple) else (found,), strict=True)
    }


def both_of_a_ladder(posterior: Posterior, key: jax.Array) -> tuple[Evidence, Evidence]:
    """Stepping-stone and thermodynamic integration."""
    ladder = sample_ladder(posterior, key)
    return stepping_stone(ladder), thermodynamic(ladder)


def bridge(posterior: Posterior, key: jax.Array) -> Evidence:
    """Bridge sampling from chains that start at the best of many prior draws: nothing is known of the mode."""
    start_key, chain_key, key = jax.random.split(key, 3)
    chains = BRIDGE_CHAINS.chains
    drawn = np.asarray(posterior.sample_prior(start_key, 16 * chains))
    starts = jnp.asarray(drawn[np.argsort(-evaluate(posterior, drawn))[:chains]])
    draws = sample(SAMPLERS["adaptive-metropolis"], posterior, starts, jnp.eye(posterior.dim), chain_key, BRIDGE_CHAINS)
    found = bridge_evidence(posterior, draws.z, key)
    said = [*complaints(posterior.names, diagnose(draws.z))[:1], *filter(None, [found.status])]
    return replace(found, status="; ".join(said))


def bayes_factor(posterior: Posterior, key: jax.Array) -> Any:
    """Savage-Dickey ratio of the middle coefficient, from chains that start at the prior."""
    start_key, key = jax.random.split(key)
    starts = posterior.sample_prior(start_key, TERM_CHAINS.chains)
    draws = sample(SAMPLERS["adaptive-metropolis"], posterior, starts, jnp.eye(posterior.dim), key, TERM_CHAINS)
    return savage_dickey(posterior, "c1", draws.z)


def evaluations(method: str, d: int, answers: dict[str, Answer]) -> int | None:
    """Densities that a run evaluates, those of the search for the mode aside; None for nested sampling, which is counted."""
    answer, size, smc, ladder = next(iter(answers.values())), ImportanceSettings(), EvidenceSettings(), LadderSettings()
    match method:
        case "importance" if answer.diagnostics:
            return size.draws + size.pilot * (1 + answer.diagnostics["refits"])
        case "smc" if answer.diagnostics:
            steps = sum(answer.diagnostics["temperatures"])
            return smc.smc.particles_for(d) * (steps * smc.smc.moves_for(d) + smc.repeats)
        case "ladder":
            return (ladder.warmup + ladder.draws) * ladder.rungs * ladder.copies * max(2, d // 2)
        case "bridge":
            return BRIDGE_CHAINS.chains * (BRIDGE_CHAINS.warmup + BRIDGE_CHAINS.draws + 16) + 20_000
        case "savage-dickey":
            return TERM_CHAINS.chains * (TERM_CHAINS.warmup + TERM_CHAINS.draws)
        case "prior":
            return PRIOR_DRAWS
    return None


ESTIMATE: dict[str, Callable[[Posterior, jax.Array], Evidence | tuple[Evidence, ...]]] = {
    "importance": importance_evidence,
    "smc": smc_evidence,
    "ladder": both_of_a_ladder,
    "bridge": bridge,
    "nested": nested_evidence,
    "prior": partial(prior_evidence, draws=PRIOR_DRAWS),
    "laplace": laplace_evidence,
    "savage-dickey": bayes_factor,
    DEFAULT: lambda posterior, key: agreed_evidence(posterior, Keys(*jax.random.split(key))),
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
