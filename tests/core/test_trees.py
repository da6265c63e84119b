"""Structures of different classes differ, whatever their hashes; see `seatrial.compiled.pytrees`."""

from dataclasses import dataclass
from itertools import combinations

import jax
import pytest

from seatrial.compiled.pytrees import compiled_tree
from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Uniform
from seatrial.selection.further_modes import Cooled


@compiled_tree("name")
@dataclass(frozen=True)
class Known:
    name: str
    mean: float
    sd: float


ALIKE = [Uniform(1.0, 2.0), LogUniform(1.0, 2.0), Normal(1.0, 2.0), LogNormal(1.0, 2.0), Cooled(1.0, 2.0), (1.0, 2.0)]


@pytest.mark.parametrize(("one", "other"), list(combinations(ALIKE, 2)), ids=str)
def test_two_classes_never_share_what_was_compiled(one, other):
    """JAX compares structures by this equality where their hashes meet."""
    assert jax.tree.structure(one) != jax.tree.structure(other)


def test_fixed_fields_are_structure_and_the_rest_leaves():
    known = Known("X_u", 1.0, 2.0)
    leaves, structure = jax.tree.flatten(known)
    assert leaves == [1.0, 2.0]
    assert jax.tree.unflatten(structure, leaves) == known
    assert structure == jax.tree.structure(Known("X_u", 3.0, 4.0))
    assert structure != jax.tree.structure(Known("X_uabsu", 1.0, 2.0))
    assert [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(known)] == [".mean", ".sd"]
