"""Pages of studies show the numbers that stand in the JSON files beside them."""

import json
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

import term_probabilities  # noqa: E402
import towing_tank  # noqa: E402


def numbers(name):
    return json.loads((DOCS / "dev" / f"{name}.json").read_text()), (DOCS / "dev" / f"{name}.md").read_text()


def test_the_towing_tank():
    found, page = numbers("towing_tank")
    assert page.endswith(towing_tank.tables(found["free running"], found["captive"], found["printed"]))


def test_term_probabilities():
    found, page = numbers("term_probabilities")
    for arm, about in term_probabilities.ARMS.items():
        for words in term_probabilities.KINDS:
            assert term_probabilities._row(about.words, words, found[f"{arm}, {words}"]) in page


def test_mmg_with_rudder_by_hand():
    """A rudder of lift slope c at 0.5 L aft adds force and moment in proportion to the angle of the flow; it damps both motions."""
    found = towing_tank.with_rudder()
    force, moment = found["Y_delta"], found["N_delta"]
    assert moment / force == pytest.approx((-0.5 - 0.312 * 0.464) / 1.312)
    added = {name: found[name] - towing_tank.HULL[name] for name in towing_tank.HULL}
    assert added["Y_v"] < 0 < added["Y_r"]
    assert added["N_r"] < 0 < added["N_v"]
    assert added["N_v"] / added["Y_v"] == pytest.approx(added["N_r"] / added["Y_r"])
