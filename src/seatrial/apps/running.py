"""What every command shares: exit codes, arguments, a campaign with a reporter on it, and an end that can be resumed."""

import os
import signal
import sys
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any

import typer


class Exit(IntEnum):
    """Exit codes of every command."""

    OK = 0
    BUG = 1
    BAD_INPUT = 2
    ALARMS = 3
    NUMERICAL = 4
    INTERRUPTED = 130


Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the campaign.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Only results and errors.")]


def with_campaign(folder: Path, quiet: bool, work: Callable[[Any, Any], Exit]) -> None:
    """Read a folder's campaign, do work on it under a reporter, and end with the exit code of the work.

    Raises:
        InputError: no campaign, or another process at work on it.
    """
    from seatrial.apps.campaign_lock import occupying
    from seatrial.campaign.config.load import load_campaign
    from seatrial.campaign.config.named_files import folders_outside
    from seatrial.core.files import remove_orphans

    def alone(reporter: Any) -> Exit:
        campaign = load_campaign(folder)
        with occupying(campaign.folder) as held:
            if held is not None:
                reporter.also = held.progress
                remove_orphans(campaign.folder)
            for outside in folders_outside(campaign.folder, campaign.known_from, campaign.imports):
                reporter.say(f"reads files outside the campaign's folder, in {outside}")
            return work(campaign, reporter)

    watched(quiet, alone)


def watched(quiet: bool, work: Callable[[Any], Exit]) -> None:
    """Do work under a reporter, and end with its exit code; an interrupt ends at once."""
    from seatrial.apps.console import ConsoleReporter
    from seatrial.core import engine

    reporter = ConsoleReporter(quiet)
    engine.tell_of_compiling(reporter.say)
    signal.signal(signal.SIGINT, lambda *_: _stop(reporter))
    with reporter.watching():
        code = work(reporter)
    if code is not Exit.OK:
        raise typer.Exit(int(code))


def run_app(app: typer.Typer) -> None:
    """Run a command line; errors meant for the user are printed without a traceback, each kind with its exit code."""
    from seatrial.apps.console import fail
    from seatrial.core import engine
    from seatrial.core.errors import InputError, NumericalError, SeatrialError, file_error

    engine.configure()
    try:
        app()
    except InputError as error:
        fail(str(error))
        sys.exit(Exit.BAD_INPUT)
    except NumericalError as error:
        fail(str(error))
        sys.exit(Exit.NUMERICAL)
    except SeatrialError as error:
        fail(str(error))
        sys.exit(Exit.BUG)
    except OSError as error:
        fail(str(file_error(error)))
        sys.exit(Exit.BAD_INPUT)


def finish(alarms: list[str], cautions: list[str]) -> Exit:
    """Print what is wrong to standard error, and say by the exit code whether results may be used."""
    for text in cautions:
        typer.echo(f"caution: {text}", err=True)
    for text in alarms:
        typer.echo(f"alarm: {text}", err=True)
    return Exit.ALARMS if alarms else Exit.OK


def _stop(reporter: Any) -> None:
    """End at once: results are whole or absent and long work has checkpoints, so there is nothing to wait for."""
    from seatrial.apps.campaign_lock import release_all
    from seatrial.core.files import discard_unfinished

    reporter.bars.stop()
    discard_unfinished()
    release_all()
    reporter.console.print("interrupted; run the same command again to resume")
    os._exit(Exit.INTERRUPTED)
