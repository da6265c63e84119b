"""Sine and cosine in double precision that a compiler vectorises, which it cannot do with those of the C library.

The angle is taken modulo a quarter turn with pi/2 in three parts (Cody and Waite, Software Manual for the Elementary Functions, 1980), and
what remains, |r| <= pi/4, goes into the Taylor series up to r^17 and r^18, whose next terms are below 1e-17.
"""

from math import factorial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# pi/2 in parts, the first two of 33 bits, so that their products with a number of quarter turns up to 2^20 are exact.
QUARTER = 1.5707963267341256, 6.0771005063039660e-11, 2.0222662487959506e-21
_SINE = [(-1) ** n / factorial(2 * n + 1) for n in range(8, 0, -1)]
_COSINE = [(-1) ** n / factorial(2 * n) for n in range(9, 1, -1)]


@jax.custom_jvp
def sine_and_cosine(angle: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Return the sine and cosine of an angle, rad, to a unit in the last place up to some 10^6 rad."""
    turns = jnp.round(angle * (2.0 / jnp.pi))
    rest = angle
    for part in QUARTER:
        rest = rest - turns * part
    square = rest * rest
    sine = rest + rest * square * _series(_SINE, square)
    cosine = 1.0 - 0.5 * square + square * square * _series(_COSINE, square)
    quarter = turns - 4.0 * jnp.floor(0.25 * turns)
    odd = (quarter == 1.0) | (quarter == 3.0)
    first, second = jnp.where(odd, cosine, sine), jnp.where(odd, sine, cosine)
    return (
        jnp.where(quarter >= 2.0, -first, first),
        jnp.where((quarter == 1.0) | (quarter == 2.0), -second, second),
    )


@sine_and_cosine.defjvp
def _slope(primals: tuple, tangents: tuple) -> tuple[tuple, tuple]:
    sine, cosine = sine_and_cosine(*primals)
    return (sine, cosine), (cosine * tangents[0], -sine * tangents[0])


def _series(coefficients: list[float], square: Array) -> Array:
    total = jnp.full_like(square, coefficients[0])
    for coefficient in coefficients[1:]:
        total = total * square + coefficient
    return total
