"""`python -m studies.remus100` as a user meets it."""

import re
import sys

import pytest

from seatrial.cli.running import Exit, run_app
from studies.remus100.__main__ import app
from studies.remus100.registry import ENTRIES
from tests.cli.test_cli import results

MISTAKES = {
    "unknown item": (["--only", "tabel-3"], ['"tabel-3"', 'did you mean "table-3"?']),
    "one unknown item of several": (["--only", "table-3,nonsense", "--only", "figure-1"], ['"nonsense"', "--only"]),
    "no item": (["--only", ""], ['""', "--only"]),
    "unknown reading": (["--reading", "C"], ["--reading", '"C"', "A or B"]),
}


def run(monkeypatch, capsys, *arguments):
    """Exit code, standard output and standard error of the study."""
    monkeypatch.setattr(sys, "argv", ["remus100", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        run_app(app)
    return ended.value.code, *capsys.readouterr()


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_said_before_any_work(monkeypatch, capsys, tmp_path, name):
    arguments, words = MISTAKES[name]
    monkeypatch.chdir(tmp_path)
    code, out, err = run(monkeypatch, capsys, *arguments)
    assert (code, out) == (Exit.BAD_INPUT, "")
    for word in ("error:", "remedy", *words):
        assert word in err
    assert results(tmp_path) == []


def test_an_unknown_item_lists_them_all(monkeypatch, capsys, tmp_path):
    _, _, err = run(monkeypatch, capsys, tmp_path, "--only", "nonsense")
    listed = re.findall(r"[a-z0-9-]+", err.partition("items among")[2].partition("\n")[0])
    assert listed == list(ENTRIES)


def test_one_item_in_a_folder_named_after_the_options(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(monkeypatch, capsys, "--only", "figure-5", "--reading", "b", "--quick", "--quiet")
    assert code == Exit.OK
    assert out.startswith("figure-5  reproduced\n")
    assert "--quick" in out
    assert (tmp_path / "paper-B-quick" / "paper.json").is_file()
    assert "report: " in out
