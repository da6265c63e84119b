"""NumPy serves what is NumPy's; JAX what is traced or its own."""

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.numerics.array_module import array_module
from seatrial.numerics.gaussian import Gaussian


def test_the_module_is_that_of_the_values():
    assert array_module(1.0, np.ones(2)) is np
    assert array_module(1.0, jnp.ones(2)) is jnp
    assert jax.jit(lambda x: jnp.ones(()) if array_module(1.0, x) is jnp else x)(0.0) == 1.0


def test_a_factor_that_is_none_is_nan_by_both():
    flat = np.zeros((2, 2))
    for kind in (np.asarray, jnp.asarray):
        assert np.isnan(Gaussian(kind(np.zeros(2)), kind(flat) * np.nan).marginal(1).chol_cov).all()
