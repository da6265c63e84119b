"""One table, figure or claim of the paper: what it prints, what was found, and the verdict."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Verdict = Literal["reproduced", "reproduced in shape", "differs", "cannot hold"]


@dataclass(frozen=True)
class Number:
    """One number of an item beside the printed one.

    Attributes:
        name: what it is, unit included.
        printed: as the paper prints it; None where it prints none.
        found: here.
        error: its Monte Carlo standard error; 0 where there is none.
    """

    name: str
    printed: float | None
    found: float
    error: float = 0.0


@dataclass(frozen=True)
class Item:
    """One item with its verdict.

    Attributes:
        key: name for `--only`, such as `table-1`.
        title: what it is.
        verdict: judgement.
        because: reason, one sentence; empty for what is reproduced.
        numbers: what was compared.
        settings: how it was computed, seeds included.
    """

    key: str
    title: str
    verdict: Verdict
    because: str = ""
    numbers: tuple[Number, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """The verdict in one line."""
        return f"{self.verdict}, because {self.because}" if self.because else self.verdict

    def as_json(self) -> dict[str, Any]:
        """Everything, JSON-able."""
        return {**asdict(self), "words": self.words}
