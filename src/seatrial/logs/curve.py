"""Curves that say what a logged number stands for, such as the thrust of a thruster at each PWM width."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.files import sha256_of

_MIN_POINTS = 2


class CellCurve(Protocol):
    """What a logged number stands for."""

    @property
    def name(self) -> str:
        """Return what is said of it in the provenance of a record."""
        ...

    def __call__(self, cells: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return what every number stands for; NaN if the curve does not reach it, and NaN stays NaN."""
        ...

    def check(self, cells: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], where: str) -> None:
        """Check that the curve explains all of some numbers.

        Args:
            cells: numbers as logged, those that are used.
            time: when each was logged, s from the beginning of the log.
            where: log and column, for the error.

        Raises:
            InputError: a number that it does not explain.
        """
        ...


@dataclass(frozen=True)
class Curve:
    """Points between which a number is interpolated.

    Attributes:
        name: of the file.
        sha256: of its bytes.
        logged: numbers as logged, increasing.
        value: what each stands for, in the unit of the column.
    """

    name: str
    sha256: str
    logged: tuple[float, ...]
    value: tuple[float, ...]

    def __call__(self, cells: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Interpolate; NaN beyond the ends, and NaN stays NaN."""
        return np.interp(cells, self.logged, self.value, left=np.nan, right=np.nan)

    def check(
        self, cells: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], where: str, remedy: str = ""
    ) -> None:
        """Refuse numbers beyond the ends, see `CellCurve`; `remedy` is added to the advice."""
        point = f"or add a point to {self.name}, for example a row 0,0 if 0 means no thrust"
        ends = self.logged[0], self.logged[-1]
        check_within(cells, time, where, ends, f"the ends of {self.name}", point + remedy)


def check_within(
    cells: Float[np.ndarray, " n"],
    time: Float[np.ndarray, " n"],
    where: str,
    ends: tuple[float, float],
    called: str,
    remedy: str,
) -> None:
    """Refuse numbers beyond the ends of a curve or a law, see `CellCurve`.

    Args:
        cells: numbers as logged, those that are used.
        time: when each was logged, s from the beginning of the log.
        where: log and column, for the error.
        ends: least and largest number that it reaches.
        called: name of the ends.
        remedy: added to the advice to keep the other rows only.

    Raises:
        InputError: a number beyond the ends.
    """
    outside = np.flatnonzero((cells < ends[0]) | (cells > ends[1]))
    if outside.size:
        raise InputError(
            where,
            found=f"{outside.size} of the {cells.size} rows kept are outside the curve; the first is {cells[outside[0]]:g}, "
            f"{time[outside[0]]:g} s into the log",
            expected=f"{ends[0]:g} to {ends[1]:g}, {called}",
            remedy='keep the other rows only, by [[import.keep]] with for example when = "armed == 1", or by start and end; '
            + remedy,
        )


def read_curve(path: Path, where: str) -> Curve:
    """Read a CSV of two columns with a header.

    Args:
        path: of the file.
        where: file and key that name it, for errors.

    Raises:
        InputError: no such file, not two columns of numbers, fewer than two rows, or numbers that do not increase.
    """
    if not path.is_file():
        raise InputError(where, found=f"no file {path}", expected="a CSV of two columns", remedy="correct the path")
    _check_header(path)
    try:
        rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2, encoding="utf-8-sig")
    except ValueError as cause:
        raise _malformed(path, str(cause)) from cause
    if rows.shape[0] < _MIN_POINTS or rows.shape[1] != 2 or not np.isfinite(rows).all():
        raise _malformed(path, f"{rows.shape[0]} rows of {rows.shape[1]} numbers")
    back = np.flatnonzero(np.diff(rows[:, 0]) <= 0)
    if back.size:
        raise InputError(
            f"{path}, row {back[0] + 3}",
            found=f"{rows[back[0] + 1, 0]:g} after {rows[back[0], 0]:g}",
            expected="logged numbers that increase from row to row",
            remedy="sort the rows, and drop repetitions",
        )
    return Curve(path.name, sha256_of(path), tuple(rows[:, 0].tolist()), tuple(rows[:, 1].tolist()))


def _check_header(path: Path) -> None:
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        first = stream.readline().strip()
    try:
        [float(cell) for cell in first.split(",")]
    except ValueError:
        return
    raise InputError(
        f"{path}, row 1",
        found=f'"{first}"',
        expected="a header, such as pwm,thrust",
        remedy="write one above the numbers: the first row is not read as a point",
    )


def _malformed(path: Path, found: str) -> InputError:
    return InputError(
        str(path),
        found=found,
        expected="a header, then rows of two numbers: the logged one, and its meaning",
        remedy="save the table as a CSV with a comma between two columns",
    )
