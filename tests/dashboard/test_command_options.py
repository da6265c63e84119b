"""Forms of commands: the options that the commands themselves declare, and values that are refused before anything starts."""

import pytest
from typer.testing import CliRunner

from seatrial.__main__ import app
from seatrial.core.errors import InputError
from seatrial.dashboard.command_options import STARTED, options_of, words_of_options
from seatrial.dashboard.jobs import Jobs


def test_every_option_that_is_offered_is_in_the_help_of_its_command():
    for command in STARTED:
        said = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"}).output
        for option in options_of(command):
            assert f"{option.name} " in said, (command, option.name)


def test_options_that_name_files_anywhere_are_left_to_the_shell():
    offered = {(command, option.name) for command in STARTED for option in options_of(command)}
    assert {("design", "--free-form"), ("next", "--run"), ("simulate", "--design")} <= offered
    assert not {("simulate", "--schedule"), ("export", "--out"), ("run", "--quiet")} & offered


def test_a_form_says_what_a_shell_would():
    values = {"--free-form": "24", "--self-oscillation": True, "--trials": "0", "--search": ""}
    assert words_of_options("design", values) == ["--free-form=24", "--self-oscillation"]
    several = words_of_options("profile", {"--parameter": "X_u, u_0[run 1]"})
    assert several == ["--parameter=X_u", "--parameter=u_0[run 1]"]
    assert words_of_options("estimate", {"--by": "mode", "--window": None}) == ["--by=mode"]


@pytest.mark.parametrize(
    ("command", "name", "value", "expected"),
    [
        ("design", "--free-form", "201", "0 to 200"),
        ("plan", "--vehicles", "-5", "a whole number"),
        ("calibrate", "--replicates", "1e3", "a whole number"),
        ("next", "--by", "guess", "one of chains, mode"),
    ],
)
def test_a_value_that_cannot_be_is_told_by_its_option(command, name, value, expected):
    with pytest.raises(InputError, match=expected) as told:
        words_of_options(command, {name: value})
    assert told.value.where == name


@pytest.mark.parametrize("value", ["../x", "/etc/passwd", "a;b", "--json", "$HOME", "a\nb", ""])
def test_a_page_passes_on_neither_paths_nor_other_options(tmp_path, value):
    with pytest.raises(InputError, match="characters that a page refuses"):
        Jobs().start(tmp_path, "simulate", f"--label={value}")
    assert list(tmp_path.iterdir()) == []
