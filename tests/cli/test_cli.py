"""The command line as a user meets it: exit codes, one clear error on standard error, nothing half-written."""

import io
import os
import sys
import warnings
from contextlib import suppress
from unittest.mock import patch

import numpy as np
import pytest
import typer

from seatrial.__main__ import COMMANDS, main
from seatrial.cli import console
from seatrial.cli.console import ConsoleReporter
from seatrial.cli.main import description, grouped
from seatrial.cli.running import Exit, run_app, with_campaign
from seatrial.compiled.engine import EngineWarning
from tests.campaign.small import LOGGED, write_small


def run(monkeypatch, capsys, *arguments):
    """Exit code, standard output and standard error of one command."""
    monkeypatch.setattr(sys, "argv", ["seatrial", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, *capsys.readouterr()


def results(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["--version"]])
def test_help_is_given(monkeypatch, capsys, arguments):
    code, out, err = run(monkeypatch, capsys, *arguments)
    assert (code, err) == (Exit.OK, "")
    assert "seatrial" in out


def test_help_lists_every_command(monkeypatch, capsys):
    _, out, _ = run(monkeypatch, capsys, "--help")
    listed = [line.split() for line in out.splitlines() if line.startswith("  ")]
    in_groups = [name for names in grouped(COMMANDS).values() for name in names]
    assert [words[0] for words in listed if words[0] in COMMANDS and len(words) > 1] == in_groups
    assert sorted(in_groups) == sorted(COMMANDS)
    assert "..." not in out.partition("Start:")[2]
    assert all(len(line) <= 80 for line in out.splitlines())
    assert all(f"{description(one)}\n" in out for one in COMMANDS.values())


def test_unknown_command_names_the_nearest(monkeypatch, capsys):
    code, _, err = run(monkeypatch, capsys, "estimat", "somewhere")
    assert code == Exit.BAD_INPUT
    assert "estimate" in err


def test_former_command_names_its_successor(monkeypatch, capsys, tmp_path):
    code, _, err = run(monkeypatch, capsys, "rehearse", tmp_path)
    assert code == Exit.BAD_INPUT
    assert "seatrial plan DIR --vehicles" in err


@pytest.mark.parametrize("command", [name for name, one in COMMANDS.items() if one.makes and name != "export"])
def test_a_folder_that_is_no_campaign(monkeypatch, capsys, tmp_path, command):
    code, out, err = run(monkeypatch, capsys, command, tmp_path)
    assert (code, out) == (Exit.BAD_INPUT, "")
    assert "seatrial init" in err
    assert results(tmp_path) == []


REFUSED = {
    "no feasible design": (
        "design",
        ('amplitude = { from = "100 rpm"', 'amplitude = { from = "900 rpm"'),
        ('to = "200 rpm"', 'to = "1900 rpm"'),
        ["limits", "n"],
    ),
    "import of a simulated campaign": (
        "import",
        ("seed = 3", "seed = 3"),
        ("seed = 3", "seed = 3"),
        ["seatrial simulate"],
    ),
    "a truth that diverges": (
        "simulate",
        ("X_uabsu = -2.93", "X_uabsu = 2.93"),
        ("X_u = -1.21", "X_u = 31.0"),
        ["diverges", "dissipate"],
    ),
    "a prior that excludes the data": (
        "estimate",
        ("lower = -8.8\nupper = 0.0", "lower = -1.0\nupper = 0.0"),
        ("lower = -3.6\nupper = 1.2", "lower = -0.1\nupper = 0.1"),
        ["key prior.", "widen the prior"],
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_done_is_refused_with_a_remedy(monkeypatch, capsys, tmp_path, name):
    command, *replacements, words = REFUSED[name]
    write_small(tmp_path, *replacements)
    code, out, err = run(monkeypatch, capsys, command, tmp_path, "--quiet")
    assert (code, out) == (Exit.BAD_INPUT, "")
    assert "Traceback" not in err
    for word in ("error:", "remedy", *words):
        assert word in err
    # The other structure, which is estimated beside the refused one, may be finished by then.
    assert not [path for path in results(tmp_path) if path.endswith("posterior/M-0.nc") or "tmp" in path]


def test_a_missing_log_is_named(monkeypatch, capsys, tmp_path):
    write_small(tmp_path, LOGGED)
    code, _, err = run(monkeypatch, capsys, "run", tmp_path)
    assert code == Exit.BAD_INPUT
    assert "log_1.csv" in err
    (tmp_path / "log_1.csv").write_text("t,sped,rpm\n0,0,0\n1,1,1\n")
    code, _, err = run(monkeypatch, capsys, "run", tmp_path)
    assert code == Exit.BAD_INPUT
    for word in ("log_1.csv", '"speed"', "sped", "remedy"):
        assert word in err
    assert results(tmp_path) == ["campaign.toml", "log_1.csv"]


def test_a_whole_run_prints_the_remaining_time_that_it_is_given(monkeypatch):
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    monkeypatch.setattr(console, "EVERY", 0.0)
    report = ConsoleReporter().progress("whole run")
    report(0, 1000, 30.0)
    report(900, 1000, 1150.0)
    assert said.getvalue().splitlines()[-1] == "whole run: 90% after 0 s, about 1150 s remaining"


def test_work_on_a_campaign_begins_by_removing_what_a_killed_one_left(tmp_path):
    left = write_small(tmp_path) / "results" / "posterior" / ".M.nc.0a_z9xyz.part"
    left.parent.mkdir(parents=True)
    left.write_text("half")
    there = []
    with_campaign(tmp_path, True, lambda *_: there.append(left.exists()) or Exit.OK)
    assert there == [False]


def test_warnings_of_libraries_never_reach_the_terminal():
    """Only our own of the engine does."""
    app = typer.Typer()

    @app.command()
    def work() -> None:
        np.exp(np.float64(1000.0))
        warnings.warn("old", DeprecationWarning, stacklevel=1)
        warnings.warn("single precision", EngineWarning, stacklevel=1)

    with (
        warnings.catch_warnings(record=True) as shown,
        patch.object(sys, "argv", ["seatrial"]),
        patch.object(sys, "warnoptions", []),
        suppress(SystemExit),
    ):
        run_app(app)
    assert [str(warning.message) for warning in shown] == ["single precision"]


def test_names_of_files_and_columns_command_no_terminal(monkeypatch, capsys, tmp_path):
    path = tmp_path / "\x1b]0;title\x07\u202egnp.csv"
    path.write_text("t,u\x1b[2J\n" + "".join(f"{row},1.{row}\n" for row in range(9)))
    for words in (["inspect", path], ["inspect", path, "--json"], ["inspect", f"{path}x"]):
        _, out, err = run(monkeypatch, capsys, *words)
        assert not {*(out + err)} & {*"\x1b\x07\u202e"}
        assert r"\u202e" in out + err


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="every path there is text")
def test_a_folder_whose_name_is_no_utf_8_is_no_obstacle(monkeypatch, capsys, tmp_path):
    folder = write_small(tmp_path / os.fsdecode(b"bo\xffat"))
    code, out, _ = run(monkeypatch, capsys, "prior", folder, "--quiet")
    assert code == Exit.OK
    assert r"bo\udcffat/prior.svg" in out
