"""What every command shares: exit codes, arguments, a campaign with a reporter on it, an answer, and an end that can be resumed."""

import os
import signal
import sys
import warnings
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


class Answer:
    """What a command says of a campaign: its results on standard output, cautions and alarms on standard error."""

    def __init__(self) -> None:
        self.said: list[tuple[str, bool]] = []

    def say(self, text: str, err: bool = False) -> None:
        """Print some lines, and remember them."""
        typer.echo(text, err=err)
        self.said.append((text, err))

    def finish(self, alarms: list[str], cautions: list[str]) -> Exit:
        """Print what is wrong to standard error, and say by the exit code whether results may be used."""
        for text in cautions:
            self.say(f"caution: {text}", err=True)
        for text in alarms:
            self.say(f"alarm: {text}", err=True)
        return Exit.ALARMS if alarms else Exit.OK


Work = Callable[[Any, Any, Answer], Exit]
"""What a command does with a campaign: it is given the campaign, a reporter, and the answer to speak through."""


def with_campaign(folder: Path, quiet: bool, work: Work, asked: typer.Context | None = None, also: str = "") -> None:
    """Read a folder's campaign, do work on it under a reporter, and end with the exit code of the work.

    Args:
        folder: of the campaign, or its file.
        quiet: whether only results and errors are shown.
        work: of the command.
        asked: command and options, by which the answer is kept, and given again for as long as nothing has changed that it was made
            from; None of a command that changes what it begins from, or keeps nothing.
        also: another command that does all of this one's work and says the same.

    Raises:
        InputError: no campaign, or another process at work on it.
    """
    from seatrial.apps.campaign_lock import occupying
    from seatrial.campaign.store.stored_result import campaign_folder
    from seatrial.core.files import remove_orphans

    home = campaign_folder(folder)

    def alone(reporter: Any) -> Exit:
        with occupying(home) as held:
            if held is not None:
                reporter.also = held.progress
                remove_orphans(home)
            if asked is None:
                return _worked(home, reporter, work, Answer())
            return _answered(home, reporter, work, asked, also)

    watched(quiet, alone)


def _answered(home: Path, reporter: Any, work: Work, asked: typer.Context, also: str) -> Exit:
    """Give the answer that was kept, or do the work and keep what it says."""
    from seatrial.campaign.store.answers import keep, key_of_answer, recall
    from seatrial.campaign.store.stored_result import FILE_NAME, Store
    from seatrial.core.files import is_there, watching_files

    options = {name: str(value) for name, value in asked.params.items() if name != "quiet"}
    file, command, answer = home / FILE_NAME, str(asked.info_name), Answer()
    with watching_files() as seen:
        text = file.read_text(encoding="utf-8", errors="replace") if is_there(file) else ""
        keys = {name: key_of_answer(home, text, {"command": name, **options}) for name in (command, also)}
        for name, key in keys.items():
            if (said := recall(Store(home).answer(name), key)) is not None:
                for line, err in said["lines"]:
                    answer.say(line, err=err)
                return Exit(said["exit"])
        code = _worked(home, reporter, work, answer)
    keep(Store(home).answer(command), keys[command], {"lines": answer.said, "exit": int(code)}, seen)
    return code


def _worked(home: Path, reporter: Any, work: Work, answer: Answer) -> Exit:
    from seatrial.campaign.config.load import load_campaign
    from seatrial.campaign.config.named_files import folders_outside

    campaign = load_campaign(home)
    for outside in folders_outside(campaign.folder, campaign.known_from, campaign.imports):
        reporter.say(f"reads files outside the campaign's folder, in {outside}")
    return work(campaign, reporter, answer)


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


def _hush_libraries(ours: type[Warning]) -> None:
    """Keep the warnings of libraries from the terminal, as those of overflows under a draw that diverges; `python -W` shows them."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        warnings.simplefilter("default", ours)
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def run_app(app: typer.Typer) -> None:
    """Run a command line; errors meant for the user are printed without a traceback, each kind with its exit code."""
    from seatrial.apps.console import fail
    from seatrial.core import engine
    from seatrial.core.errors import InputError, NumericalError, SeatrialError, file_error

    _hush_libraries(engine.EngineWarning)
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


def _stop(reporter: Any) -> None:
    """End at once: results are whole or absent and long work has checkpoints, so there is nothing to wait for."""
    from seatrial.apps.campaign_lock import release_all
    from seatrial.core.files import discard_unfinished

    reporter.bars.stop()
    discard_unfinished()
    release_all()
    reporter.console.print("interrupted; run the same command again to resume")
    os._exit(Exit.INTERRUPTED)
