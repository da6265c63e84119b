"""What a command says: lines for people, or with `--json` one document on standard output, whatever the command.

A command speaks through its `Answer`: `say` prints lines, `give` adds to the result that programs read, `wrote` names a file. Types of
the results: `result_schema.py`.
"""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import is_dataclass
from enum import IntEnum
from math import isfinite
from pathlib import Path
from typing import Any

import typer

from seatrial import __version__
from seatrial.core.errors import InputError, NumericalError, SeatrialError, file_error
from seatrial.core.findings import Finding, Level, Message, accept
from seatrial.core.visible import visible

SCHEMA = 2  # Version of the documents that `--json` prints


def echo(text: str = "", err: bool = False) -> None:
    """Print lines for people, or a document for programs; characters that a terminal would obey are shown instead."""
    typer.echo(visible(text), err=err)


class Exit(IntEnum):
    """Exit codes of every command."""

    OK = 0
    BUG = 1
    BAD_INPUT = 2
    ALARMS = 3
    NUMERICAL = 4
    INTERRUPTED = 130


class Answer:
    """What a command says of a campaign: its results on standard output, cautions and alarms on standard error.

    Args:
        command: its name.
        as_json: whether a document takes the place of lines on standard output.
    """

    def __init__(self, command: str = "", as_json: bool = False) -> None:
        self.command, self.as_json = command, as_json
        self.printed: list[tuple[str, bool]] = []
        self.accepted: Collection[str] = ()
        self.content: dict[str, Any] = {"result": {}, "files": {}, "cautions": [], "alarms": [], "findings": []}

    def say(self, text: str, err: bool = False) -> None:
        """Print some lines, and remember them."""
        if err or not self.as_json:
            echo(text, err=err)
        self.printed.append((text, err))

    def give(self, **result: Any) -> None:
        """Add to the result that `--json` prints; arrays become lists, and what is no number null."""
        self.content["result"] |= plain(result)

    def give_result(self, result: Any) -> None:
        """Print with `--json` a result as its family defines it."""
        self.give(**plain(result))

    def wrote(self, what: str, path: Path) -> None:
        """Return where something was written."""
        self.say(f"{what}: {path}")
        self.name_file(what, path)

    def name_file(self, what: str, path: Path) -> None:
        """Add a file to those that `--json` names."""
        self.content["files"][what] = str(path)

    def caution(self, *messages: Message) -> None:
        """Print what a reader must know, on standard error."""
        self._warn("caution", messages)

    def finish(self, alarms: Sequence[Message], cautions: Sequence[Message]) -> Exit:
        """Print what is wrong to standard error, and say by the exit code whether results may be used."""
        self._warn("caution", cautions)
        return Exit.ALARMS if self._warn("alarm", alarms) else Exit.OK

    def give_findings(self, findings: Sequence[Finding]) -> None:
        """Add findings that are printed elsewhere to those that `--json` prints."""
        from seatrial.messages.render import row_of

        self.content["findings"] += [plain(row_of(one)) for one in findings]

    def _warn(self, level: Level, messages: Sequence[Message]) -> bool:
        """Print messages, accepted findings in one line each; returns whether others remain."""
        from seatrial.messages.render import blocks, sentences, statement

        findings = accept((one for one in messages if isinstance(one, Finding)), self.accepted)
        self.give_findings(findings)
        for one in findings:
            if one.is_accepted:
                self.say(statement(one), err=True)
        remaining = [one for one in messages if not (isinstance(one, Finding) and one.code in self.accepted)]
        for text in blocks(remaining):
            self.say(f"{level}: {text}", err=True)
        self.content[f"{level}s"] += sentences(remaining)
        return bool(remaining)

    def kept(self, code: Exit) -> dict[str, Any]:
        """Return what is kept of the answer, to be given again."""
        return {"lines": self.printed, "told": self.content, "exit": int(code)}

    def repeat(self, kept: Mapping[str, Any]) -> Exit:
        """Give a kept answer again."""
        for line, err in kept["lines"]:
            self.say(line, err=err)
        self.content = kept["told"]
        return Exit(kept["exit"])

    def document(self, code: int, error: Exception | None = None) -> str:
        """Return the document that `--json` prints."""
        whole = {"schema": SCHEMA, "seatrial": __version__, "command": self.command, "exit": code, "error": None}
        whole |= self.content
        if error is not None:
            parts = {part: str(getattr(error, part, "")) for part in ("where", "found", "expected", "remedy")}
            whole |= {"result": None, "error": {"message": str(error), **parts}}
        return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False)


_CURRENT: ContextVar[Answer | None] = ContextVar("answer", default=None)


def current_answer() -> Answer:
    """Return the answer of the command that runs; one that prints lines where none does."""
    return _CURRENT.get() or Answer()


@contextmanager
def answering(command: str, as_json: bool) -> Iterator[None]:
    """Let `current_answer` be of this command while the block runs, and print its document at the end where one is asked for."""
    answer, code, failure = Answer(command, as_json), int(Exit.BUG), None
    token = _CURRENT.set(answer)
    try:
        yield
        code = int(Exit.OK)
    except typer.Exit as end:
        code = end.exit_code
        raise
    except (SeatrialError, OSError) as error:
        failure = file_error(error) if isinstance(error, OSError) else error
        code = int(code_of(failure))
        raise
    finally:
        _CURRENT.reset(token)
        if as_json:
            echo(answer.document(code, failure))


def code_of(error: SeatrialError) -> Exit:
    """Return the exit code of an error that is meant for the user."""
    if isinstance(error, InputError):
        return Exit.BAD_INPUT
    return Exit.NUMERICAL if isinstance(error, NumericalError) else Exit.BUG


def plain(value: Any) -> Any:
    """Return a value as JSON has it: mappings, lists, texts and finite numbers; None for what is no number."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if isfinite(value) else None
    if is_dataclass(value):
        from seatrial.core.serialise import to_plain  # with it pydantic, which a kept answer does not need

        return to_plain(value, stored=False)
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(one) for one in value]
    return plain(value.tolist()) if hasattr(value, "tolist") else str(value)
