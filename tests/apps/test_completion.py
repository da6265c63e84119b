"""Completion: the scripts know what the command line knows, and bash itself completes by one."""

import subprocess

import pytest

from seatrial.apps.cli import COMMANDS
from seatrial.apps.commands.completion import bash_script, fish_script, known_commands, zsh_script
from seatrial.campaign.config.templates import TEMPLATES
from seatrial.export.trials.write import FORMATS
from seatrial.export.write import EXPORTERS


@pytest.fixture(scope="module")
def known():
    return known_commands()


def completed(script, *words):
    """What bash offers for the last of the words."""
    line = " ".join(f"'{word}'" for word in words)
    asked = f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _seatrial; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run(["bash", "--norc", "-c", f"{script}\n{asked}"], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_bash_completes_commands_options_and_what_follows_them(known):
    script = bash_script(known)
    assert completed(script, "seatrial", "cr") == ["criteria", "crossvalidate"]
    assert "--json" in completed(script, "seatrial", "estimate", "folder", "--")
    assert completed(script, "seatrial", "estimate", "folder", "--by", "m") == ["mode"]
    assert completed(script, "seatrial", "init", "folder", "--template", "l") == ["log"]
    assert completed(script, "seatrial", "completion", "") == []  # files


def test_the_words_offered_are_the_targets_and_templates_that_there_are(known):
    def words(command, option):
        return next(one.choices for one in known[command].options if option in one.written)

    assert set(words("export", "--to")) == {*EXPORTERS, *FORMATS}
    assert set(words("init", "--template")) == set(TEMPLATES)


def test_every_shell_knows_every_command(known):
    assert list(known) == list(COMMANDS)
    for write in (zsh_script, fish_script):
        script = write(known)
        assert all(name in script for name in COMMANDS)
        assert "chains mode equation-error" in script
        assert script.count("'") % 2 == 0
