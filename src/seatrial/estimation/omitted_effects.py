"""Score test of effects that a fitted model leaves out: how large each would be, and by how much it would move the parameters.

With residuals r and sensitivities J over the noise, posterior covariance C, and the signature g of an effect that is left out,

    information = g^T (I - J C J^T) g,  size = g^T (I - J C J^T) r / information,  shift of the parameters = -C J^T g size

(Rao, Proc. Camb. Phil. Soc. 44, 1948). Size^2 x information is chi-square with one degree of freedom where nothing is missing.
A model may explain nearly all of its data and still be wrong in this way: what it lacks hides in its coefficients.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

HIDDEN = 1e-4
"""Share of a signature that the parameters must leave for it to be told from them."""


class Omitted(NamedTuple):
    """One effect that the model lacks.

    Attributes:
        name: of the effect.
        size: its estimated size, in the unit of its signature.
        sd: standard error of the size.
        p_value: probability of as large a size where the effect is absent.
        shift: by how much the parameters would move if it were added, in their own units, shape (k,).
    """

    name: str
    size: float
    sd: float
    p_value: float
    shift: Float[np.ndarray, " k"]


def score_effects(
    residual: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n k"],
    cov: Float[np.ndarray, "k k"],
    signatures: Mapping[str, Float[np.ndarray, " n"]],
    worth: float = 1.0,
) -> list[Omitted]:
    """Test every effect by itself; those that the parameters can imitate entirely are left out.

    Args:
        residual: measured less predicted over the noise, 0 where missing.
        jacobian: change of the prediction with each parameter, over the noise, 0 where missing.
        cov: posterior covariance of the parameters.
        signatures: change of the prediction with each effect, over the noise, 0 where missing.
        worth: share of the samples that the residuals are worth where they are correlated.
    """
    results = []
    for name, signature in signatures.items():
        absorbed = cov @ (jacobian.T @ signature)
        information = float(signature @ signature - (jacobian.T @ signature) @ absorbed)
        if not information > HIDDEN * float(signature @ signature) > 0:
            continue
        size = float(signature @ residual - absorbed @ (jacobian.T @ residual)) / information
        sd = 1.0 / np.sqrt(information * worth)
        results.append(Omitted(name, size, float(sd), float(chdtrc(1, (size / sd) ** 2)), -absorbed * size))
    return results
