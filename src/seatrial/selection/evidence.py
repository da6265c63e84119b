"""Evidence of one structure with its Monte Carlo error, from independent runs of tempered SMC or of nested sampling."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
import scipy

from seatrial.core.argument_checks import check_count, check_kind
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.sampling.nested import NestedRun, batch_of
from seatrial.sampling.target import Target
from seatrial.sampling.tempered_smc import SMCResult, SMCSettings, sample_tempered_smc
from seatrial.selection.verdict import Evidence

PRIOR_REPEATS = 4  # Repeats' worth of trust in the expected variance of one run
MIN_ALIVE_SHARE = 0.05  # Share of the prior that must be simulable for its particles to be trusted
MAX_NESTED_SPREAD = 4.0  # Spread of runs of nested sampling, in their stated errors, that chance does not explain


@dataclass(frozen=True)
class EvidenceSettings:
    """Size of an evidence.

    Attributes:
        repeats: independent runs of tempered SMC, two or more; their spread gives the error.
        smc: size of each.
        draws: of the importance sampling that is compared with them; `smc_evidence` has none.

    Raises:
        InputError: fewer than two repeats, or an invalid size.
    """

    repeats: int = 4
    smc: SMCSettings = SMCSettings()
    draws: int = 8192

    def __post_init__(self) -> None:
        """Refuse sizes of which no error is known."""
        check_count(self.repeats, "EvidenceSettings, repeats", least=2, remedy="2 or more, for an error")
        check_kind(self.smc, SMCSettings, "EvidenceSettings, smc", "write smc=SMCSettings(particles=512)")
        check_count(self.draws, "EvidenceSettings, draws", least=1024, remedy="take some ten thousand")


def smc_evidence(
    target: Target, key: jax.Array, settings: EvidenceSettings = EvidenceSettings(), progress: Progress = no_progress
) -> Evidence:
    """Evidence by repeated tempered SMC.

    Raises:
        NumericalError: fewer than two repeats, or a run that cannot leave the prior.
    """
    return combine_runs(
        [
            sample_tempered_smc(
                target,
                jax.random.fold_in(key, repeat),
                settings.smc,
                lambda done, total, r=repeat: progress(r * total + done, settings.repeats * total),
            )
            for repeat in range(settings.repeats)
        ]
    )


def combine_runs(runs: list[SMCResult]) -> Evidence:
    """Combine independent runs: the mean of the unbiased evidences, its error from their spread.

    Few repeats may agree by chance, so the error is the larger of two: from their spread alone, and from their spread pooled
    with the variance expected of a run, which counts as much as four more repeats. Both are widened by the ratio of Student's t
    to the normal quantile at 95 %.

    Raises:
        NumericalError: fewer than two runs.
    """
    n = len(runs)
    if n < 2:
        raise NumericalError(
            "evidence needs at least two independent runs, or its error is unknown: set repeats to 2 or more"
        )
    logs = np.array([run.log_evidence for run in runs])
    top = logs.max()
    weights = np.exp(logs - top)
    log_value = float(top + np.log(weights.mean()))
    measured = float(weights.var(ddof=1) / weights.mean() ** 2)
    expected = float(np.mean([run.expected_variance for run in runs]))
    pooled = ((n - 1) * measured + PRIOR_REPEATS * expected) / (n - 1 + PRIOR_REPEATS)
    std_error = max(_widened(measured, n, n - 1), _widened(pooled, n, n - 1 + PRIOR_REPEATS))
    spread = float(logs.std(ddof=1))
    acceptance = float(min(run.acceptance.min() for run in runs))
    alive = min(run.alive for run in runs)
    complaints = []
    if spread > 1.0:
        complaints.append(f"repeats differ by {spread:.1f} nats: use more particles, or narrower priors")
    if acceptance < 0.05:
        complaints.append(
            f"the moves were accepted only {acceptance:.0%} of the time: use more particles, or narrower priors"
        )
    if alive < MIN_ALIVE_SHARE:
        complaints.append(
            f"only {alive:.1%} of the prior can be simulated: narrow it to damping that dissipates, or use more particles"
        )
    diagnostics = {
        "log_values": logs.tolist(),
        "spread": spread,
        "lowest_acceptance": acceptance,
        "alive": alive,
        "temperatures": [int(run.temperatures.size) for run in runs],
    }
    return Evidence(log_value, std_error, "adaptive tempered SMC", diagnostics, "; ".join(complaints))


def combine_nested(runs: Sequence[NestedRun], live: int) -> Evidence:
    """Combine independent runs of nested sampling, two at least, of so many live points each, averaged in log Z.

    The error is the larger of that expected, about sqrt(H / n), and that from the spread of the runs. H is the information, nats, from
    prior to posterior, and n the number of live points. If a batch leaves at once, from n, n - 1, ... points, log X falls by
    sum 1 / n_i and scatters by sum 1 / n_i^2, whose ratio takes the place of 1 / n.
    """
    logs = np.array([run.log_evidence for run in runs])
    information = float(np.mean([run.information for run in runs]))
    alive = float(np.mean([run.alive for run in runs]))
    left = live - np.arange(batch_of(live))
    scatter = (1.0 / left**2).sum() / (1.0 / left).sum()
    expected = np.sqrt(information * scatter + (1.0 / alive - 1.0) / live)
    spread = float(logs.std(ddof=1))
    stuck = float(max(run.stuck for run in runs))
    complaints = []
    if spread > MAX_NESTED_SPREAD * expected:
        complaints.append(
            f"repeats differ by {spread:.1f} nats, {expected:.1f} expected: use more moves or live points"
        )
    if stuck > 0.05:
        complaints.append(
            f"{stuck:.0%} of the slice moves found no new point: the posterior is too thin, use more live points"
        )
    diagnostics = {
        "log_values": logs.tolist(),
        "spread": spread,
        "information": information,
        "removed": [run.removed for run in runs],
        "alive": alive,
        "stuck": stuck,
    }
    return Evidence(
        float(logs.mean()),
        max(float(expected), spread) / float(np.sqrt(len(runs))),
        "nested slice sampling",
        diagnostics,
        "; ".join(complaints),
    )


def _widened(variance: float, repeats: int, freedom: int) -> float:
    """Standard error of a mean, widened for the uncertainty of its own variance."""
    return float(np.sqrt(variance / repeats) * scipy.special.stdtrit(freedom, 0.975) / scipy.special.ndtri(0.975))
