"""The command line: a table of commands, each a small function of `seatrial.cli.commands` that imports heavy libraries when called."""

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple, get_args

import typer
from typer.core import TyperGroup

from seatrial import __version__
from seatrial.cli.commands.catalogue import explain, schema, vehicle
from seatrial.cli.commands.check import calibrate, check, tuning
from seatrial.cli.commands.data import import_logs, simulate
from seatrial.cli.commands.export import export
from seatrial.cli.commands.infer import criteria, crossvalidate, estimate, profile, select
from seatrial.cli.commands.init import init
from seatrial.cli.commands.live import live
from seatrial.cli.commands.logs import inspect
from seatrial.cli.commands.loop import next_trial, report, run
from seatrial.cli.commands.plan import design, plan, prior
from seatrial.cli.running import run_app, with_answer
from seatrial.core.errors import InputError

Group = Literal["Start", "Before a trial", "Fit", "Decide", "Share"]


class Command(NamedTuple):
    """One command.

    Attributes:
        function: of `seatrial.cli.commands`, as typer calls it; the first line of its docstring is its description.
        group: under which it is listed.
        makes: what it makes of a campaign, in a few words; the dashboard offers every command that makes something.
    """

    function: Callable[..., None]
    group: Group
    makes: str = ""


# By name, in the order in which they are listed. To add a command, see docs/dev/map.md.
COMMANDS = {
    "init": Command(init, "Start"),
    "inspect": Command(inspect, "Start"),
    "import": Command(import_logs, "Start", "records from logs"),
    "check": Command(check, "Start", "judge the records"),
    "run": Command(run, "Start", "the whole loop, with the report"),
    "report": Command(report, "Start", "the page of results"),
    "explain": Command(explain, "Start"),
    "vehicle": Command(vehicle, "Before a trial"),
    "prior": Command(prior, "Before a trial", "the speeds that the priors allow"),
    "design": Command(design, "Before a trial", "the most informative trial"),
    "plan": Command(plan, "Before a trial", "all trials of a day, or the number of trials that the goal takes"),
    "simulate": Command(simulate, "Before a trial", "the trial on the simulated vehicle"),
    "live": Command(live, "Before a trial"),
    "estimate": Command(estimate, "Fit", "coefficients of every structure"),
    "profile": Command(profile, "Fit", "the range of each parameter by the data only"),
    "calibrate": Command(calibrate, "Fit", "whether the stated uncertainty is right"),
    "tuning": Command(tuning, "Fit", "whether the filter is tuned"),
    "select": Command(select, "Decide", "the terms that the data support"),
    "criteria": Command(criteria, "Decide", "the structures by each information criterion"),
    "crossvalidate": Command(crossvalidate, "Decide", "the model that predicts runs left out best"),
    "next": Command(next_trial, "Decide", "the next trial"),
    "export": Command(export, "Share", "the estimated vehicle as files for a simulator"),
    "schema": Command(schema, "Share"),
}
# Former commands, and the command line that does their work now.
RENAMED = {"rehearse": "seatrial plan DIR --vehicles 20"}


class _Commands(Mapping[str, Any]):
    """The commands as typer wants them, each built when it is looked up: building all takes longer than most help pages."""

    def __init__(self, commands: Mapping[str, Command]):
        self._commands = commands

    def __getitem__(self, name: str) -> Any:
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
        alone.command(name=name)(with_answer(name, self._commands[name].function))
        return typer.main.get_command(alone)

    def __iter__(self) -> Iterator[str]:
        return iter(self._commands)

    def __len__(self) -> int:
        return len(self._commands)


def grouped(commands: Mapping[str, Command]) -> dict[Group, list[str]]:
    """Return the names of commands by group, in the order of the groups."""
    groups = {group: [name for name, one in commands.items() if one.group == group] for group in get_args(Group)}
    return {group: names for group, names in groups.items() if names}


def description(command: Command) -> str:
    """Return one line about a command, without building the command."""
    return (command.function.__doc__ or "").partition("\n")[0]


def app_of(commands: Mapping[str, Command]) -> typer.Typer:
    """Return the command line of a table of commands."""

    class Group(TyperGroup):
        def __init__(self, **attrs: Any):
            super().__init__(**attrs)
            self.commands = _Commands(commands)  # pyright: ignore[reportAttributeAccessIssue]

        def get_command(self, ctx: Any, cmd_name: str) -> Any:
            if cmd_name in RENAMED:
                raise InputError(
                    "command",
                    found=cmd_name,
                    expected="a command that exists",
                    remedy=f"`{RENAMED[cmd_name]}` does its work",
                )
            return super().get_command(ctx, cmd_name)

        def format_commands(self, ctx: Any, formatter: Any) -> None:
            width = max(map(len, commands))
            for group, members in grouped(commands).items():
                with formatter.section(group):
                    formatter.write_dl([(name.ljust(width), description(commands[name])) for name in members])

    app = typer.Typer(
        cls=Group,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        help="Identify the dynamics of underwater vehicles: design a trial, estimate the coefficients, select the terms that the data "
        "support, and recommend the next trial.",
        epilog="Exit codes: 0 done; 2 the input cannot be used (the message has the remedy); 3 done, but with an alarm (see the "
        "report); 4 the computation failed; 130 interrupted (run again to resume).",
    )

    @app.callback(invoke_without_command=True)
    def _root(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
        if version:
            typer.echo(f"seatrial {__version__}")
            raise typer.Exit

    return app


app = app_of(COMMANDS)


def main() -> None:
    """Run the command line without the dashboard; errors meant for the user are printed without a traceback."""
    run_app(app)
