"""Shell completion as a script that knows every command and option, so that pressing Tab starts no Python."""

import re
from enum import StrEnum
from typing import Annotated, Any, NamedTuple

import typer

from seatrial.apps.answer import current_answer

_CHOICES = re.compile(r"[<\[]([\w-]+(?:\|[\w-]+)+)[>\]]")
"""Words that an option may be followed by, as its help shows them."""


class Shell(StrEnum):
    """Shells that are known."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"


class Option(NamedTuple):
    """One option: how it is written, what it does, and the words that may follow it; none where anything may."""

    written: tuple[str, ...]
    help: str
    choices: tuple[str, ...]


class Known(NamedTuple):
    """One command: what it does, and its options."""

    help: str
    options: tuple[Option, ...]


def completion(shell: Annotated[Shell, typer.Argument(help="Shell that is to complete.")]) -> None:
    """Print the completion script of a shell.

    bash: seatrial completion bash > ~/.local/share/bash-completion/completions/seatrial;
    zsh: seatrial completion zsh > _seatrial in a folder of $fpath;
    fish: seatrial completion fish > ~/.config/fish/completions/seatrial.fish.
    """
    write = {Shell.BASH: bash_script, Shell.ZSH: zsh_script, Shell.FISH: fish_script}[shell]
    current_answer().say(write(known_commands()))


def known_commands() -> dict[str, Known]:
    """Return every command with its options, in the order in which they are listed."""
    from seatrial.apps.cli import app

    group: Any = typer.main.get_command(app)
    found = {}
    for name, command in group.commands.items():
        context = command.make_context(name, [], resilient_parsing=True)
        options = [one for one in command.get_params(context) if one.param_type_name == "option"]
        found[name] = Known(command.get_short_help_str(100), tuple(_option(one, context) for one in options))
    return found


def _option(one: Any, context: Any) -> Option:
    syntax, text = one.get_help_record(context) or ("", "")
    choices = _CHOICES.search(syntax)
    written = (*one.opts, *one.secondary_opts)
    return Option(written, " ".join(text.split()), tuple(choices[1].split("|")) if choices else ())


def bash_script(commands: dict[str, Known]) -> str:
    """Return the script of bash: names first, options after a dash, the words of an option after it, files otherwise."""
    cases, after = [], []
    for name, known in commands.items():
        written = " ".join(word for option in known.options for word in option.written)
        cases.append(f'    {name}) words="{written}" ;;')
        after += [
            f'    {name}:{option.written[0]}) words="{" ".join(option.choices)}" ;;'
            for option in known.options
            if option.choices
        ]
    return "\n".join(
        [
            "_seatrial() {",
            '  local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" words=""',
            "  COMPREPLY=()",
            "  if [ $COMP_CWORD -eq 1 ]; then",
            f'    COMPREPLY=($(compgen -W "{" ".join(commands)} --help --version" -- "$word"))',
            "    return",
            "  fi",
            '  case "${COMP_WORDS[1]}:$before" in',
            *after,
            "  esac",
            '  if [ -z "$words" ] && [[ "$word" == -* ]]; then',
            '    case "${COMP_WORDS[1]}" in',
            *cases,
            "    esac",
            "  fi",
            '  [ -n "$words" ] && COMPREPLY=($(compgen -W "$words" -- "$word"))',
            "}",
            "complete -o default -F _seatrial seatrial",
        ]
    )


def zsh_script(commands: dict[str, Known]) -> str:
    """Return the script of zsh, with what each command and option does beside it."""
    lines = ["#compdef seatrial", "_seatrial() {", "  local -a names=("]
    lines += [f"    {_quoted(f'{name}:{known.help}')}" for name, known in commands.items()]
    lines += [
        "  )",
        "  if (( CURRENT == 2 )); then",
        "    _describe command names",
        "    return",
        "  fi",
        "  local -a options",
    ]
    lines.append('  case "$words[2]" in')
    for name, known in commands.items():
        specs = [_quoted(f"{word}:{option.help}") for option in known.options for word in option.written]
        lines.append(f"    {name}) options=({' '.join(specs)}) ;;")
    lines += ["  esac", '  case "$words[2]:$words[CURRENT-1]" in']
    for name, known in commands.items():
        lines += [
            f"    {name}:{option.written[0]}) compadd {' '.join(option.choices)}; return ;;"
            for option in known.options
            if option.choices
        ]
    lines += ["  esac", '  if [[ "$words[CURRENT]" == -* ]]; then _describe option options; else _files; fi', "}"]
    return "\n".join([*lines, "compdef _seatrial seatrial"])


def fish_script(commands: dict[str, Known]) -> str:
    """Return the script of fish: a line for each command and each option."""
    lines = []
    for name, known in commands.items():
        lines.append(f"complete -c seatrial -n __fish_use_subcommand -f -a {name} -d {_quoted(known.help)}")
        for option in known.options:
            flags = " ".join(f"-l {word[2:]}" if word.startswith("--") else f"-s {word[1:]}" for word in option.written)
            words = f" -xa {_quoted(' '.join(option.choices))}" if option.choices else ""
            where = _quoted(f"__fish_seen_subcommand_from {name}")
            lines.append(f"complete -c seatrial -n {where} {flags} -d {_quoted(option.help)}{words}")
    return "\n".join(lines)


def _quoted(text: str) -> str:
    """Return a text in single quotes, in which no shell looks for anything."""
    return "'" + text.replace("'", "’") + "'"
