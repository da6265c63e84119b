"""Blocks are found with their remarks, console blocks fall into commands, and a wrong block is not passed over."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from block_work import excerpt  # noqa: E402
from blocks import commands, read_blocks  # noqa: E402
from toml_tables import laid_over  # noqa: E402

PAGE = """
Text.

<!-- block: exit 3 -->
<!-- block: first 2 -->
```console
$ seatrial check demo
record a: pass
$ ls
```

<!-- run sh
touch a
-->
```text
not run
```
"""


def test_blocks_and_their_remarks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    shown, hidden = read_blocks(page)
    assert (shown.language, shown.remarks) == ("console", {"exit": "3", "first": "2"})
    assert commands(shown) == [("seatrial check demo", ("record a: pass",)), ("ls", ())]
    assert (hidden.language, hidden.lines, hidden.remarks) == ("sh", ("touch a",), {})


def test_a_command_goes_on_after_a_backslash(tmp_path):
    (tmp_path / "page.md").write_text("```console\n$ seatrial init a \\\n  --mass '3 kg'\nwrote a\n```\n")
    (block,) = read_blocks(tmp_path / "page.md")
    assert commands(block) == [("seatrial init a \\\n  --mass '3 kg'", ("wrote a",))]


def test_a_block_of_unknown_language_is_an_error(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```\nls\n```\n")
    assert read_blocks(page)[0].remarks == {"skip": "no language"}
    page.write_text("```perl\nls\n```\n")
    with pytest.raises(ValueError, match="perl"):
        read_blocks(page)


def test_an_excerpt_keeps_the_lines_of_the_page():
    assert excerpt(("a 1", "...", "c"), ["a 2", "b", "b", "c", "d"]) == ["a 2", "...", "c", "..."]


def test_fragments_are_laid_over_a_file():
    base = '[a]\nx = 1\ny = "z"\n[prior.p]\nlower = 0.0\n[gone]\nk = true\n'
    text = laid_over(base, '[a]\nx = 2\n[prior.p]\nmean = 1.5\n[[b.c]]\nd = ["\\\\", {e = false}]\n', ["gone"])
    assert tomllib.loads(text) == {
        "a": {"x": 2, "y": "z"},
        "prior": {"p": {"mean": 1.5}},
        "b": {"c": [{"d": ["\\", {"e": False}]}]},
    }


def test_a_failing_block_ends_the_run(tmp_path):
    """A command that ends otherwise than stated counts, and what comes after it is not run."""
    demo, page = tmp_path / "demo", DOCS / "_build" / "page-of-a-test.md"
    demo.mkdir()
    page.parent.mkdir(exist_ok=True)
    page.write_text("```console\n$ false\n```\n```console\n$ echo one\ntwo\n```\n")
    try:
        command = [sys.executable, DOCS / "run_blocks.py", "--demo", demo, page]
        done = subprocess.run(command, capture_output=True, text=True)
    finally:
        page.unlink()
    assert done.returncode == 1
    assert "`false` ended with 1, not 0" in done.stdout
