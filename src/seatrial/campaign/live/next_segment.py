"""Which of the campaign's designs teaches most from what is believed now: made at the start, weighed in a fraction of a second."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.problem import plan_of, prior_draws
from seatrial.campaign.design.sweep import design_first
from seatrial.compiled.programs import program
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.design_problem import UTILITY_DRAWS
from seatrial.design.robust import information_table
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.priors import nominal
from seatrial.manoeuvres.family import design_words
from seatrial.vehicles.model import VehicleModel

MOST_RUNS = 50  # Times in a row that a segment is thought of


class Choice(NamedTuple):
    """The segment that reaches the goal soonest.

    Attributes:
        words: of the segment.
        seconds: until the goal is met by it; infinite if no number of runs in reason does.
        unmet: the coefficient that is then furthest from its goal.
    """

    words: str
    seconds: float
    unmet: str


@dataclass(frozen=True, eq=False)
class Library:
    """Designs inside the campaign's limits.

    Attributes:
        plan: of a trial.
        words: of each design.
        controls: of each, SI, shape (D, n, c).
        duration: of one, s.
        sizes: largest magnitude that vehicles of the prior show in some of them, by channel, SI.
    """

    plan: TrialPlan
    words: tuple[str, ...]
    controls: Float[np.ndarray, "D n c"]
    duration: float
    sizes: dict[str, float]

    def choose(
        self,
        values: Float[np.ndarray, " k"],
        information: Float[np.ndarray, "k k"],
        worth: float,
        wanted: Float[np.ndarray, " k"],
    ) -> Choice:
        """Return the segment by which every wanted standard deviation is reached soonest.

        Args:
            values: coefficients as they are believed, SI.
            information: what is known of them, SI.
            worth: share of a design's information that is honest, at most 1.
            wanted: standard deviation of each, SI; infinite if nothing is asked.
        """
        gained = worth * information_table(self.plan, self.controls, values[None])[:, 0]
        best = Choice(self.words[0], np.inf, "")
        least = np.inf
        for words, more in zip(self.words, gained, strict=True):
            share, runs = self._after(information, more, wanted)
            if (runs, share.max()) < (best.seconds / self.duration, least):
                best = Choice(words, runs * self.duration, self.plan.names[int(np.argmax(share))])
                least = float(share.max())
        return best

    def _after(self, information: np.ndarray, more: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, float]:
        """Return standard deviations over those wanted after the runs that it takes, or after most, and how many it takes."""

        def share(runs: float) -> np.ndarray:
            with np.errstate(divide="ignore"):  # a share of a coefficient that is 0 is never reached
                return np.sqrt(np.abs(np.diag(np.linalg.inv(information + runs * more)))) / wanted

        if share(MOST_RUNS).max() > 1.0:
            return share(MOST_RUNS), np.inf
        low, high = 0, MOST_RUNS
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if share(middle).max() <= 1.0 else (middle, high)
        return share(high), float(high)


def make_library(campaign: Campaign, model: VehicleModel, reporter: Reporter = SILENT) -> Library:
    """Return the designs of `seatrial design`, which are made where they are not current; what is compiled is compiled here.

    Raises:
        InputError: no design inside the limits, or a campaign without what a design needs.
    """
    designs = design_first(campaign, reporter)
    plan, words, controls = plan_of(campaign, model), [], []
    for sweep in designs.sweeps:
        rows, columns, some = sweep.inside()
        words += [
            design_words(sweep.family, sweep.amplitude[i], sweep.period[j]) for i, j in zip(rows, columns, strict=True)
        ]
        controls.append(some)
    some = np.concatenate(controls)
    sizes = _sizes(campaign, plan, np.stack([sweep.best_controls() for sweep in designs.sweeps]))
    library = Library(plan, tuple(words), some, campaign.family.duration, sizes)
    values = np.array([list(map(nominal, campaign.coefficient_priors(model)))])
    information_table(plan, some, values)
    return library


def _sizes(campaign: Campaign, plan: TrialPlan, controls: np.ndarray) -> dict[str, float]:
    """Return the largest magnitude of each channel over draws of the priors under some designs; a draw that diverges has no part."""
    draws = prior_draws(campaign, plan.model)[:UTILITY_DRAWS]
    design, draw = (index.ravel() for index in np.indices((len(controls), len(draws))))
    (most,) = in_blocks(lambda control, values: (_largest(plan, values, control),), controls[design], draws[draw])
    most = np.where(np.isfinite(most), most, np.nan)
    noise = np.array(list(campaign.noise.values()))
    with np.errstate(all="ignore"):
        largest = np.nanmax(most, axis=0, initial=0.0) * noise
    return {name: max(float(size), 10.0 * sd) for name, size, sd in zip(plan.channels, largest, noise, strict=True)}


@program
def _largest(plan: TrialPlan, values: Array, control: Array) -> Array:
    return jax.vmap(lambda one, held: jnp.abs(plan.outputs(one, held)).max(0))(values, control)
