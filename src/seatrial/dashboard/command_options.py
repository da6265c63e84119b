"""The options of a command as a form has them, read from the command itself: so a page offers what a shell offers."""

from collections.abc import Mapping
from enum import StrEnum
from inspect import signature
from pathlib import Path
from types import NoneType
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from typer.models import OptionInfo

from seatrial.cli.main import COMMANDS
from seatrial.core.errors import InputError

STARTED = {name: command.makes for name, command in COMMANDS.items() if command.makes}
"""Commands that may be started from the page, and what they make."""
Value = str | bool | None
"""What stands in a field; a flag is true or false."""


class CommandOption(NamedTuple):
    """One option of a command.

    Attributes:
        name: as it is written, such as `--free-form`.
        meaning: its help.
        kind: a flag, a whole number, one of some words, or a text; a text may contain several separated by commas if `is_list`.
        default: as a text; empty if there is none.
        least: of a number; None for no bound.
        most: likewise.
        choices: words to choose from.
        is_list: whether it may be given several times.
    """

    name: str
    meaning: str
    kind: Literal["flag", "number", "choice", "text"]
    default: str = ""
    least: float | None = None
    most: float | None = None
    choices: tuple[str, ...] = ()
    is_list: bool = False


def options_of(command: str) -> tuple[CommandOption, ...]:
    """Return the options of a command; not those that only change how it prints, nor those that name files anywhere."""
    called = COMMANDS[command].function
    defaults = {name: one.default for name, one in signature(called).parameters.items()}
    options = []
    for name, hint in get_type_hints(called, include_extras=True).items():
        about = next((one for one in getattr(hint, "__metadata__", ()) if isinstance(one, OptionInfo)), None)
        if about is not None and name not in ("quiet", "verbose") and Path not in _types(hint):
            options.append(_option(name, hint, about, defaults.get(name)))
    return tuple(options)


def words_of_options(command: str, values: Mapping[str, Value]) -> list[str]:
    """Return what is written after a command for the values of its form; what is left as it is is not written.

    Raises:
        InputError: a value that the option cannot have.
    """
    words = []
    for option in options_of(command):
        value = values.get(option.name)
        if option.kind == "flag":
            words += [option.name] if value else []
            continue
        text = str(value or "").strip()
        if text and text != option.default:
            parts = [part.strip() for part in text.split(",")] if option.is_list else [text]
            words += [f"{option.name}={_checked(option, part)}" for part in parts if part]
    return words


def _types(hint: Any) -> list[Any]:
    kind = get_args(hint)[0]
    return [one for one in get_args(kind) or (kind,) if one is not NoneType]


def _option(name: str, hint: Any, about: OptionInfo, default: Any) -> CommandOption:
    # Inside Annotated the first name stands where a default would.
    declared = (about.default, *(about.param_decls or ()))
    written = next((one for one in declared if str(one).startswith("--")), f"--{name.replace('_', '-')}")
    kind = _types(hint)[0]
    meaning, shown = str(about.help or ""), "" if default is None else str(default)
    if kind is bool:
        return CommandOption(written, meaning, "flag")
    if kind is int:
        return CommandOption(written, meaning, "number", shown, about.min, about.max)
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return CommandOption(written, meaning, "choice", shown, choices=tuple(kind))
    return CommandOption(written, meaning, "text", shown, is_list=get_origin(kind) is list)


def _checked(option: CommandOption, text: str) -> str:
    if option.kind == "choice" and text not in option.choices:
        raise _refused(option, text, "one of " + ", ".join(option.choices))
    if option.kind == "number":
        if not text.isascii() or not text.isdigit():
            raise _refused(option, text, "a whole number")
        if (option.least is not None and int(text) < option.least) or (
            option.most is not None and int(text) > option.most
        ):
            raise _refused(option, text, f"{option.least:g} to {option.most:g}")
    return text


def _refused(option: CommandOption, text: str, expected: str) -> InputError:
    return InputError(option.name, found=repr(text[:40]), expected=expected, remedy=option.meaning)
