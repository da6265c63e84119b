"""Findings: results of checks as plain data, which numerical packages return and `messages` puts into words."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

# A pass found nothing wrong; a note casts no doubt on a result; an alarm forbids using it.
Level = Literal["pass", "note", "caution", "alarm"]
LEVELS: tuple[Level, ...] = ("alarm", "caution", "note", "pass")  # In order of gravity
Scalar = bool | int | float | str
Row = Scalar | tuple[Scalar, ...]
Value = Scalar | tuple[Row | tuple[Row, ...], ...]


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Attributes:
        code: entry of the catalogue, in readable words such as `residuals-correlated`; codes are stable.
        level: how grave it is.
        subject: signals, coefficients or parameters that it concerns.
        values: numbers in SI and names that the sentence needs; `run` and `structure` are those of the finding.
        remedies: names of remedies of the catalogue, the best first.
    """

    code: str
    level: Level
    subject: tuple[str, ...] = ()
    values: Mapping[str, Value] = field(default_factory=dict, hash=False)
    remedies: tuple[str, ...] = ()

    def among(self, **values: Value) -> "Finding":
        """Return the same finding with further values, such as the run in which it was made."""
        return replace(self, values={**self.values, **values})

    @property
    def is_accepted(self) -> bool:
        """Whether the user knows of it and accepts it."""
        return bool(self.values.get("accepted"))


Message = Finding | str  # A finding, or a sentence of a check that has no code yet


def accept(findings: Iterable[Finding], codes: Collection[str]) -> list[Finding]:
    """Return findings in which those of accepted codes are notes without a remedy."""
    return [
        replace(one, level="note", remedies=()).among(accepted=True)
        if one.code in codes and one.level != "pass"
        else one
        for one in findings
    ]
