"""Quantities of a campaign file: the annotation of a field says its unit, and validation converts what is written to SI.

Some units depend on a name: the noise of `[sensors.u]` has that of u. Such names are noted in the context of the validation, under the
word that stands in braces in the units that follow them: `Unit("{channel}")`.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetCoreSchemaHandler, Strict, ValidationInfo
from pydantic_core import PydanticCustomError, PydanticKnownError, core_schema

from seatrial.core.errors import InputError
from seatrial.core.signals import is_signal, signal_unit
from seatrial.core.units import quantity

SMALLEST, LARGEST = 1e-30, 1e30  # Sizes of a quantity, SI, whose products and quotients double precision still holds
REFUSED = "refused"  # Type of the errors of `refused`
# Former names of keys, which are refused with the new ones.
RENAMED = {
    "known_from": "priors_from",
    "published_to": "published_prior_sd",
    "given": "measured_inputs",
    "physical": "dissipative",
    "over": "reference",
    "late": "delay",
    "moves": "drives",
}
Item = TypeVar("Item")
Several = Annotated[tuple[Item, ...], Strict(False)]  # A list of the file


class Table(BaseModel):
    """A TOML table: unknown keys are refused, and nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def refused(found: str, expected: str, remedy: str, key: str = "") -> PydanticCustomError:
    """Return the error of a value or of a table that a validator refuses; `key` is that of the table which is at fault."""
    return PydanticCustomError(
        REFUSED,
        "{found}; expected {expected}; {remedy}",
        {"found": found, "expected": expected, "remedy": remedy, "key": key},
    )


@contextmanager
def refusing(key: str = "") -> Iterator[None]:
    """Turn an error of the block into that of a value or of a key of a table."""
    try:
        yield
    except InputError as error:
        raise refused(error.found, error.expected, error.remedy, key) from None


def without_effect(key: str, because: str, remedy: str = "remove it") -> PydanticCustomError:
    """Return the error of a key that nothing reads beside the others: its author expects something of it."""
    return refused(f"a key without effect: {because}", "keys that have an effect", remedy, key)


@dataclass(frozen=True)
class Unit:
    """Annotates a number in SI, which a file gives as text such as "200 rpm"; without a file, a number is one in SI already.

    Attributes:
        symbol: SI unit; a word in braces stands for the unit of the name that was noted under it.
        means: the unit in words, if it depends on a name.
        above, least, most: bounds, SI; the first is excluded.
        expected: the bounds in words.
        remedy: for a value beyond them.
    """

    symbol: str
    means: str = ""
    above: float = -inf
    least: float = -inf
    most: float = inf
    expected: str = ""
    remedy: str = "correct the number"

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        """Return what validates."""
        return core_schema.with_info_plain_validator_function(self._read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """Return what an editor needs to know."""
        return {"type": "string", "unit": self.shown} if self.symbol != "1" else {"type": ["string", "number"]}

    @property
    def shown(self) -> str:
        """The unit for people."""
        return self.means or self.symbol

    def _read(self, value: Any, info: ValidationInfo) -> float:
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise PydanticKnownError("string_type")
        if info.context is None:
            return float(value)
        unit = self.symbol_of(info.context)
        if unit is None:
            return 0.0  # of a name that is no signal, which whoever knows the vehicle refuses
        with refusing():
            number = quantity(value, unit, "")
        if number != 0 and not SMALLEST <= abs(number) <= LARGEST:
            raise refused(
                f'"{value}", which is {number:.3g} {unit}',
                f"0, or a size from {SMALLEST:g} to {LARGEST:g} in SI",
                "correct the number or its unit",
            )
        if not (number > self.above and self.least <= number <= self.most):
            raise refused(f"{value}", self.expected or f"more than {self.above:g}", self.remedy)
        return number

    def symbol_of(self, units: dict[str, str | None]) -> str | None:
        """Return the symbol, completed by the units that were noted; None if one of them is not known."""
        words = [word.partition("}")[0] for word in self.symbol.split("{")[1:]]
        known = {word: unit for word in words if (unit := units.get(word)) is not None}
        return self.symbol.format(**known) if len(known) == len(words) else None


def noted(word: str) -> AfterValidator:
    """Return what notes the unit of a signal that is named, for the units that follow it in the file."""

    def note(name: str, info: ValidationInfo) -> str:
        if info.context is not None:
            info.context[word] = signal_unit(name) if is_signal(name) else _NO_SIGNALS.get(name)
        return name

    return AfterValidator(note)


_NO_SIGNALS = {"attitude": "rad"}  # Units of what a sensor may show that is no signal of its own


def first_noted(word: str) -> AfterValidator:
    """Return what notes the unit of the first signal of a table by names."""
    note: Callable[[str, ValidationInfo], str] = noted(word).func  # type: ignore[assignment]
    return AfterValidator(lambda table, info: (note(next(iter(table), ""), info), table)[1])


@dataclass(frozen=True)
class RangeOf:
    """Annotates a table whose quantities have the unit `{range}`, which is that of this symbol."""

    symbol: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        """Return what validates."""
        return core_schema.with_info_wrap_validator_function(self._read, handler(source))

    def _read(self, value: Any, inner: core_schema.ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        if info.context is not None:
            info.context["range"] = Unit(self.symbol).symbol_of(info.context)
        return inner(value)


Quantity = str | float  # A number and its unit in quotes, of which only the vehicle says the unit; a number alone is SI
Metres = Annotated[float, Unit("m")]
Seconds = Annotated[float, Unit("s")]
OfControl = Annotated[float, Unit("{control}", "that of the control")]
RateOfControl = Annotated[float, Unit("({control})/s", "that of the control, per second")]
OfChannel = Annotated[float, Unit("{channel}", "that of the channel")]
Turnaround = Annotated[float, Unit("s", least=0.0, expected="0 s or more", remedy='for example "2 min"')]


# What stands in headings: one line of text.
Name = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")]
Residuals = Literal["white", "coloured", "heavy", "drifting", "proportional"]


# Whether something is unknown, and if so whether all trials share it or every one has its own.
Scope = Literal["none", "shared", "own"]
