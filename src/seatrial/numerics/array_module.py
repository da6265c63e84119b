"""Which array library serves given values: what is neither traced nor JAX's own is worked out by NumPy, which compiles nothing."""

import sys
from types import ModuleType
from typing import Any

import numpy as np


def array_module(*values: Any) -> ModuleType:
    """Return `jax.numpy` where one of the values is an array of JAX or is traced, else NumPy.

    The same function thus serves inside a compiled program, and outside of one costs no program for every operation in it.
    """
    jax = sys.modules.get("jax")  # where it was never loaded no value is its own
    return jax.numpy if jax is not None and any(isinstance(value, jax.Array) for value in values) else np
