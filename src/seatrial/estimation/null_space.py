"""Changes of several parameters at once that leave every measurement as it is: the null space of the scaled information."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.estimation.remedies import listed

INVISIBLE = 1e-10
"""Eigenvalue of the information, its diagonal scaled to one, over the largest, below which a combination is invisible."""
SHOWN = 1e-3
"""Share of the largest effect on the measurements, each parameter's taken alone, below which it is not named as part of a change."""


class Unknown(NamedTuple):
    """What these functions need of each parameter.

    Attributes:
        names: names.
        units: SI units.
        values: values.
        scale: change of each parameter that counts as one in the scaled information: its value where that is known, else its
            prior standard deviation.
        relative: whether `scale` is the value, so that scaled changes are relative ones.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " d"]
    scale: Float[np.ndarray, " d"]
    relative: np.ndarray

    def pick(self, chosen: Sequence[int]) -> "Unknown":
        """Some of them."""
        at = list(chosen)
        names, units = tuple(self.names[i] for i in at), tuple(self.units[i] for i in at)
        return Unknown(names, units, self.values[at], self.scale[at], self.relative[at])


class Invisible(NamedTuple):
    """A change of several parameters at once that leaves every measurement as it is.

    Attributes:
        names: parameters that change.
        steps: by how much, in units of `Unknown.scale`, the smallest being one.
        relative: whether each step is a share of the parameter's value.
    """

    names: tuple[str, ...]
    steps: tuple[float, ...]
    relative: tuple[bool, ...]

    @property
    def is_scale(self) -> bool:
        """Whether all of them grow alike, so that their ratios are known."""
        return all(self.relative) and np.ptp(self.steps) < 1e-3 * abs(self.steps[0])

    @property
    def text(self) -> str:
        """The change in words."""
        if self.is_scale and len(self.names) > 1:
            return f"{listed(self.names)} scale together: only their ratios are known"
        parts = [
            f"{name} by {step:+.3g} %" if share else f"{name} by {0.01 * step:+.3g} prior standard deviations"
            for name, step, share in zip(self.names, self.steps, self.relative, strict=True)
        ]
        return f"changing {listed(parts)} leaves every measurement as it is"


def null_combinations(information: Float[np.ndarray, "d d"], unknown: Unknown) -> tuple[Invisible, ...]:
    """Combinations without information, each with as few parameters as elimination leaves.

    The rank is judged with every diagonal entry scaled to one, so that it depends on no unit, value or prior.

    Args:
        information: of the data, in the parameters' own units, of parameters the data touch at all.
        unknown: the parameters.
    """
    size = np.sqrt(np.abs(np.diag(information)))
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(size, size))
    found = []
    for effect in _eliminated(vectors[:, eigenvalues < INVISIBLE * eigenvalues[-1]].T):
        named = np.flatnonzero(np.abs(effect) > SHOWN * np.abs(effect).max())
        part = unknown.pick(named)
        steps = effect[named] / (size[named] * part.scale)
        steps = steps / np.abs(steps).min() * np.sign(steps[0])
        found.append(Invisible(part.names, tuple(map(float, steps)), tuple(map(bool, part.relative))))
    return tuple(found)


def _eliminated(rows: Float[np.ndarray, "r d"]) -> Float[np.ndarray, "r d"]:
    """The same space by rows of which each has a one where the others have zeros: Gauss and Jordan, largest pivots."""
    rows, free = rows.copy(), list(range(len(rows)))
    while free:
        which, column = np.unravel_index(np.argmax(np.abs(rows[free])), rows[free].shape)
        pivot = free.pop(which)
        rows[pivot] /= rows[pivot, column]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, column] * rows[pivot]
    return rows
