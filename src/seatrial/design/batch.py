"""Several trials planned together: those whose information, added up, is worth most.

Information of independent trials adds up, F = sum F_i. Trials are taken one after another, each the best beside those taken, and
then exchanged one by one while that helps (Fedorov, Theory of Optimal Experiments, 1972). A design may be taken twice.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Utility = Callable[[np.ndarray], np.ndarray]
"""Utilities, shape (..., S), of information matrices, shape (..., S, k, k)."""
EXCHANGE_ROUNDS = 20  # Exchanges of every trial, at most


@dataclass(frozen=True)
class Batch:
    """Trials planned together.

    Attributes:
        designs: index of each, in the order of what each adds.
        utility: of the first, of the first two, and so on, averaged over the draws.
        repeated: utility of the single best design as often.
    """

    designs: tuple[int, ...]
    utility: tuple[float, ...]
    repeated: float


def plan_batch(information: Float[np.ndarray, "D S k k"], utility: Utility, trials: int) -> Batch:
    """Choose so many trials of D designs, weighed over S draws of the coefficients.

    Args:
        information: Fisher information of every design at every draw, SI.
        utility: of the sum.
        trials: how many.
    """

    def worth(base: np.ndarray) -> np.ndarray:
        return np.asarray(utility(base + information)).mean(-1)

    nothing = np.zeros_like(information[0])
    chosen = [int(np.argmax(worth(nothing)))]
    repeated = float(np.asarray(utility(trials * information[chosen[0]])).mean())
    while len(chosen) < trials:
        chosen.append(int(np.argmax(worth(information[chosen].sum(0)))))
    best = float(np.asarray(utility(information[chosen].sum(0))).mean())
    for _ in range(EXCHANGE_ROUNDS):
        before = best
        for place in range(trials):
            others = information[chosen[:place] + chosen[place + 1 :]].sum(0) if trials > 1 else nothing
            result = worth(others)
            if result.max() > best + 1e-9 * abs(best):
                chosen[place], best = int(np.argmax(result)), float(result.max())
        if best == before:
            break
    return Batch(*_in_order(information, worth, nothing, chosen, utility), repeated)


def _in_order(
    information: np.ndarray, worth: Callable, nothing: np.ndarray, chosen: list[int], utility: Utility
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return the trials chosen, each the best beside those before it, so that fewer may be run."""
    left, order, reached, base = list(chosen), [], [], nothing
    while left:
        gains = worth(base)[left]
        order.append(left.pop(int(np.argmax(gains))))
        base = base + information[order[-1]]
        reached.append(float(np.asarray(utility(base)).mean()))
    return tuple(order), tuple(reached)
