"""Estimates while the vehicle runs, and the advice to continue or to stop."""

import json
import signal
import sys
import time
from typing import Annotated, Any

import typer

from seatrial.cli.answer import echo
from seatrial.cli.running import Exit, Folder, Quiet, watched
from seatrial.core.visible import visible


def live(
    folder: Folder,
    source: Annotated[
        str,
        typer.Argument(
            metavar="[SOURCE]",
            help="A growing text file, - for standard input, udp:HOST:PORT for MAVLink, or ros2 for the topics of the [import] table.",
        ),
    ] = "-",
    every: Annotated[
        float, typer.Option(min=0.1, help="Seconds between lines, if the output is not a terminal or with --json.")
    ] = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print lines of JSON instead of text.")] = False,
    gap: Annotated[
        float,
        typer.Option(
            min=0.01, help="Seconds without a sample after which the states of the vehicle are initialised again."
        ),
    ] = 2.0,
    hold: Annotated[
        float, typer.Option(min=0.0, help="Seconds for which the goal must be met before the advice to stop.")
    ] = 5.0,
    idle: Annotated[float, typer.Option(min=0.0, help="End after so many seconds without data; 0: never.")] = 0.0,
    no_library: Annotated[
        bool, typer.Option("--no-library", help="Compute no designs, and propose no other input.")
    ] = False,
    with_import: Annotated[
        bool, typer.Option("--import", help="At the end add the session to the runs of the campaign file.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Follow a trial while it runs, and recommend when to stop.

    It never commands the vehicle. All data are kept under results/live; Ctrl-C ends the session.
    """
    from seatrial.campaign.live.session import LiveSettings

    def work(reporter: Any) -> Exit:
        session, stream = _begin(folder, source, LiveSettings(gap, hold), no_library, with_import, reporter)
        show = _Block() if sys.stdout.isatty() and not as_json else _Lines(every, as_json)
        stopped: list[int] = []
        signal.signal(signal.SIGINT, lambda *_: stopped.append(1))
        before = signal.signal(signal.SIGTERM, lambda *_: stopped.append(1))
        try:
            _follow(session, stream, idle, stopped, show)
        finally:
            signal.signal(signal.SIGTERM, before)  # the process may go on to other commands
            stream.close()
            session.kept.close()
            show.close()
        return _end(session, as_json, with_import)

    watched(quiet, work)


def _begin(
    folder: Any, source: str, settings: Any, no_library: bool, with_import: bool, reporter: Any
) -> tuple[Any, Any]:
    """Read the campaign, open the stream, and compile all programs before the first sample."""
    from seatrial.campaign.config.load import load_campaign
    from seatrial.campaign.live.next_segment import make_library
    from seatrial.campaign.live.session import Session
    from seatrial.campaign.live.session_files import Kept, with_session
    from seatrial.campaign.live.sources import open_source
    from seatrial.cli.campaign_lock import occupying
    from seatrial.core.errors import NumericalError, SeatrialError

    campaign = load_campaign(folder)
    if with_import:  # fails before the session if the file cannot take it
        with_session(campaign, "live")
    session = Session(campaign, source, settings)
    if source == "ros2" or source.startswith("udp:"):
        session.channels.check_messages()
    stream = open_source(source, session.channels.tables)
    try:
        if not no_library:
            try:
                with occupying(campaign.folder):
                    library = make_library(campaign, session.recursion.model, reporter)
                session = Session(campaign, source, settings, library)
            except (SeatrialError, NumericalError) as error:
                first = str(error).splitlines()
                reporter.say(f"no advice on the next segment: {' '.join(line.strip() for line in first[:2])}")
        session.warm()
        session.kept = Kept(campaign, stream.suffix, (*session.controls, *session.measured))
    except BaseException:
        stream.close()
        raise
    reporter.say(f"listening to {source}; kept in {session.kept.path}")
    return session, stream


def _follow(session: Any, stream: Any, idle: float, stopped: list[int], show: Any) -> None:
    came = time.monotonic()
    while not stopped:
        piece = stream.read(0.2)
        if piece is None:
            return
        now = time.monotonic()
        if piece.raw or piece.messages:
            came = now
        elif idle and now - came > idle:
            return
        looks = session.take(piece)
        for note in session.notes.take():
            show.say(note)
        for look in looks:
            show(look)


def _end(session: Any, as_json: bool, with_import: bool) -> Exit:
    """Print the last estimates, samples left out, and the commands for the whole analysis of the session."""
    from seatrial.campaign.live.session_files import import_lines, with_session
    from seatrial.cli.campaign_text import read_file, write_file

    campaign, kept = session.campaign, session.kept
    first = ""
    if session.belief is not None:
        last = session.look()
        echo(json.dumps(last.as_json()) if as_json else "\n".join(last.lines()))
        if last.kind == "check":
            first = "first correct the map or the campaign by the last advice; "
    counted = ", ".join(f"{kind}: {count}" for kind, count in session.notes.counts.items() if count > 1)
    echo(
        f"kept: {kept.path} ({session.samples} samples)" + (f"; left out or corrected: {counted}" if counted else ""),
        err=as_json,
    )
    if with_import:
        seen = read_file(campaign.folder)
        write_file(campaign.folder, with_session(campaign, kept.run), seen)
        echo(
            f"run {kept.run} is in {campaign.path}; {first}the whole analysis: seatrial run {campaign.folder}",
            err=as_json,
        )
    elif session.samples:
        echo(
            f"{first}for the whole analysis put these lines into {campaign.path} (--import does it), then: seatrial run {campaign.folder}",
            err=as_json,
        )
        echo(import_lines(campaign.imports, campaign.model(campaign.full), campaign.channels, kept.run), err=as_json)
    return Exit.OK


class _Block:
    """One block of lines that is refreshed, with notes above it."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        self.console = Console(highlight=False)
        self.live = Live(console=self.console, auto_refresh=False, transient=True)
        self.live.start()
        self.shown = -1.0

    def say(self, text: str) -> None:
        self.live.console.print(visible(f"note: {text}"), markup=False, soft_wrap=True)

    def __call__(self, look: Any) -> None:
        from rich.text import Text

        if look.time != self.shown:
            self.shown = look.time
            self.live.update(Text(visible("\n".join(look.lines()))), refresh=True)

    def close(self) -> None:
        self.live.stop()


class _Lines:
    """A line at intervals, and at once if the advice changes."""

    def __init__(self, every: float, as_json: bool):
        self.every, self.as_json = every, as_json
        self.shown_at, self.kind = -every, ""

    def say(self, text: str) -> None:
        echo(f"note: {text}", err=True)

    def __call__(self, look: Any) -> None:
        if look.kind == self.kind and look.time - self.shown_at < self.every:
            return
        self.shown_at, self.kind = look.time, look.kind
        if self.as_json:
            echo(json.dumps(look.as_json()))
            return
        known = "; ".join(f"{one.name} {one.mean:.4g} ± {one.sd:.2g} {one.unit}" for one in look.coefficients)
        echo(f"{look.time:.0f} s: {known} => {look.advice}")

    def close(self) -> None:
        pass
