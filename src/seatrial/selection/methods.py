"""The estimators of evidence by name, each called alike, with the height of the highest peak it knows."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

from seatrial.estimation.mode import find_mode
from seatrial.sampling.diagnostics import complaints as chain_complaints
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.target import Progress, evaluate
from seatrial.sampling.tempered_ladder import Ladder, LadderSettings, sample_ladder
from seatrial.sampling.tempered_smc import sample_tempered_smc
from seatrial.selection.bridge import bridge_evidence
from seatrial.selection.evidence import Evidence, EvidenceSettings, combine_runs
from seatrial.selection.importance import ImportanceSettings, importance_evidence
from seatrial.selection.laplace import laplace_evidence
from seatrial.selection.lookout import Cooled
from seatrial.selection.nested import nested_evidence
from seatrial.selection.prior_monte_carlo import prior_evidence
from seatrial.selection.thermodynamic import stepping_stone, thermodynamic

Method = Literal["importance", "smc", "stepping-stone", "thermodynamic", "bridge", "nested", "laplace", "prior"]
KIN = ({"importance", "laplace"}, {"stepping-stone", "thermodynamic"})
"""Methods that share their code, and so do not check each other."""


@dataclass(frozen=True)
class AgreementSettings:
    """Sizes of the methods' runs.

    Attributes:
        importance: of importance sampling.
        smc: of tempered SMC.
        ladder: of stepping-stone and thermodynamic integration.
        metropolis: of the chains of bridge sampling, which start from the prior.
        prior_draws: of the average over the prior.
        lookout: whether to search for a higher peak, by one more run of tempered SMC.
    """

    importance: ImportanceSettings = ImportanceSettings()
    smc: EvidenceSettings = EvidenceSettings()
    ladder: LadderSettings = LadderSettings()
    metropolis: ChainSettings = ChainSettings(chains=32, warmup=3000, draws=12000, thin=4)
    prior_draws: int = 100_000
    lookout: bool = True


class Found(NamedTuple):
    """What one method gives, and the height of the highest peak it knows, log density."""

    evidence: Evidence
    peak: float = -np.inf


def _importance(posterior: Any, key: jax.Array, settings: AgreementSettings, progress: Progress) -> Found:
    mode_key, key = jax.random.split(key)
    mode = find_mode(posterior, mode_key)
    return Found(importance_evidence(posterior, key, mode, settings.importance), mode.log_density)


def _laplace(posterior: Any, key: jax.Array, settings: AgreementSettings, progress: Progress) -> Found:
    mode_key, key = jax.random.split(key)
    mode = find_mode(posterior, mode_key)
    return Found(laplace_evidence(posterior, key, mode), mode.log_density)


def _smc(posterior: Any, key: jax.Array, settings: AgreementSettings, progress: Progress) -> Found:
    """As `smc_evidence`, its particles kept."""
    repeats, target = settings.smc.repeats, Cooled(posterior, jnp.ones(()))
    runs = [
        sample_tempered_smc(
            target,
            jax.random.fold_in(key, r),
            settings.smc.smc,
            lambda done, total, r=r: progress(r * total + done, repeats * total),
        )
        for r in range(repeats)
    ]
    highest = max(evaluate(posterior, run.particles).max() for run in runs)
    return Found(combine_runs(runs), _peak(float(highest), posterior.dim))


def _bridge(posterior: Any, key: jax.Array, settings: AgreementSettings, progress: Progress) -> Found:
    """Chains that start at the best of many prior draws, so that nothing is shared with methods that climb to the mode."""
    start_key, chain_key, key = jax.random.split(key, 3)
    chains = settings.metropolis.chains
    drawn = np.asarray(posterior.sample_prior(start_key, 16 * chains))
    starts = drawn[np.argsort(-evaluate(posterior, drawn))[:chains]]
    draws = sample(
        SAMPLERS["adaptive-metropolis"],
        posterior,
        jnp.asarray(starts),
        jnp.eye(posterior.dim),
        chain_key,
        settings.metropolis,
        progress,
    )
    names = getattr(posterior, "names", tuple(f"z{i}" for i in range(posterior.dim)))
    said = chain_complaints(names, diagnose(draws.z))
    found = bridge_evidence(posterior, draws.z, key)
    status = "; ".join([*said[:1], *([found.status] if found.status else [])])
    evidence = Evidence(found.log_value, found.std_error, found.method, found.diagnostics, status)
    return Found(evidence, _peak(float(draws.log_density.max()), posterior.dim))


def _ladder(estimate: Callable[[Ladder], Evidence]) -> Callable[..., Found]:
    def run(posterior: Any, key: jax.Array, settings: AgreementSettings, progress: Progress) -> Found:
        ladder = sample_ladder(posterior, key, settings.ladder, progress)
        return Found(estimate(ladder), _peak(ladder.highest, posterior.dim))

    return run


def _nested(posterior: Any, key: jax.Array, settings: AgreementSettings, progress: Progress) -> Found:
    return Found(nested_evidence(posterior, key, progress=progress))


def _prior(posterior: Any, key: jax.Array, settings: AgreementSettings, progress: Progress) -> Found:
    return Found(prior_evidence(posterior, key, draws=settings.prior_draws))


def _peak(highest: float, d: int) -> float:
    """Height of the peak of a normal density whose best of a thousand draws is this high."""
    return highest + 0.5 * float(stats.chi2.ppf(1e-3, d))


RUN: dict[str, Callable[[Any, jax.Array, AgreementSettings, Progress], Found]] = {
    "importance": _importance,
    "smc": _smc,
    "stepping-stone": _ladder(stepping_stone),
    "thermodynamic": _ladder(thermodynamic),
    "bridge": _bridge,
    "nested": _nested,
    "laplace": _laplace,
    "prior": _prior,
}
