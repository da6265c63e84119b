"""Every figure in README and docs has a command, a test or a source that shows it, and each of these is there."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def claims():
    spec = importlib.util.spec_from_file_location("claims", ROOT / "docs" / "claims.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_figure_stands_alone(claims):
    assert claims.unshown() == []


def test_no_entry_is_stale(claims):
    assert claims.broken() == []


def test_phrases_are_those_of_the_numbers(claims):
    assert claims.different() == []


def test_a_wrong_number_is_found(claims, tmp_path, monkeypatch):
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev" / "trial.json").write_text('{"one, two": {"share": 0.876, "slope": [-1.04, 0.07]}}')
    monkeypatch.setattr(claims, "DOCS", tmp_path)
    share, slope = "in {trial[one, two][share]:.0%} of", "{trial[one, two][slope][0]:.1f}"
    phrases = {
        "in 88 % of": share,
        "in 87 % of": share,
        "-1.0": slope,
        "-1.1": slope,
        "9": "{trial[three]}",
        "8": "{none[a]}",
    }
    entries = {phrase: {"shown": "python trial.py", "numbers": numbers} for phrase, numbers in phrases.items()}
    monkeypatch.setattr(claims, "registered", lambda: {"README.md": {"5 s": "make test"} | entries})
    assert claims.claims()["README.md"]["-1.0"] == "python trial.py"
    wrong = claims.different()
    assert wrong[:2] == [
        'README.md: "in 87 % of": its study has "in 88 % of"',
        'README.md: "-1.1": its study has "-1.0"',
    ]
    assert ['"9": its study has "KeyError' in wrong[2], '"8": its study has "FileNotFoundError' in wrong[3]] == [
        True,
        True,
    ]


def test_what_would_be_found(claims, tmp_path, monkeypatch):
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text(
        "# One\nIt takes 3 s.\n## Two\nAll of 5 % and `7`.\n```sh\nsleep 4\n```\nA REMUS 100.\n"
    )
    monkeypatch.setattr(claims, "ROOT", tmp_path)
    monkeypatch.setattr(claims, "DOCS", tmp_path / "docs")
    registered = {"README.md": {"## Two": "make test", "8 s": "tests/none.py", "3 s": "somebody said so"}}
    monkeypatch.setattr(claims, "claims", lambda: registered)
    assert claims.unshown() == []
    assert [line.split(": ", 1)[1] for line in claims.broken()] == [
        '"8 s" is not on the page',
        '"8 s": there is no tests/none.py',
        '"3 s": somebody said so begins with none of tests/, src/, benchmarks/, studies/, make , python , seatrial , source: ',
    ]
    del registered["README.md"]["## Two"], registered["README.md"]["3 s"]
    assert claims.unshown() == ["README.md:2: It takes 3 s.", "README.md:4: All of 5 % and `7`."]
