"""Pages of studies show the numbers that stand in the JSON files beside them."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import study_numbers
import term_probabilities
import towing_tank


@pytest.mark.parametrize("study", [towing_tank, term_probabilities], ids=lambda study: study.__name__)
def test_pages_show_the_numbers(study):
    found = study_numbers.kept(name := study.__name__)
    assert (study_numbers.DEV / f"{name}.md").read_text().endswith(study.tables(found))
    assert found["commit"]


def test_mmg_with_rudder_by_hand():
    """A rudder of lift slope c at 0.5 L aft adds force and moment in proportion to the angle of the flow; it damps both motions."""
    found = towing_tank.with_rudder()
    force, moment = found["Y_delta"], found["N_delta"]
    assert moment / force == pytest.approx((-0.5 - 0.312 * 0.464) / 1.312)
    added = {name: found[name] - towing_tank.HULL[name] for name in towing_tank.HULL}
    assert added["Y_v"] < 0 < added["Y_r"]
    assert added["N_r"] < 0 < added["N_v"]
    assert added["N_v"] / added["Y_v"] == pytest.approx(added["N_r"] / added["Y_r"])
