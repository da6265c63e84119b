"""Keys of a campaign file as its readers take them: where each stands, for errors, and the quantity that it holds, in SI."""

from dataclasses import dataclass
from pathlib import Path

from seatrial.campaign.config.quantities import LARGEST, SMALLEST, Quantity
from seatrial.campaign.config.toml import key_place
from seatrial.core.errors import InputError
from seatrial.core.units import quantity


@dataclass(frozen=True)
class FileKeys:
    """The keys of one file.

    Attributes:
        path: of the file.
        text: its content.
    """

    path: Path
    text: str

    def where(self, key: str) -> str:
        """Name a key and its line, for errors."""
        return key_place(self.path, self.text, key)

    def without_effect(self, key: str, because: str, remedy: str = "remove it") -> InputError:
        """Return the error of a key that nothing reads beside the others: its author expects something of it."""
        return InputError(
            self.where(key),
            found=f"a key without effect: {because}",
            expected="keys that have an effect",
            remedy=remedy,
        )

    def si(self, written: Quantity, unit: str, key: str) -> float:
        """Read a quantity.

        Raises:
            InputError: no quantity of this dimension, or one of a size that nothing has.
        """
        value = quantity(written, unit, self.where(key))
        if value == 0 or SMALLEST <= abs(value) <= LARGEST:
            return value
        raise InputError(
            self.where(key),
            found=f'"{written}", which is {value:.3g} {unit}',
            expected=f"0, or a size from {SMALLEST:g} to {LARGEST:g} in SI",
            remedy="correct the number or its unit",
        )
