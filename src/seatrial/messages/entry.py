"""One entry of the catalogue of messages, and the formats of the values in its templates.

A template is a format string with the values of a finding and `subject`. Besides the formats of Python there are

    {subject:and}       names as a sentence has them: `u, v and w`
    {value:signal}      an SI value in the unit in which the signal of the subject is shown: `12 deg`
    {value:size}        two digits without a power of ten: `3.4`, `120`
    {value:late}        a time and its sign: `0.3 s late`
    {value:count}       a whole number with thousands: `10 000`
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from string import Formatter
from typing import Any, Literal

from seatrial.core.display_units import listed, plain, shown_unit
from seatrial.core.findings import Finding, Value

Form = Literal["command", "python", "page"]
"""Place where a remedy is read: on the terminal with a campaign file, in a notebook, or in the dashboard."""
Template = str | Callable[[Mapping[str, Any]], str]
"""A format string, or a function of values and subject that returns one: for sentences with parts that depend on a value."""


@dataclass(frozen=True)
class Remedy:
    """One thing to do, as a command that begins with a verb.

    Attributes:
        command: with keys of the campaign file or commands.
        python: with arguments of the library; the same as `command` if empty.
        page: with fields of the dashboard; the same as `command` if empty.
        view: key of the view of the dashboard for it; empty if it is done elsewhere.
    """

    command: Template
    python: Template = ""
    page: Template = ""
    view: str = ""

    def of(self, form: Form) -> Template:
        """Return the template for one place."""
        return getattr(self, form) or self.command


@dataclass(frozen=True)
class Entry:
    """One entry: the texts of one code.

    Attributes:
        title: in a few words.
        sentence: one sentence without a final stop, by level if the levels differ (the first for levels not named). A pass has only
            the name of the check.
        meaning: its consequence, in one or two sentences.
        decided: how it is decided, with the limits of `thresholds`.
        example: a finding, shown as a sentence on the page.
        remedies: all remedies of this code; those of the example if empty.
    """

    title: str
    sentence: Template | Mapping[str, Template]
    meaning: str
    decided: str
    example: Finding
    remedies: tuple[str, ...] = ()

    def template(self, level: str) -> Template:
        """Return the template of the sentence at one level."""
        if isinstance(self.sentence, Mapping):
            return self.sentence.get(level) or next(iter(self.sentence.values()))
        return self.sentence


class _ValueFormatter(Formatter):
    """Formats SI values by the names of formats above."""

    def __init__(self, subject: tuple[str, ...]):
        self.signal = subject[0] if subject else ""

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec in ("and", "or"):
            return listed(value, format_spec)
        if format_spec == "signal":
            factor, unit = shown_unit(self.signal)
            return f"{value * factor:.4g} {unit}"
        if format_spec == "size":
            return plain(value)
        if format_spec == "late":
            return f"{abs(value):.2g} s {'late' if value > 0 else 'early'}"
        if format_spec == "count":
            return f"{value:,.0f}".replace(",", " ")
        return super().format_field(value, format_spec)


def filled_in(template: Template, subject: tuple[str, ...], values: Mapping[str, Value]) -> str:
    """Return a template with its values."""
    named = {**values, "subject": subject}
    text = template if isinstance(template, str) else template(named)
    return _ValueFormatter(subject).vformat(text, (), named)
