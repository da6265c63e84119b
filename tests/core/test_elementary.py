"""Elementary functions of compiled code on long vectors against NumPy and SciPy: XLA has compiled one of them wrongly."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

WIDE = np.concatenate([-np.logspace(-6, 3, 2001), np.logspace(-6, 3, 2001)])
POSITIVE, UNIT = np.logspace(-8, 8, 4001), np.linspace(-0.999999, 0.999999, 4001)
PAIRS = {
    **{name: (getattr(jnp, name), getattr(np, name), WIDE) for name in ("sin", "cos", "tan", "arctan", "tanh")},
    **{name: (getattr(jnp, name), getattr(np, name), POSITIVE) for name in ("log", "log1p", "sqrt")},
    **{name: (getattr(jnp, name), getattr(np, name), UNIT) for name in ("arcsin", "arccos", "exp", "expm1")},
    "erf": (jax.scipy.special.erf, scipy.special.erf, WIDE),
    "ndtri": (jax.scipy.special.ndtri, scipy.special.ndtri, (UNIT + 1) / 2),
    "gammaln": (jax.scipy.special.gammaln, scipy.special.gammaln, POSITIVE),
    "arctan2 ahead": (lambda x: jnp.arctan2(x, 1.0), lambda x: np.arctan2(x, 1.0), WIDE),
    "arctan2 abeam": (lambda x: jnp.arctan2(1.0, x), lambda x: np.arctan2(1.0, x), WIDE),
}


@pytest.mark.parametrize("name", PAIRS)
def test_vectors_of_elementary_functions(name):
    ours, theirs, values = PAIRS[name]
    np.testing.assert_allclose(np.asarray(jax.jit(ours)(values)), theirs(values), rtol=1e-11, atol=1e-12)
