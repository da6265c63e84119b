"""Draws of all structures that the data do not separate, each as often as it is probable.

A record far from those that were fitted is predicted by each as its own terms continue. The mixture contains that spread:

    mean = sum_k w_k m_k,    variance = sum_k w_k (s_k^2 + (m_k - mean)^2)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.posterior import widest
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import key_of
from seatrial.selection.contenders import STANDING
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection


@dataclass(frozen=True)
class StructureAverage:
    """Several structures as one: `Drawn` of the terms of all, 0 if one lacks a term.

    Attributes:
        members: posterior of each, the most probable first.
        weights: their probabilities, which sum to 1.
    """

    members: tuple[Estimate, ...]
    weights: tuple[float, ...]

    @property
    def key(self) -> str:
        """Key of everything that it depends on."""
        return key_of("average", [one.key for one in self.members], self.weights)

    @property
    def structure(self) -> Structure:
        """All terms."""
        return widest([one.structure for one in self.members])

    @property
    def labels(self) -> dict[str, float]:
        """Weight of each structure by its label."""
        return dict(zip([one.structure.label for one in self.members], self.weights, strict=True))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(dict.fromkeys(name for one in self.members for name in one.names))

    def draws(self, names: Sequence[str] | None = None) -> Float[np.ndarray, "n k"]:
        """Draws of the named parameters, SI, those of one structure after another."""
        names, pieces = self.names if names is None else names, []
        total = len(self.members[0].draws())
        for one, weight in zip(self.members, self.weights, strict=True):
            table = one.draws()
            rows = np.linspace(0, len(table) - 1, round(weight * total)).astype(int)
            own = dict(zip(one.names, table[rows].T, strict=True))
            pieces.append(np.column_stack([own.get(name, np.zeros(rows.size)) for name in names]))
        return np.concatenate(pieces)


def average_of(campaign: Campaign, estimates: Sequence[Estimate], selection: Selection) -> Estimate | StructureAverage:
    """Return the structures within `STANDING` nats of the chosen one that have its states and controls; it alone where no other is."""
    standing = [
        int(i)
        for i in np.argsort(-selection.probability, kind="stable")
        if selection.probability[i] >= np.exp(-STANDING) * selection.probability[selection.chosen]
    ]
    models = [campaign.model(selection.structures[i]) for i in standing] if len(standing) > 1 else []
    motions = [(one.states, one.controls) for one in models]
    alike = [i for i, motion in zip(standing, motions, strict=False) if motion == motions[0]]
    if len(alike) < 2:
        return estimates[selection.chosen]
    weights = selection.probability[alike] / selection.probability[alike].sum()
    return StructureAverage(tuple(estimates[i] for i in alike), tuple(map(float, weights)))
