"""Telling structures apart: how much evidence a trial brings that terms are there which a rival structure leaves out.

With terms A present at theta_A and the rival's own terms K free to make up for them within what is believed, P_K, the difference
of the log likelihoods is expected to be, to first order in theta_A,

    0.5 theta_A^T [F_AA - F_AK (F_KK + P_K^-1)^-1 F_KA] theta_A

It is the criterion T of Atkinson and Fedorov (Biometrika 62, 1975) for nested structures and Gaussian noise.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


@dataclass(frozen=True, eq=False)
class Discrimination:
    """Evidence, nats, against the rival that is hardest to tell from the structure that is believed in; from 0.

    Attributes:
        draws: coefficients of that structure, SI, shape (S, k).
        absent: terms that each rival lacks, shape (R, k).
        cov: covariance of the coefficients before the trial, SI, shape (k, k).
    """

    draws: Float[np.ndarray, "S k"]
    absent: Bool[np.ndarray, "R k"]
    cov: Float[np.ndarray, "k k"]
    name = "discrimination"
    unit = "nat"
    wording = "expected log likelihood ratio against the structure that is hardest to tell apart"

    def __call__(self, information: Float[Array, "*batch S k k"]) -> Float[Array, "*batch S"]:
        """Utility of information matrices, one for each draw along the axis before the last two."""
        xp = jnp if isinstance(information, jax.Array) else np
        return xp.stack([self._against(information, absent) for absent in self.absent]).min(0)

    def _against(self, information: Array, absent: np.ndarray) -> Array:
        xp = jnp if isinstance(information, jax.Array) else np
        a, kept = np.flatnonzero(absent), np.flatnonzero(~absent)
        theta = self.draws[:, a]
        force = (information[..., a, :] * theta[..., :, None]).sum(-2)
        alone = (force[..., a] * theta).sum(-1)
        if not kept.size:
            return 0.5 * alone
        free = information[..., kept[:, None], kept[None, :]] + np.linalg.inv(self.cov[np.ix_(kept, kept)])
        made_up = xp.linalg.solve(free, force[..., kept][..., None])[..., 0]
        return 0.5 * (alone - (force[..., kept] * made_up).sum(-1))
