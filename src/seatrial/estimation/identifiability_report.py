"""What the data tell about each parameter and about several together: the numbers, and the words for them."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from seatrial.estimation.combinations import Combination
from seatrial.estimation.null_space import Invisible
from seatrial.estimation.remedies import is_coefficient, listed, measured, percent, what_separates

CONTRACTION = 0.9
"""Posterior over prior standard deviation beyond which the data said nothing."""
VAGUE = 0.5
"""Relative standard deviation beyond which a coefficient is not known."""


@dataclass(frozen=True, eq=False)
class Group:
    """Parameters that are known together rather than each.

    Attributes:
        names: the parameters.
        correlation: the correlation of two of them that is farthest from zero.
        known: sums that are known better, those with a meaning first, the best of all last.
        remedy: what would tell the parameters apart.
    """

    names: tuple[str, ...]
    correlation: float
    known: tuple[Combination, ...]
    remedy: str

    @property
    def headline(self) -> tuple[Combination, ...]:
        """The sums to use: those with a meaning, unless the best of all is known more than twice as well."""
        *meant, best = self.known
        return tuple(meant) if meant and meant[0].relative_sd <= 2 * best.relative_sd else (best,)


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What the data tell; arrays over the parameters.

    Attributes:
        stage: `before` or `after` the data.
        names: parameters.
        units: their SI units.
        values: point about which everything is said: prior means before the data, the posterior mode after.
        sd: posterior standard deviations, expected ones before the data.
        prior_sd: prior standard deviations.
        correlation: posterior correlations.
        eigenvalues: of the information of the data in relative changes, or in prior standard deviations where a value is
            near zero, ascending; NaN where the model diverges.
        untouched: parameters on which no measurement depends.
        invisible: combinations of the others on which no measurement depends.
        groups: parameters that are known together rather than each.
    """

    stage: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " d"]
    sd: Float[np.ndarray, " d"]
    prior_sd: Float[np.ndarray, " d"]
    correlation: Float[np.ndarray, "d d"]
    eigenvalues: Float[np.ndarray, " d"]
    untouched: tuple[str, ...]
    invisible: tuple[Invisible, ...]
    groups: tuple[Group, ...] = field(default=())

    @property
    def relative_sd(self) -> Float[np.ndarray, " d"]:
        """Standard deviations over the sizes of the values."""
        return self.sd / np.maximum(np.abs(self.values), 1e-300)

    @property
    def contraction(self) -> Float[np.ndarray, " d"]:
        """Posterior over prior standard deviations."""
        return self.sd / self.prior_sd

    @property
    def condition(self) -> float:
        """Largest over smallest eigenvalue of the scaled information, infinite where a combination is invisible."""
        if self.untouched or self.invisible or not self.eigenvalues[0] > 0:
            return float("inf")
        return float(self.eigenvalues[-1] / self.eigenvalues[0])

    def lines(self) -> list[str]:
        """Everything in plain words: each parameter, what is known together, and what to do."""
        verb = {"before": "would be", "after": "is"}[self.stage]
        said = [f"identifiability {self.stage} the data"]
        for name, unit, value, sd, prior_sd in zip(
            self.names, self.units, self.values, self.sd, self.prior_sd, strict=True
        ):
            if name in self.untouched:
                said.append(f"{name} {verb} what the prior says: {measured(value, sd, unit)}")
                continue
            size = f" to {percent(sd / abs(value))}" if sd < abs(value) else ""
            said.append(
                f"{name} {verb} known{size}: {measured(value, sd, unit)}, {percent(sd / prior_sd)} of the prior's standard deviation"
            )
        if np.isfinite(self.condition):
            said.append(f"condition number of the scaled information: {self.condition:.2g}")
        return said + self.cautions()

    def cautions(self) -> list[str]:
        """What a reader must know or do; empty where each parameter is known by itself."""
        together = [self._together(group) for group in self.groups]
        if np.isfinite(self.eigenvalues).all():
            return [*self._structural(), *self._practical(), *together]
        blind = "what the data can tell at all was not judged: the log-likelihood has no derivatives at the values used"
        return [blind] if self.stage == "before" else [blind, *self._practical(), *together]

    def _structural(self) -> list[str]:
        if len(self.untouched) == len(self.names):
            return ["the data say nothing about any parameter: no channel was measured, or none depends on them"]
        said = [f"{_untouched(name)} (structural); the stated value is the prior's" for name in self.untouched]
        return said + [
            f"one combination is invisible in these data whatever their length (structural): {item.text}; "
            f"{what_separates(item.names)}"
            for item in self.invisible
        ]

    def _practical(self) -> list[str]:
        said, verb = [], {"before": "would be", "after": "is"}[self.stage]
        for name, unit, value, sd, share in zip(
            self.names, self.units, self.values, self.sd, self.contraction, strict=True
        ):
            if name in self.untouched:
                continue
            if share > CONTRACTION:
                said.append(
                    f"the data cannot inform {name}: its standard deviation {verb} {share:.0%} of the prior's, "
                    "so the stated value is the prior's; run a trial that excites it, or fix it"
                )
            elif is_coefficient(name) and sd > VAGUE * abs(value):
                said.append(
                    f"{name} {verb} {measured(value, sd, unit)} (practical): the data narrow the prior but settle "
                    f"{'not even its sign' if 1.96 * sd > abs(value) else 'little more than its sign'}; "
                    "run a trial that excites it more, or leave it out"
                )
        return said

    def _together(self, group: Group) -> str:
        at = [self.names.index(name) for name in group.names]
        each = [
            f"{name} to {percent(self.relative_sd[i])}"
            if self.relative_sd[i] < 1
            else f"{name} as {measured(self.values[i], self.sd[i], self.units[i])}"
            for i, name in zip(at, group.names, strict=True)
        ]
        sums = [f"{item.text}{f' ({item.meaning})' if item.meaning else ''} {item.known}" for item in group.headline]
        is_known, is_not = {"before": ("would be", "would not be"), "after": ("is", "is not")}[self.stage]
        return (
            f"what {is_known} known is {listed(sums)}; the split {is_not}: {listed(each)}, correlation "
            f"{group.correlation:+.3f}; to separate them, {group.remedy}"
        )


def _untouched(name: str) -> str:
    if name.startswith("sigma_"):
        return f"no measurement of {name.removeprefix('sigma_')} is left, so that the data do not touch {name}"
    return f"the data do not touch {name}: no measurement depends on it; fix it, or measure what it moves"
