"""The command line: a table of commands, each a small function of `seatrial.apps.commands` that is imported when it is called."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperGroup

from seatrial import __version__
from seatrial.apps.running import run_app, with_answer


class Command(NamedTuple):
    """One command.

    Attributes:
        place: module and function under `seatrial.apps.commands`.
        makes: what it makes of a campaign, in a few words; the dashboard offers every command that makes something.
    """

    place: str
    makes: str = ""


COMMANDS = {
    "vehicle": Command("catalogue:vehicle"),
    "init": Command("init:init"),
    "prior": Command("plan:prior", "what the priors mean as speeds"),
    "design": Command("plan:design", "the most informative trial"),
    "plan": Command("plan:plan_campaign", "all trials of a day, and the chance of meeting the goals"),
    "rehearse": Command("rehearse:rehearse", "how many trials the goal will take"),
    "simulate": Command("data:simulate", "the trial on the simulated vehicle"),
    "inspect": Command("logs:inspect"),
    "import": Command("data:import_logs", "records from logs"),
    "live": Command("live:live"),
    "estimate": Command("infer:estimate", "coefficients of every structure"),
    "profile": Command("infer:profile", "the range of each parameter that the data alone allow"),
    "select": Command("infer:select", "which terms the data support"),
    "criteria": Command("infer:criteria", "the structures by each information criterion"),
    "crossvalidate": Command("crossvalidate:crossvalidate", "which model predicts runs that were left out"),
    "check": Command("check:check", "judge the records"),
    "tuning": Command("check:tuning", "whether the filter is tuned"),
    "calibrate": Command("check:calibrate", "whether the stated uncertainty is right"),
    "next": Command("loop:next_trial", "the next trial"),
    "report": Command("loop:report", "the page of results"),
    "run": Command("loop:run", "the whole loop, with the report"),
    "explain": Command("catalogue:explain"),
    "schema": Command("catalogue:schema"),
    "benchmark": Command("benchmark:benchmark"),
    "serve": Command("serve:serve"),
    "export": Command("export:export", "the estimated vehicle as files for a simulator"),
}
"""By name, in the order in which they are listed. To add a command, see the table of CONTRIBUTING."""


class _Imported(Mapping[str, Any]):
    """The commands as typer wants them, each imported when it is looked up."""

    def __getitem__(self, name: str) -> Any:
        module, function = COMMANDS[name].place.split(":")
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
        alone.command(name=name)(
            with_answer(name, getattr(import_module(f"seatrial.apps.commands.{module}"), function))
        )
        return typer.main.get_command(alone)

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Group(TyperGroup):
    """All commands of the table."""

    def __init__(self, **attrs: Any):
        super().__init__(**attrs)
        self.commands = _Imported()  # pyright: ignore[reportAttributeAccessIssue]


app = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Identify the dynamics of underwater vehicles: design a trial, estimate the coefficients, select the terms that the data "
    "support, and say what to run next.",
    epilog="Exit codes: 0 done; 2 the input cannot be used (the message says what is wrong and what to do); 3 done, but a health "
    "check failed (see the report); 4 the computation failed; 130 interrupted (run again to resume).",
)


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(f"seatrial {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; errors meant for the user are printed without a traceback."""
    run_app(app)
