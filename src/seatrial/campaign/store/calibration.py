"""A stored calibration: ranks of the truth among draws, and whether the draws themselves are why they are uneven."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from seatrial.estimation.diagnostics.calibration import DRAWS, Calibration
from seatrial.messages.predictions import calibration_lines

MANY_REFUSED = 0.05  # Share of the prior beyond which a reader is told
# What a replicate's draws have at most and at least where they mixed well. Ranks are among 99 draws; of 32 short
# chains 99 effective draws are 1.5 in each half, the means of which then differ so much that R-hat is 1.3, where
# nothing is wrong with them.
REPLICATE_MAX_R_HAT, REPLICATE_MIN_ESS, REPLICATE_MIN_MOVED = 1.3, DRAWS, 0.05
# How the worst of each diagnostic is told.
WORST = (
    ("R-hat up to {:.2f}", np.max),
    ("{:.0f} effective draws at least", np.min),
    ("{:.2%} of transitions diverged at most", np.max),
    ("{:.0%} of the moves made at least", np.min),
)
MANY_POOR = 0.02  # Share of the replicates that did not mix well from which on they may be why ranks are uneven


@dataclass(frozen=True, eq=False)
class Calibrated(Calibration):
    """Ranks of a calibration of a campaign, and what they were made of.

    Attributes:
        method: how posteriors were drawn.
        structure: label of the structure.
        refused: share of the prior's draws that could not be simulated, and were drawn again.
        health: of each replicate: R-hat, effective sample size, share of divergent transitions, share of moves made, NaN where the
            method has no such number.
    """

    method: str
    structure: str
    refused: float
    health: Float[np.ndarray, "replicate diagnostic"]

    def poor(self) -> Bool[np.ndarray, " r"]:
        """Replicates whose draws did not mix well, by the method's own diagnostics."""
        r_hat, ess, diverged, moved = self.health.T
        return (
            (r_hat > REPLICATE_MAX_R_HAT)
            | (ess < REPLICATE_MIN_ESS)
            | (diverged > 0.0)
            | (moved < REPLICATE_MIN_MOVED)
            | np.isnan(self.health).all(1)
        )

    def lines(self) -> list[str]:
        """What was found, in words."""
        outside, k = self.outside(), len(self.names)
        band = f"the band that holds {'it' if k == 1 else f'all {k} quantities'} with 99 % probability"
        verdict = (
            f"calibrated: the ranks lie inside {band}"
            if not outside
            else f"not calibrated: the ranks of {', '.join(outside)} leave {band}"
        )
        messages = [*calibration_lines(self), self.mixing_words()]
        if self.refused > MANY_REFUSED:
            messages.append(
                f"{self.refused:.0%} of the prior could not be simulated and was drawn again; `seatrial prior` shows why"
            )
        return [*messages, f"{verdict} (structure {self.structure}, {self.method})"]

    def mixing_words(self) -> str:
        """Whether the draws themselves may be why ranks are uneven, by the method's own diagnostics."""
        poor, r = self.poor(), len(self.health)
        worst = [
            text.format(extreme(column[~np.isnan(column)]))
            for (text, extreme), column in zip(WORST, self.health.T, strict=True)
            if not np.isnan(column).all()
        ]
        numbers = ", ".join(worst)
        if not poor.any():
            end = ": so the sampling is not the cause of the uneven ranks" if self.outside() else ""
            return f"the draws mixed well in all {r} replicates ({numbers}){end}"
        sentence = f"the draws mixed poorly in {poor.sum()} of {r} replicates ({numbers})"
        if poor.mean() < MANY_POOR:
            return f"{sentence}: too few to cause uneven ranks"
        return f"{sentence}: this may be the cause of uneven ranks, not the posterior; try another method, or narrower priors"
