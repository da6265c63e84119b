"""A session that stays warm: one command a line, the campaign's folder filled in."""

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.apps.answer import echo
from seatrial.apps.running import Exit, Folder

if TYPE_CHECKING:
    from seatrial.apps.session import Session

_LEAVE = ("quit", "exit")
_NOT_HERE = ("shell", "serve", "live")
"""Commands that go on until they are left."""
_HELP = """One command a line, without `seatrial` and the folder, such as `design` or `estimate --by mode`.
help COMMAND   its options
quit, Ctrl-D   end the session
Ctrl-C         end the command, not the session; what it has finished is kept
"""
_REMEMBERED = 1000
"""Lines of the history."""


def shell(
    folder: Folder,
    cold: Annotated[bool, typer.Option("--cold", help="Do not prepare the next step while you type nothing.")] = False,
) -> None:
    """Run commands in one session, without a new start for each.

    Commands may be piped in; the exit code is then that of the first one that failed.
    """
    is_typed = sys.stdin.isatty()
    runner, failed = _Runner(folder, prepares=is_typed and not cold), Exit.OK
    try:
        for line in _typed_lines(folder) if is_typed else sys.stdin:
            words = _words(line)
            if words and words[0] in _LEAVE:
                break
            code = runner.run(words)
            failed = failed or code
    finally:
        runner.close()
    if failed and not is_typed:
        raise typer.Exit(failed)


class _Runner:
    """Runs lines in a session, and begins another one where that has ended."""

    def __init__(self, folder: Path, prepares: bool):
        self.folder, self.prepares = folder, prepares
        self.session = self._begin() if prepares else None

    def run(self, words: list[str] | None) -> int:
        """Run one line; returns the exit code. None stands for a line that cannot be read."""
        from seatrial.apps.console import fail
        from seatrial.apps.session import how_it_ended

        if not words:
            return Exit.OK if words is not None else Exit.BAD_INPUT
        if words == ["help"]:
            echo(_HELP + "\n" + "\n".join(_listed()))
            return Exit.OK
        if words[0] in _NOT_HERE:
            fail(f"{words[0]} runs until it is stopped: start it outside this session")
            return Exit.BAD_INPUT
        if self.session is None or not self.session.is_usable:
            self.close()
            self.session = self._begin()
        self.session.start(_filled_in(words, self.folder))
        code = _waited_for(self.session)
        if last_words := how_it_ended(code):
            fail(last_words)
        if self.prepares and not self.session.is_usable:
            self.close()
            self.session = self._begin()
        return code

    def close(self) -> None:
        """End the session."""
        if self.session is not None:
            self.session.close()

    def _begin(self) -> "Session":
        from seatrial.apps.session import Session

        return Session(self.folder, outlives=False, prepares=self.prepares)


def _waited_for(session: "Session") -> int:
    """Wait for a command; Ctrl-C interrupts it, and a second one ends a process that still computes."""
    end = session.interrupt
    while True:
        try:
            code = session.code(None)
            assert code is not None
            return code
        except KeyboardInterrupt:
            end()
            end = session.kill


def _words(line: str) -> list[str] | None:
    """Return the words of a line; None where they cannot be told, which is said."""
    from seatrial.apps.console import fail

    try:
        return shlex.split(line, comments=True)
    except ValueError as cause:
        fail(
            f"{line.strip()[:80]!r}: {str(cause)[:1].lower()}{str(cause)[1:]}; close it, or write \\' for an apostrophe"
        )
        return None


def _filled_in(words: list[str], folder: Path) -> list[str]:
    """Put the folder after the name of a command that works on one."""
    name, *others = words
    if name == "help":
        return [*others[:1], "--help"]
    known = _commands()
    arguments = [one for one in known[name].params if one.param_type_name == "argument"] if name in known else []
    takes_folder = any((one.metavar or "").startswith("DIR") for one in arguments[:1])
    return [name, str(folder), *others] if takes_folder else words


def _commands() -> Any:
    from seatrial.apps.cli import app

    return typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]


def _listed() -> list[str]:
    known = _commands()
    return [f"  {name:<10} {known[name].get_short_help_str(100)}" for name in known if name not in _NOT_HERE]


def _typed_lines(folder: Path) -> Iterator[str]:
    """Yield lines as they are typed; Ctrl-C forgets the one that is begun."""
    echo(f"seatrial on {folder}: `help` lists the commands, `quit` ends the session")
    with _history():
        while True:
            try:
                yield input(f"{folder.resolve().name}> ")
            except KeyboardInterrupt:
                echo()
            except EOFError:
                echo()
                return


@contextmanager
def _history() -> Iterator[None]:
    """Have arrows bring back earlier lines, of earlier sessions too, and Tab complete the names of commands."""
    try:
        import readline
    except ImportError:  # a Python without it
        yield
        return
    from seatrial.core.engine import cache_directory

    path = cache_directory().parent / "history"
    with suppress(OSError):
        readline.read_history_file(path)
    readline.set_completer(_completion)
    readline.parse_and_bind("tab: complete")
    try:
        yield
    finally:
        readline.set_history_length(_REMEMBERED)
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            readline.write_history_file(path)


def _completion(begun: str, number: int) -> str | None:
    """Return one name of a command that begins so; None after the last."""
    from seatrial.apps.cli import COMMANDS

    found = [name for name in ("help", "quit", *COMMANDS) if name.startswith(begun) and name not in _NOT_HERE]
    return f"{found[number]} " if number < len(found) else None
