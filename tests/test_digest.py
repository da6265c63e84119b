"""The digest of two versions: the texts that it makes smaller exist, and its verdict follows its three rules."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "release"))
from digest import CASES, ROOT, compare, leaves


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_texts_made_smaller_stand_in_the_campaign(case):
    text = (ROOT / case.source).read_text(encoding="utf-8")
    assert [old for old in case.smaller if old not in text] == []


def digest(numbers, **words):
    return {"numbers": numbers, "words": words}


@pytest.mark.parametrize(
    ("key", "after", "differs"),
    [
        ("case/design/gain", 1.0 + 1e-10, False),
        ("case/design/gain", 1.0 + 1e-8, True),
        ("case/estimate --by mode/values[X_u]/value", 1.0 + 1e-9, False),
        ("case/estimate --by mode/values[X_u]/value", 1.0 + 1e-7, True),
        ("case/run/mean", 1.5, False),
    ],
    ids=["rounding", "fixed", "mode within 1e-6 sd", "mode beyond", "draws of one seed are not judged"],
)
def test_one_number_is_judged_by_its_rule(key, after, differs):
    beside = {"case/estimate --by mode/values[X_u]/sd": [0.01]}
    assert compare(digest({key: [1.0], **beside}), digest({key: [after], **beside})) == differs


@pytest.mark.parametrize(("shift", "differs"), [(0.0, False), (4.0, True)])
def test_draws_are_judged_together_by_the_spread_of_their_seeds(shift, differs):
    rng = np.random.default_rng(5)
    before, after = ({f"case/run/{i}": rng.normal(size=4).tolist() for i in range(400)} for _ in range(2))
    moved = {key: [value + shift * (i < 20) for value in values] for i, (key, values) in enumerate(after.items())}
    assert compare(digest(before), digest(moved)) == differs


def test_numbers_that_vanish_differ_and_words_decide_nothing(capsys):
    assert compare(digest({"case/check/a": [1.0]}), digest({})) == 1
    assert compare(digest({}), digest({"case/check/a": [1.0]})) == 0
    assert compare(digest({}, a=["one"]), digest({}, a=["another"])) == 0
    assert "words that changed: 1" in capsys.readouterr().out


def test_objects_of_a_list_are_named_by_what_they_are():
    tree = {"structures": [{"label": "M-1", "sd": 2.0}, {"label": "M-0", "sd": None}]}
    assert [key for key, _ in leaves("case", tree)] == [
        *("case/structures[M-1]/label", "case/structures[M-1]/sd"),
        *("case/structures[M-0]/label", "case/structures[M-0]/sd"),
    ]
