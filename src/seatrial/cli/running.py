"""What every command shares: arguments, a campaign with a reporter on it, and an end that can be resumed."""

import gc
import inspect
import os
import signal
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.cli.answer import Answer, Exit, answering, code_of, current_answer

# Objects between two collections of garbage, and so on: JAX clears up at each of them, which took 0.3 of the 3.4 s of
# a mode.
COLLECTED = 100_000, 50, 100
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the campaign.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Only results and errors.")]


# What a command does with a campaign: it is given the campaign, a reporter, and the answer to speak through.
Work = Callable[[Any, Any, Answer], Exit]

Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help="Print one JSON document instead of lines; `python -m seatrial.cli.result_schema` lists its keys.",
    ),
]
INTERACTIVE = ("serve",)  # Commands that go on until they are left: they have neither a result nor `--quiet`
# Commands without a document at the end; `live` prints a line of JSON each time instead.
NO_RESULT = (*INTERACTIVE, "live")


def with_answer(name: str, command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that has `--quiet` and `--json` where they make sense, and speaks through an answer of its own.

    Args:
        name: of the command.
        command: what typer calls; `--quiet` of its own is handed on.
    """
    signature = inspect.signature(command)
    own = list(signature.parameters.values())
    shared = ({} if name in INTERACTIVE else {"quiet": Quiet}) | ({} if name in NO_RESULT else {"as_json": Json})
    missing = [
        inspect.Parameter(option, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=False, annotation=kind)
        for option, kind in shared.items()
        if option not in signature.parameters
    ]

    def answered(**given: Any) -> None:
        as_json = name not in NO_RESULT and given.pop("as_json", False)
        with answering(name, as_json):
            command(**{key: value for key, value in given.items() if key in signature.parameters})

    answered.__doc__ = command.__doc__
    answered.__signature__ = signature.replace(parameters=[*own, *missing])  # pyright: ignore[reportFunctionMemberAccess]
    return answered


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
    from seatrial.campaign.store.stored_result import campaign_folder
    from seatrial.cli.campaign_lock import occupying
    from seatrial.core.files import remove_orphans

    home = campaign_folder(folder)

    def alone(reporter: Any) -> Exit:
        with occupying(home) as held:
            if held is not None:
                reporter.also = held.progress
                remove_orphans(home)
            if asked is None:
                return _worked(home, reporter, work, current_answer())
            return _answered(home, reporter, work, asked, also)

    watched(quiet, alone)


def of_campaign(work: Work, also: str = "") -> Callable[..., None]:
    """Return the command that does some work on a campaign, and has no options of its own; arguments as `with_campaign`."""

    def command(context: typer.Context, folder: Folder, quiet: Quiet = False) -> None:
        with_campaign(folder, quiet, work, context, also)

    command.__doc__ = work.__doc__
    return command


def _answered(home: Path, reporter: Any, work: Work, asked: typer.Context, also: str) -> Exit:
    """Give the answer that was kept, or do the work and keep what it says."""
    from seatrial.campaign.store.answer_cache import keep, key_of_answer, recall
    from seatrial.campaign.store.stored_result import FILE_NAME, Store
    from seatrial.core.files import is_there, watching_files

    options = {name: str(value) for name, value in asked.params.items() if name not in ("quiet", "as_json")}
    file, command, answer = home / FILE_NAME, str(asked.info_name), current_answer()
    # First answers stand beside the whole one: whoever asks for both in turn waits for neither.
    by, is_verbose = options.get("by", "chains"), options.get("verbose") == "True"
    place = "-".join([command, *[by] * (by != "chains"), *["verbose"] * is_verbose])
    with watching_files() as seen:
        text = file.read_text(encoding="utf-8", errors="replace") if is_there(file) else ""
        keys = {name: key_of_answer(home, text, {"command": name, **options}) for name in (command, also)}
        for name, key in keys.items():
            if (kept := recall(Store(home).answer(place if name == command else name), key)) is not None:
                return answer.repeat(kept)
        code = _worked(home, reporter, work, answer)
    keep(Store(home).answer(place), keys[command], answer.kept(code), seen)
    return code


def _worked(home: Path, reporter: Any, work: Work, answer: Answer) -> Exit:
    from seatrial.campaign.config.load import load_campaign
    from seatrial.campaign.config.named_files import folders_outside

    campaign = load_campaign(home)
    own = [] if campaign.own_schedule is None else [Path(campaign.own_schedule.source)]
    for outside in folders_outside(campaign.folder, campaign.priors_from, campaign.imports, own):
        reporter.say(f"reads files outside the campaign's folder, in {outside}")
    answer.accepted = campaign.accepted
    return work(campaign, reporter, answer)


def watched(quiet: bool, work: Callable[[Any], Exit]) -> None:
    """Do work under a reporter, and end with its exit code; an interrupt ends at once."""
    from seatrial.cli.console import ConsoleReporter
    from seatrial.compiled import engine

    reporter = ConsoleReporter(quiet)
    engine.tell_of_compiling(reporter.say)
    signal.signal(signal.SIGINT, lambda *_: _stop(reporter))
    with reporter.watching():
        code = work(reporter)
    if code is not Exit.OK:
        raise typer.Exit(int(code))


def run_app(app: typer.Typer) -> None:
    """Run a command line; errors meant for the user are printed without a traceback, each kind with its exit code."""
    from seatrial.compiled import engine
    from seatrial.core.errors import SeatrialError, file_error

    # Warnings of libraries stay from the terminal, as those of overflows under a draw that diverges; `python -W` shows them.
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        warnings.simplefilter("default", engine.EngineWarning)
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    engine.configure()
    gc.set_threshold(*COLLECTED)
    try:
        app()
    except SeatrialError as error:
        _fail(error)
        sys.exit(code_of(error))
    except OSError as error:
        _fail(file_error(error))
        sys.exit(Exit.BAD_INPUT)


def _fail(error: Exception) -> None:
    from seatrial.cli.console import fail  # brings NumPy, without which the version is told

    fail(str(error))


def _stop(reporter: Any) -> None:
    """End at once: results are whole or absent and long work has checkpoints, so there is nothing to wait for."""
    from seatrial.cli.campaign_lock import release_all
    from seatrial.core.files import discard_unfinished

    reporter.bars.stop()
    discard_unfinished()
    release_all()
    reporter.console.print("interrupted; run the same command again to resume")
    os._exit(Exit.INTERRUPTED)
