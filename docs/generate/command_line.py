"""The page of the command line, from the commands themselves."""

import typer

from seatrial.__main__ import COMMANDS, app
from seatrial.cli.main import grouped


def page() -> str:
    """Every command with its arguments and options."""
    group = typer.main.get_command(app)
    parts = [
        "# The command line",
        "",
        "`seatrial COMMAND --help` prints the same. Results go to the campaign's folder, progress and cautions to standard error.",
        "",
        group.epilog or "",
        "",
    ]
    for words, names in grouped(COMMANDS).items():
        parts += [f"## {words}", ""]
        for name in names:
            parts += _command(name, group.commands[name])  # pyright: ignore[reportAttributeAccessIssue]
    return "\n".join(parts)


def _command(name: str, command) -> list[str]:
    context = command.make_context(name, [], resilient_parsing=True)
    usage = " ".join(["seatrial", name, *(piece for piece in command.collect_usage_pieces(context))])
    lines = [f"### seatrial {name}", "", f"`{usage}`", "", command.help or "", ""]
    rows = [_row(parameter, context) for parameter in command.params]
    rows = [row for row in rows if row is not None]
    if rows:
        lines += ["| | meaning |", "|---|---|", *rows, ""]
    return lines


def _row(parameter, context) -> str | None:
    """One line of the table; None for what has no help."""
    record = parameter.get_help_record(context)
    if record is None:
        return None
    syntax, text = record
    return f"| `{_cell(syntax)}` | {_cell(text)} |"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("[DIR]", "\\[DIR\\]")
