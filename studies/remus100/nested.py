"""Evidence by nested slice sampling alone, which the study compares with other methods; see `seatrial.sampling.nested`."""

import jax

from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.nested import sample_nested
from seatrial.selection.evidence import combine_nested
from seatrial.selection.verdict import Evidence


def nested_evidence(
    posterior: Posterior,
    key: jax.Array,
    *,
    repeats: int = 2,
    live: int = 500,
    moves: int | None = None,
    progress: Progress = no_progress,
) -> Evidence:
    """Return the evidence by independent repeats of nested slice sampling, combined by `combine_nested`.

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
