"""What a rehearsal found: trials each strategy needed, what the adaptive one saves, and whether the stated uncertainty held."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int
from scipy.special import betaincinv

from seatrial.core.dataset import Dataset
from seatrial.core.result_table import aligned

ADAPTIVE = "adaptive"
WITHIN_SDS = 1.64  # Standard deviations of an estimate within which the truth lies with 90 % probability
HONEST_SHARE = 0.9
MANY_VEHICLES = 30  # Vehicles from which the share of honest intervals is nearly normal
MAX_CHANCE = 0.05  # Probability below which a difference between strategies is not put down to chance
SURE_ERRORS = 3.0  # Standard errors beyond which a difference is not chance


class Mean(NamedTuple):
    """A mean over vehicles and its standard error."""

    value: float
    error: float


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """V vehicles, S strategies, at most N trials of each, k coefficients.

    Attributes:
        data: as stored: `trials`, `met`, `estimate`, `sd` and the designs by vehicle and strategy, `truth` and `refused` by vehicle.
    """

    data: Dataset

    @property
    def strategies(self) -> tuple[str, ...]:
        """Names of the strategies, the adaptive one first."""
        return tuple(map(str, self.data["strategy"].values))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return tuple(map(str, self.data["coefficient"].values))

    @property
    def vehicles(self) -> int:
        """V."""
        return self.data.sizes["vehicle"]

    @property
    def most(self) -> int:
        """N."""
        return self.data.sizes["trial"]

    @property
    def _most(self) -> str:
        return f"{self.most} trial{'s' * (self.most != 1)}"

    @property
    def needed(self) -> Int[np.ndarray, "V S"]:
        """Trials run; N also if the goal was never met."""
        return self.data["trials"].values

    @property
    def met(self) -> Bool[np.ndarray, "V S"]:
        """Whether the goal was met."""
        return self.data["met"].values > 0

    @property
    def refused(self) -> int:
        """Draws from the prior that ran away and were drawn again."""
        return int(self.data["refused"].sum())

    def trials_of(self, strategy: str) -> Mean:
        """Trials needed; a vehicle that never met the goal counts as N."""
        return _mean(self.needed[:, self.strategies.index(strategy)])

    def saved_against(self, strategy: str) -> Mean:
        """Trials that the adaptive strategy needed less on the same vehicles."""
        return _mean(self.needed[:, self.strategies.index(strategy)] - self.needed[:, self.strategies.index(ADAPTIVE)])

    def share_met(self, strategy: str) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, "2 N"]]:
        """Share of the vehicles that met the goal after 1, 2, … trials, and the binomial 90 % band (Jeffreys)."""
        column = self.strategies.index(strategy)
        after = np.arange(1, self.most + 1)
        count = (self.met[:, column, None] & (self.needed[:, column, None] <= after)).sum(0)
        a, b = count + 0.5, self.vehicles - count + 0.5
        return count / self.vehicles, np.stack([betaincinv(a, b, 0.05), betaincinv(a, b, 0.95)])

    def median_sd(self, strategy: str) -> Float[np.ndarray, "N k"]:
        """Median over vehicles of what is known after 1, 2, … trials, SI; a vehicle that has stopped keeps its last."""
        column = self.strategies.index(strategy)
        sd, last = self.data["sd"].values[:, column], self.needed[:, column] - 1
        kept = np.minimum(np.arange(self.most), last[:, None])
        return np.median(np.take_along_axis(sd, kept[..., None], 1), 0)

    def honest_share(self, strategy: str) -> Mean:
        """Share of the coefficients whose truth lies within 1.64 sd of the last estimate; should be 0.9.

        The error counts vehicles, since the coefficients of one vehicle are estimated from the same data.
        """
        column = self.strategies.index(strategy)
        last = (np.arange(self.vehicles), column, self.needed[:, column] - 1)
        distance = np.abs(self.data["estimate"].values[last] - self.data["truth"].values)
        return _mean((distance <= WITHIN_SDS * self.data["sd"].values[last]).mean(1))

    def honest_band(self, strategy: str) -> tuple[float, float]:
        """95 % interval of `honest_share`: of few vehicles the binomial one (Clopper and Pearson), as if each were one case."""
        share = self.honest_share(strategy)
        if self.vehicles >= MANY_VEHICLES:
            return share.value - 1.96 * share.error, share.value + 1.96 * share.error
        inside, n = share.value * self.vehicles, self.vehicles
        low = 0.0 if inside == 0 else float(betaincinv(inside, n - inside + 1, 0.025))
        return low, 1.0 if inside == n else float(betaincinv(inside + 1, n - inside, 0.975))

    def more_often(self, strategy: str) -> tuple[Mean, float]:
        """Share of the vehicles in which the adaptive strategy met the goal and the other did not, less the opposite.

        Returns:
            the difference, and the probability that chance alone makes one as large (McNemar's test, exact).
        """
        here, there = (self.met[:, self.strategies.index(name)] for name in (ADAPTIVE, strategy))
        gained, lost = int((here & ~there).sum()), int((there & ~here).sum())
        chance = scipy.stats.binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
        return _mean(here.astype(float) - there), float(chance)

    def lines(self) -> list[str]:
        """A table of the strategies, and what was found in words."""
        heads = ("", "trials", "never met", "adaptive saves", "truth within 1.64 sd", *self.coefficients)
        note = f"columns of coefficients: median sd at the end, SI; {self.vehicles} vehicles, {self._most} at most"
        return [*aligned([heads, *map(self._row, self.strategies)]), note, *self.verdicts()]

    def verdicts(self) -> list[str]:
        """One sentence for each strategy that the adaptive one is compared with, and one about those that never met the goal."""
        comparisons = [self._compared(name) for name in self.strategies if name != ADAPTIVE]
        if not self.met.all():
            comparisons.append(f"a vehicle that did not meet the goal counts as {self._most}, although it needs more")
        if self.refused:
            drawn = self.vehicles + self.refused
            comparisons.append(f"{self.refused} of {drawn} draws from the prior diverged and were drawn again")
        return comparisons

    def alarms(self) -> list[str]:
        """Strategies after which the stated uncertainty does not hold."""
        shares = {name: self.honest_share(name) for name in self.strategies}
        return [
            f"{name}: the truth lies within 1.64 sd in {self._honest(name)} of the cases (0.90 expected). The posterior is not normal "
            f"about its mode, and goals may have been met too early"
            for name, share in shares.items()
            if max(share.value + SURE_ERRORS * share.error, self.honest_band(name)[1]) < HONEST_SHARE
        ]

    def _row(self, name: str) -> Sequence[str]:
        column = self.strategies.index(name)
        saved = "-" if name == ADAPTIVE else _signed(self.saved_against(name))
        never = int((~self.met[:, column]).sum())
        sds = (f"{sd:.3g}" for sd in self.median_sd(name)[-1])
        return (name, _said(self.trials_of(name)), str(never), saved, self._honest(name), *sds)

    def _honest(self, name: str) -> str:
        share, (low, high) = self.honest_share(name), self.honest_band(name)
        return _said(share) if self.vehicles >= MANY_VEHICLES else f"{share.value:.2f} ({low:.2f} to {high:.2f})"

    def _compared(self, name: str) -> str:
        saved, of = self.saved_against(name), self.trials_of(name)
        more, chance = self.more_often(name)
        if more.value and not abs(saved.value) > 2.0 * saved.error:
            # Trials beyond the most allowed are not counted, so that they cannot tell the two apart: what they reached may.
            here, there = (float(self.share_met(one)[0][-1]) for one in (ADAPTIVE, name))
            words = (
                f"within {self._most} redesigning each trial meets the goal in {here:.0%} of the vehicles and "
                f"this in {there:.0%}, {100 * more.value:+.0f} ± {100 * more.error:.0f} points"
            )
            return f"against {name}: {words}" + (", which may be chance" if chance > MAX_CHANCE else "")
        if abs(saved.value) <= 2.0 * saved.error:
            return f"against {name}: no difference beyond chance, {_signed(saved)} trials of {of.value:.1f}"
        verb = "saves" if saved.value > 0 else "costs"
        return f"against {name}: redesigning each trial {verb} {abs(saved.value):.2f} ± {saved.error:.2f} trials of {of.value:.1f}"


def _mean(values: np.ndarray) -> Mean:
    return Mean(float(values.mean()), float(values.std(ddof=1) / np.sqrt(values.size)))


def _said(mean: Mean) -> str:
    return f"{mean.value:.2f} ± {mean.error:.2f}"


def _signed(mean: Mean) -> str:
    return f"{mean.value:+.2f} ± {mean.error:.2f}"
