"""Keys worked out on the host against those of JAX, bit by bit."""

import jax
import numpy as np
import pytest

from seatrial.compiled.random_keys import fold_in, seeded_key, split


@pytest.mark.parametrize("seed", [0, 7, 2**31, 2**40 + 5, 2**63 - 1, -3])
@pytest.mark.parametrize("numbers", [(), (0,), (2**32 - 1, 3)])
def test_keys_are_those_of_jax(seed, numbers):
    expected = jax.random.key(seed, impl="threefry2x32")
    for number in numbers:
        expected = jax.random.fold_in(expected, np.uint32(number))
    found = seeded_key(seed, *numbers)
    assert found.dtype == expected.dtype
    assert (jax.random.key_data(found) == jax.random.key_data(expected)).all()


@pytest.mark.parametrize("key", [jax.random.key(5), jax.random.PRNGKey(5), jax.random.key(5, impl="rbg")])
@pytest.mark.parametrize("number", [0, 3, 2**32 - 1])
def test_numbers_are_folded_into_keys_of_any_kind(key, number):
    found, expected = fold_in(key, number), jax.random.fold_in(key, np.uint32(number))
    assert found.dtype == expected.dtype
    assert (jax.random.key_data(found) == jax.random.key_data(expected)).all()


def test_parts_of_a_key_are_those_of_jax():
    expected = jax.random.split(jax.random.key(9), 5)
    assert all(
        (jax.random.key_data(a) == jax.random.key_data(b)).all()
        for a, b in zip(split(jax.random.key(9), 5), expected, strict=True)
    )
