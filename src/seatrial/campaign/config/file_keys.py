"""Keys of a campaign file as its readers take them: where each stands, for errors, and the quantity that it holds, in SI."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seatrial.campaign.config.schema import Quantity, RangeTable
from seatrial.campaign.config.toml import key_place
from seatrial.core.errors import InputError
from seatrial.core.units import quantity

SMALLEST, LARGEST = 1e-30, 1e30
"""Sizes of a quantity, SI, whose products and quotients double precision still holds."""


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

    def positive_range(self, table: RangeTable, unit: str, key: str) -> tuple[float, ...]:
        """Read evenly spaced positive quantities.

        Raises:
            InputError: as `si`, ends in the wrong order, or two ends of one point.
        """
        start, stop = self.si(table.start, unit, f"{key}.from"), self.si(table.stop, unit, f"{key}.to")
        if not 0 < start <= stop:
            raise InputError(
                self.where(key),
                found=f"from {table.start} to {table.stop}",
                expected="0 < from <= to",
                remedy="swap or correct them",
            )
        if table.points == 1 and start != stop:
            raise InputError(
                self.where(key),
                found=f"1 point from {table.start} to {table.stop}",
                expected="2 points or more, or `from` and `to` the same",
                remedy="ask for more points",
            )
        return tuple(np.linspace(start, stop, table.points).tolist())
