"""The page of the command line, from the commands themselves."""

from collections import Counter

import typer

from seatrial.__main__ import COMMANDS, app
from seatrial.cli.main import grouped

COMMON = 10
"""Arguments and options of more commands than this stand once, at the top."""


def page() -> str:
    """Every command with its arguments and options."""
    group = typer.main.get_command(app)
    commands = group.commands  # pyright: ignore[reportAttributeAccessIssue]
    rows = {name: _rows(name, commands[name]) for names in grouped(COMMANDS).values() for name in names}
    common = [row for row, count in Counter(row for some in rows.values() for row in some).items() if count > COMMON]
    parts = [
        "# The command line",
        "",
        "`seatrial COMMAND --help` prints the same. Results go to the campaign's folder, progress and cautions to standard error.",
        "",
        group.epilog or "",
        "",
        "Most commands have these:",
        "",
        *_table(common),
    ]
    for words, names in grouped(COMMANDS).items():
        parts += [f"## {words}", ""]
        for name in names:
            context = commands[name].make_context(name, [], resilient_parsing=True)
            usage = " ".join(["seatrial", name, *commands[name].collect_usage_pieces(context)])
            parts += [f"### seatrial {name}", "", f"`{usage}`", "", commands[name].help or "", ""]
            parts += _table([row for row in rows[name] if row not in common])
    return "\n".join(parts)


def _rows(name: str, command) -> list[str]:
    """One line for each argument and option; none for those without help."""
    context = command.make_context(name, [], resilient_parsing=True)
    records = (parameter.get_help_record(context) for parameter in command.params)
    return [f"| `{_cell(record[0])}` | {_cell(record[1])} |" for record in records if record is not None]


def _table(rows: list[str]) -> list[str]:
    return ["| | meaning |", "|---|---|", *rows, ""] if rows else []


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("[DIR]", "\\[DIR\\]")
