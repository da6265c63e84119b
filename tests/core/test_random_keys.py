"""Keys worked out on the host against those of JAX, bit by bit."""

import jax
import numpy as np
import pytest

from seatrial.core.random_keys import seeded_key


@pytest.mark.parametrize("seed", [0, 7, 2**31, 2**40 + 5, 2**63 - 1, -3])
@pytest.mark.parametrize("numbers", [(), (0,), (2**32 - 1, 3)])
def test_keys_are_those_of_jax(seed, numbers):
    expected = jax.random.key(seed, impl="threefry2x32")
    for number in numbers:
        expected = jax.random.fold_in(expected, np.uint32(number))
    found = seeded_key(seed, *numbers)
    assert found.dtype == expected.dtype
    assert (jax.random.key_data(found) == jax.random.key_data(expected)).all()
