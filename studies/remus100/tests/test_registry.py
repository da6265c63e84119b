"""Items by name, and the parts they rest on."""

import inspect
import re

import pytest

from seatrial.core.errors import InputError
from studies.remus100 import (
    chain_verdicts,
    design_verdicts,
    equations,
    evidence,
    filter_verdicts,
    iteration,
    tuning,
    vehicle,
)
from studies.remus100.registry import ENTRIES, PARTS, chosen_items
from studies.remus100.study import Item

MODULES = (chain_verdicts, design_verdicts, equations, evidence, filter_verdicts, iteration, tuning, vehicle)
IN_THE_PAPER = [
    *("table-1", "figure-1", "table-2", "figure-2", "figure-3", "figure-4", "figure-5", "figure-6", "table-3"),
    *("listing-1", "table-4", "table-5", "table-6", "figure-7", "figure-8"),
]


def judges():
    """Public functions that take a study and give an item."""
    for module in MODULES:
        for name, function in inspect.getmembers(module, inspect.isfunction):
            own = function.__module__ == module.__name__ and not name.startswith("_")
            signature = inspect.signature(function)
            if own and list(signature.parameters) == ["study"] and signature.return_annotation is Item:
                yield function


def test_every_judge_has_an_entry():
    assert {judge.__name__ for judge in judges()} == {entry.judge.__name__ for entry in ENTRIES.values()}
    assert len({entry.judge for entry in ENTRIES.values()}) == len(ENTRIES)


def test_every_part_exists_and_is_needed():
    named = {part for entry in ENTRIES.values() for part in entry.parts}
    assert named <= set(PARTS)
    assert set(PARTS) <= named


def test_every_table_and_figure_is_there_in_the_order_of_the_paper():
    assert set(IN_THE_PAPER) <= set(ENTRIES)
    assert all(re.fullmatch(r"[a-z0-9-]+", key) for key in ENTRIES)
    for kind in ("table", "figure", "equations"):
        numbered = [int(key.split("-")[1]) for key in ENTRIES if re.fullmatch(rf"{kind}-\d", key)]
        assert numbered == sorted(numbered)


def test_no_choice_is_every_item():
    assert chosen_items([]) == tuple(ENTRIES)


def test_lists_with_commas_in_the_order_of_the_paper():
    assert chosen_items(["table-3, figure-1", "table-3", "claim-ridges,"]) == (
        "figure-1",
        "claim-ridges",
        "table-3",
    )


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("tabel-3", 'did you mean "table-3"?'), ("Figure-6", "figure-6"), ("zzz", "choose from the list")],
)
def test_an_unknown_item_lists_them_all(name, remedy):
    with pytest.raises(InputError) as raised:
        chosen_items(["table-1," + name])
    assert f'"{name}"' in raised.value.found
    assert remedy in raised.value.remedy
    assert re.findall(r"[a-z0-9-]{3,}", raised.value.expected.removeprefix("items among")) == list(ENTRIES)
