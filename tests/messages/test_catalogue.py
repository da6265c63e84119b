"""The catalogue of messages: every entry renders, and its page is that of the code."""

import json
from dataclasses import replace
from pathlib import Path
from runpy import run_path

import pytest

from seatrial.core.errors import InputError
from seatrial.core.findings import Finding, accept
from seatrial.core.serialise import from_plain, to_plain
from seatrial.messages.catalogue import ENTRIES, REMEDIES, SUBJECTS, entry_of
from seatrial.messages.explain import explanation
from seatrial.messages.render import blocks, remedy, sentences, statement

ROOT = Path(__file__).parents[2]
MAX_WORDS = 60


@pytest.mark.parametrize("code", ENTRIES)
def test_every_entry_renders_its_example(code):
    entry = ENTRIES[code]
    assert entry.example.code == code
    for form in ("command", "python", "page"):
        assert len(statement(entry.example).split()) < MAX_WORDS
        assert "{" not in statement(entry.example) + remedy(entry.example, form).replace("{ ", "")
    assert code in explanation(code)


def test_codes_and_remedies_are_unique():
    assert len(ENTRIES) == sum(len(file.ENTRIES) for file in SUBJECTS.values())
    assert len(REMEDIES) == sum(len(file.REMEDIES) for file in SUBJECTS.values())


def test_page_is_that_of_the_code():
    """`python docs/findings.py` writes it again."""
    assert (ROOT / "docs" / "dev" / "findings.md").read_text(encoding="utf-8") == run_path(
        str(ROOT / "docs" / "findings.py")
    )["page"]()


def test_unknown_code_names_the_nearest():
    with pytest.raises(InputError, match='did you mean "steps-too-long"'):
        entry_of("step-too-long")


def test_findings_survive_storage():
    for entry in ENTRIES.values():
        finding = entry.example.among(run="a", likewise=(("u", ("b", "c")),))
        assert from_plain(Finding, json.loads(json.dumps(to_plain(finding)))) == finding


def test_accepted_finding_is_one_line():
    example = ENTRIES["steps-too-long"].example
    (known,) = accept([example], {"steps-too-long"})
    assert (known.level, remedy(known)) == ("note", "")
    assert statement(known) == f"accepted: {statement(example)}"
    assert accept([example], {"another"}) == [example]


def test_equal_findings_of_several_runs_are_one_sentence():
    example = ENTRIES["steps-too-long"].example
    other = replace(example, subject=("X_u", "X_uu"))
    runs = [example.among(run=run) for run in ("a", "b", "c")]
    (first, second) = sentences([*runs, other])
    assert first.startswith(f"run a: {statement(example)} (in 3 runs, also b, c). Set step")
    assert second.startswith(statement(other))
    # A remedy that two findings share is printed once, below the last of them.
    assert ["\n" in text for text in blocks([*runs, other])] == [False, True]
