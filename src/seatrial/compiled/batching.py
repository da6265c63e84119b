"""How many lanes and samples go at once, and which loops stay loops, on the backend in use; a lane is one simulation of many that differ.

On a processor a block of lanes should fit its cache, and a whole time loop is one kernel. On an accelerator every turn of a
loop is launched anew, and takes as long for one lane as for thousands: all lanes go at once, as far as its memory holds them.

Blocks of other sizes give the same numbers to rounding, not to the bit: the compiler orders sums by the shape it is given.
"""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np

# Bytes on an accelerator that one call may take: two thirds of what JAX reserves on a card of 16 GB, one of the
# smallest that are made for double precision. The same on every card, so that equal cards of unequal memory give equal
# bits.
MEMORY = 8 << 30
_FEW_LANES = 8  # Lanes of the smaller of two calls from which is told what a lane takes


def bucket_length(samples: int) -> int:
    """Return the length to which arrays of so many samples are filled, at most an eighth more: like lengths share compiled programs."""
    unit = max(1, 1 << max(0, (samples - 1).bit_length() - 4))
    return -(-samples // unit) * unit


def filled(array: Any, samples: int, value: float | None = None) -> np.ndarray:
    """Return an array whose first axis counts samples, filled up with a value, or with its last sample where none is given."""
    array = np.asarray(array)
    more = [(0, samples - len(array)), *[(0, 0)] * (array.ndim - 1)]
    return np.pad(array, more, "edge") if value is None else np.pad(array, more, constant_values=value)


def backend() -> str:
    """What compiled code runs on: `cpu`, `gpu` or `tpu`, by JAX's default device where one is set."""
    device = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return jax.default_backend() if device is None else getattr(device, "platform", device)


def on_accelerator() -> bool:
    """Whether compiled code runs on something else than a processor."""
    return backend() != "cpu"


def lanes_at_once(run: Callable, *many: Any, cpu: int) -> int:
    """Lanes in one call: on a processor the number given; elsewhere a power of two, for all of them or as many as `MEMORY` holds.

    Powers of two, and no fewer than on a processor, keep few the programs to compile for calls of many sizes.

    Args:
        run: function of lanes that is to be called; here it is only traced, and not even that on a processor. One that is compiled
            is traced once for calls of a kind; one that cannot be traced gets the number of a processor.
        many: its arguments, arrays or trees of them whose first axis counts all lanes; only their shapes matter.
        cpu: number on a processor.
    """
    if not on_accelerator():
        return cpu
    try:
        few, twice = (_bytes_made(run, many, count) for count in (_FEW_LANES, 2 * _FEW_LANES))
    except jax.errors.JAXTypeError:  # a part of it is computed outside JAX
        return cpu
    each = max(1, (twice - few) // _FEW_LANES)
    shared = max(0, few - _FEW_LANES * each)
    fitting = max(1, (MEMORY - shared) // each)
    wanted = max(cpu, jax.tree.leaves(many)[0].shape[0])
    return min(1 << (wanted - 1).bit_length(), 1 << (fitting.bit_length() - 1))


def map_lanes(function: Callable, many: Any, cpu: int = 1) -> Any:
    """`jax.lax.map` of a function of one lane, so many lanes at once; to be called in compiled code.

    Args:
        function: of one lane.
        many: array or tree of arrays, whose first axis counts lanes.
        cpu: lanes at once on a processor.
    """
    count = lanes_at_once(jax.vmap(function), many, cpu=cpu)
    return jax.lax.map(function, many, batch_size=count if count > 1 else None)


def map_in_step(function: Callable, many: Any) -> Any:
    """Apply a function to a few things inside a time step: a loop that compiles it once on a processor, side by side elsewhere."""
    return jax.vmap(function)(many) if on_accelerator() else jax.lax.map(function, many)


def _bytes_made(run: Callable, many: Any, count: int) -> int:
    """Bytes of all arrays that a call with so many lanes is given or makes, none freed before the end: more than it can need."""
    some = jax.tree.map(lambda x: jax.ShapeDtypeStruct((count, *x.shape[1:]), x.dtype), many)
    return sum(map(_size, jax.tree.leaves(some))) + _bytes_of(jax.make_jaxpr(run)(*some).jaxpr)


def _bytes_of(jaxpr: Any) -> int:
    """Bytes of what equations make; the body of a loop, whose turns reuse its memory, is counted once."""
    total = 0
    for equation in jaxpr.eqns:
        inner = list(_inner(equation.params.values()))
        if not inner or equation.primitive.name == "scan":  # other wrappers hand on what is made inside them
            total += sum(_size(out.aval) for out in equation.outvars if hasattr(out.aval, "size"))
        total += sum(map(_bytes_of, inner))
    return total


def _size(array: Any) -> int:
    return array.size * array.dtype.itemsize


def _inner(values: Any) -> Iterator[Any]:
    for value in values:
        if isinstance(value, tuple | list):
            yield from _inner(value)
        elif hasattr(value, "jaxpr"):
            yield value.jaxpr
        elif hasattr(value, "eqns"):
            yield value
