"""Random keys worked out on the host: the bits of `jax.random.key`, `fold_in` and `split`, without programs compiled for them.

The generator is Threefry-2x32 with 20 rounds: Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as 1, 2, 3, SC11, 2011.
"""

import zlib

import jax
import numpy as np

WORD = 0xFFFFFFFF
PARITY = 0x1BD11BDA
ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))


def seeded_key(seed: int, *numbers: int) -> jax.Array:
    """Return `jax.random.key(seed)` into which numbers are folded, one after another, by `jax.random.fold_in`.

    Args:
        seed: from -2^63 to 2^63 - 1.
        numbers: from 0 to 2^32 - 1.
    """
    key = (seed >> 32 & WORD, seed & WORD)
    for number in numbers:
        key = _threefry(key, (0, number & WORD))
    return jax.random.wrap_key_data(np.array(key, np.uint32), impl="threefry2x32")


def random_key(seed: int, purpose: str) -> jax.Array:
    """Return the random key of one piece of work, from a seed and the work's name."""
    return seeded_key(seed, zlib.crc32(purpose.encode()))


def fold_in(key: jax.Array, number: int) -> jax.Array:
    """Return `jax.random.fold_in(key, number)`.

    Args:
        key: one key, not traced.
        number: from 0 to 2^32 - 1.
    """
    if not jax.numpy.issubdtype(key.dtype, jax.dtypes.prng_key) or str(jax.random.key_impl(key)) != "threefry2x32":
        return jax.random.fold_in(key, number)
    left, right = map(int, np.asarray(jax.random.key_data(key)))
    return jax.random.wrap_key_data(np.array(_threefry((left, right), (0, number)), np.uint32), impl="threefry2x32")


def split(key: jax.Array, count: int = 2) -> tuple[jax.Array, ...]:
    """Return `jax.random.split(key, count)`, where JAX splits keys so that they may be split on several devices, as it does by default.

    Args:
        key: one key, not traced.
        count: keys.
    """
    return tuple(fold_in(key, number) for number in range(count))


def _threefry(key: tuple[int, int], words: tuple[int, int]) -> tuple[int, int]:
    """Encrypt two words of 32 bits by a key of two."""
    keys = (*key, key[0] ^ key[1] ^ PARITY)
    left, right = (words[0] + keys[0]) & WORD, (words[1] + keys[1]) & WORD
    for turn in range(5):
        for by in ROTATIONS[turn % 2]:
            left = (left + right) & WORD
            right = ((right << by | right >> (32 - by)) & WORD) ^ left
        left = (left + keys[(turn + 1) % 3]) & WORD
        right = (right + keys[(turn + 2) % 3] + turn + 1) & WORD
    return left, right
