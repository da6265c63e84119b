"""Sine and cosine against NumPy's, their derivatives against each other, and that a compiled loop calls no library for them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.numerics.sine import sine_and_cosine

ANGLES = np.concatenate(
    [np.random.default_rng(0).uniform(-50, 50, 20_000), np.arange(-40, 41) * np.pi / 4, [0.0, 1e5, 1e-300]]
)


def test_to_the_last_place():
    sine, cosine = jax.jit(sine_and_cosine)(ANGLES)
    assert np.abs(sine - np.sin(ANGLES)).max() < 2.3e-16
    assert np.abs(cosine - np.cos(ANGLES)).max() < 2.3e-16


def test_what_is_no_number_stays_none():
    assert np.isnan(np.array(sine_and_cosine(jnp.array([np.nan, np.inf])))).all()


def test_first_and_second_derivatives():
    slope = jax.jacfwd(sine_and_cosine)
    for angle in (0.3, 1.7, -4.0):
        assert slope(angle) == pytest.approx((np.cos(angle), -np.sin(angle)), rel=1e-15)
        assert jax.grad(lambda x: slope(x)[0])(angle) == pytest.approx(-np.sin(angle), rel=1e-15)


def test_compiled_code_calls_no_library():
    text = jax.jit(jax.vmap(sine_and_cosine)).lower(np.zeros(64)).compile().as_text()
    assert "sine(" not in text
    assert "cosine(" not in text
