"""Dataclasses that compiled code takes apart and puts together again: fields that hold numbers, and fields that are fixed.

JAX has a register of its own for dataclasses, which must not be used: it takes the structures of two classes with equal fixed
fields for equal, and separates them by their hash alone. Where two hashes fall together, which happens now and then, what
was compiled for a uniform prior serves a normal one, without a word (seen with JAX 0.10).
"""

from collections.abc import Callable, Iterable
from dataclasses import fields
from typing import Any, TypeVar

import jax

Kind = TypeVar("Kind", bound=type)


def compiled_tree(*fixed: str) -> Callable[[Kind], Kind]:
    """Decorate a dataclass: its fields become leaves of compiled code, or branches, those named `fixed` part of its structure.

    Compiled code puts it together without its `__init__`: leaves may be tracers or marks that no check of numbers understands.
    """

    def register(kind: Kind) -> Kind:
        numbers = [field.name for field in fields(kind) if field.name not in fixed]
        keys = [jax.tree_util.GetAttrKey(name) for name in numbers]
        jax.tree_util.register_pytree_with_keys(
            kind,
            lambda tree: (
                [(key, getattr(tree, key.name)) for key in keys],
                tuple(getattr(tree, name) for name in fixed),
            ),
            lambda structure, leaves: _assemble(kind, zip((*numbers, *fixed), (*leaves, *structure), strict=True)),
            lambda tree: ([getattr(tree, name) for name in numbers], tuple(getattr(tree, name) for name in fixed)),
        )
        return kind

    return register


def _assemble(kind: type, parts: Iterable[tuple[str, Any]]) -> Any:
    tree = object.__new__(kind)
    for name, part in parts:
        object.__setattr__(tree, name, part)
    return tree
