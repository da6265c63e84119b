"""Pages of the catalogue are made from its numbers, and those in docs/ are current."""

from pathlib import Path

import pytest

from seatrial.report.vehicle_page import vehicle_page
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names

PAGES = Path(__file__).parents[2] / "docs" / "vehicles"


@pytest.mark.parametrize("name", vehicle_names())
def test_the_page_in_docs_is_current(name):
    """`python docs/vehicles.py` makes it again."""
    assert (PAGES / f"{name}.md").read_text(encoding="utf-8") == vehicle_page(name, load_vehicle(name))


def test_a_page_has_units_sources_and_what_is_fixed():
    page = vehicle_page("remus100_prestero", load_vehicle("remus100_prestero"))
    assert "| `Z_uudelta_s` | -9.64 | kg/(m rad) |  |" in page
    assert "| `X_udot` | -0.93 | kg | fixed |" in page
    assert "Prestero" in page
    assert "errata" in page


def test_a_page_says_which_way_each_control_turns():
    """Prestero's REMUS and Fossen's turn to opposite sides for the same rudder."""
    for name, side in (("remus100_prestero", "port"), ("remus100_fossen", "starboard")):
        page = vehicle_page(name, load_vehicle(name))
        assert f"| delta_r | turns to {side} |\n| delta_s | nose down |" in page
