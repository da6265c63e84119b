"""The command line: one small function for each command, in `seatrial.apps.commands`, and errors in plain words."""

from typing import Annotated

import typer

from seatrial import __version__
from seatrial.apps.commands import check, data, infer, logs, loop, plan
from seatrial.apps.commands.catalogue import vehicle
from seatrial.apps.commands.export import export
from seatrial.apps.commands.rehearse import rehearse
from seatrial.apps.commands.serve import serve
from seatrial.apps.running import run_app

COMMANDS = {
    "vehicle": vehicle,
    "init": plan.init,
    "prior": plan.prior,
    "design": plan.design,
    "rehearse": rehearse,
    "simulate": data.simulate,
    "inspect": logs.inspect,
    "import": data.import_logs,
    "estimate": infer.estimate,
    "profile": infer.profile,
    "select": infer.select,
    "criteria": infer.criteria,
    "check": check.check,
    "tuning": check.tuning,
    "calibrate": check.calibrate,
    "next": loop.next_trial,
    "report": loop.report,
    "run": loop.run,
    "serve": serve,
    "export": export,
}
"""By name, in the order in which they are listed."""

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Identify the dynamics of underwater vehicles: design a trial, estimate the coefficients, select the terms the data support, "
    "say what to run next.",
    epilog="Exit codes: 0 done; 2 something in the input cannot be used (the message says what and how to mend it); 3 done, but a health "
    "check failed (see the report); 4 the computation failed; 130 interrupted (run again to resume).",
)
for _name, _command in COMMANDS.items():
    app.command(name=_name)(_command)


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(f"seatrial {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; errors meant for the user are printed without a traceback."""
    run_app(app)
