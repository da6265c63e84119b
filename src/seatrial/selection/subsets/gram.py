"""What a linear regression needs of its data: G = Phi^T Phi, h = Phi^T y, y^T y and n; it adds up over trials.

One regressor that never changes is an offset, and allowed. Two of them, or two in proportion, cannot be separated.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError

MOST_ALIKE = 1 - 1e-8  # Cosine of the angle between two regressors above which they count as one
LEAST_INDEPENDENT = 1e-10  # Smallest eigenvalue of G with unit diagonal at which no combination of regressors vanishes
PART_OF = 0.1  # Weight in a vanishing combination from which a regressor is named


class Gram(NamedTuple):
    """Sufficient statistics of n measurements of one response and k regressors.

    Attributes:
        matrix: G = Phi^T Phi, shape (k, k).
        moment: h = Phi^T y, shape (k,).
        square: y^T y.
        n: number of measurements.
    """

    matrix: Float[np.ndarray, "k k"]
    moment: Float[np.ndarray, " k"]
    square: float
    n: int


def gram(phi: Float[np.ndarray, "n k"], y: Float[np.ndarray, " n"]) -> Gram:
    """Return the statistics of one trial; errors of y are white and of one variance.

    Args:
        phi: regressors, a column for each term.
        y: response.
    """
    return Gram(phi.T @ phi, phi.T @ y, float(y @ y), y.size)


def check_gram(stats: Gram, names: Sequence[str]) -> None:
    """Check that the data can tell the terms apart.

    Raises:
        InputError: too few measurements, a regressor that is zero throughout, two in proportion,
            or a combination of several that vanishes.
    """
    if stats.n < max(len(names), 3):
        raise InputError(
            "linear regression",
            found=f"{stats.n} measurements for {len(names)} terms",
            expected=f"at least {max(len(names), 3)}",
            remedy="give a longer record, add trials, or consider fewer terms",
        )
    norm = np.sqrt(np.diag(stats.matrix))
    if not norm.all():
        raise _cannot_tell(
            f"the regressor of {names[int(np.argmin(norm))]} is zero throughout",
            "leave it out, or run a trial that excites it",
        )
    cosine = stats.matrix / np.outer(norm, norm)
    apart = np.abs(np.triu(cosine, 1))
    i, j = divmod(int(np.argmax(apart)), len(names))
    if apart[i, j] > MOST_ALIKE:
        raise _cannot_tell(
            f"the regressors of {names[i]} and {names[j]} are proportional, their correlation (about zero) is {cosine[i, j]:.10f}",
            "leave out one of the two, or run a trial over more speeds",
        )
    values, vectors = np.linalg.eigh(cosine)
    if values[0] < LEAST_INDEPENDENT:
        involved = [name for name, weight in zip(names, vectors[:, 0], strict=True) if abs(weight) > PART_OF]
        raise _cannot_tell(
            f"a combination of the regressors of {', '.join(involved)} vanishes (smallest eigenvalue {values[0]:.1e})",
            "leave out one of them, or run a trial over more speeds",
        )


def _cannot_tell(found: str, remedy: str) -> InputError:
    return InputError("linear regression", found=found, expected="regressors that the data separate", remedy=remedy)
