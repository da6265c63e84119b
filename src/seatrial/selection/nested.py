"""Evidence by nested slice sampling: see `seatrial.sampling.nested`; the standard error of log Z is about sqrt(H / n).

H is the information, nats, from prior to posterior, and n the number of live points. Where a batch leaves at once, from n, n - 1, ...
points, log X falls by sum 1 / n_i and scatters by sum 1 / n_i^2, whose ratio takes the place of 1 / n.
"""

from collections.abc import Sequence

import jax
import numpy as np

from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.nested import NestedRun, batch_of, sample_nested
from seatrial.selection.evidence import Evidence

MAX_SPREAD = 4.0
"""Spread of the repeats, in their stated errors, that chance does not explain."""


def nested_evidence(
    posterior: Posterior,
    key: jax.Array,
    *,
    repeats: int = 2,
    live: int = 500,
    moves: int | None = None,
    progress: Progress = no_progress,
) -> Evidence:
    """Return the evidence by independent repeats of nested slice sampling, averaged in log Z.

    The error is the larger of that expected, about sqrt(H / live / repeats), and that from the spread of the repeats.

    Args:
        posterior: density to integrate.
        key: random key.
        repeats: independent runs, at least two, since one cannot show that its points were moved too little.
        live: live points.
        moves: slice moves of each new point; None for max(5, 2 d, d^2 / 4).
        progress: called with the work done and in all.

    Raises:
        NumericalError: fewer than two repeats, or a run that does not end.
    """
    if repeats < 2:
        raise NumericalError(
            "nested sampling needs at least two independent runs to be judged: set repeats to 2 or more"
        )
    runs = [
        sample_nested(
            posterior,
            jax.random.fold_in(key, repeat),
            live=live,
            moves=moves,
            progress=lambda done, total, r=repeat: progress(r * total + done, repeats * total),
        )
        for repeat in range(repeats)
    ]
    progress(1, 1)
    return combine_nested(runs, live)


def combine_nested(runs: Sequence[NestedRun], live: int) -> Evidence:
    """Return the evidence of independent runs, two at least, of so many live points each."""
    logs = np.array([run.log_evidence for run in runs])
    information = float(np.mean([run.information for run in runs]))
    alive = float(np.mean([run.alive for run in runs]))
    left = live - np.arange(batch_of(live))
    scatter = (1.0 / left**2).sum() / (1.0 / left).sum()
    expected = np.sqrt(information * scatter + (1.0 / alive - 1.0) / live)
    spread = float(logs.std(ddof=1))
    stuck = float(max(run.stuck for run in runs))
    complaints = []
    if spread > MAX_SPREAD * expected:
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
