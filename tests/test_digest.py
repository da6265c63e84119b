"""The digest of two versions makes campaigns smaller by their text: that text has to be there."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "release"))
from digest import CASES, ROOT


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_what_is_made_smaller_is_in_the_campaign(case):
    text = (ROOT / case.source).read_text(encoding="utf-8")
    assert [old for old in case.smaller if old not in text] == []
