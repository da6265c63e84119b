"""The picture of the loop on the first pages has the words that `python docs/figures.py` writes, whoever edited them."""

import re
import sys
from pathlib import Path

import pytest

import seatrial as st

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from figures import panels, sheet  # noqa: E402


def words(picture):
    return re.findall(r">([^<>]*\w[^<>]*)<", picture)


@pytest.mark.proof
def test_the_picture_of_the_loop_has_the_words_of_the_code(tmp_path):
    st.init_campaign(tmp_path / "demo", "remus100")
    outcome = st.run_loop(st.load_campaign(tmp_path / "demo"))
    assert words(sheet(panels(outcome))) == words((DOCS / "loop.svg").read_text())
