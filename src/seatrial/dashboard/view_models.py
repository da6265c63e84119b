"""What the two working processes answer with: plain tuples, so that the server can take them without what made them."""

from math import floor, log10
from typing import Any, NamedTuple

import numpy as np

from seatrial.core.errors import InputError, SeatrialError, file_error


def plain_error(error: SeatrialError | OSError) -> SeatrialError:
    """Return an error in a class that every process has, with its fields: reading a class of its own could import JAX into the server."""
    if isinstance(error, OSError):
        return file_error(error)
    if isinstance(error, InputError):
        return InputError(error.where, found=error.found, expected=error.expected, remedy=error.remedy)
    return SeatrialError(str(error))


def words_of(error: BaseException) -> str:
    """Return what went wrong, in words for the page."""
    return str(file_error(error) if isinstance(error, OSError) else error)


def beside(error: SeatrialError | OSError) -> str:
    """Return what went wrong beside the field that it is about, without the place in the file, which may not stand there yet."""
    plain = plain_error(error)
    return f"{plain.found}: expected {plain.expected}; {plain.remedy}" if isinstance(plain, InputError) else str(plain)


class RecordAbout(NamedTuple):
    """What a record holds: channels with unit and role, samples, its ends in seconds from the beginning of the record, and its origin."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    roles: tuple[str, ...]
    samples: int
    start: float
    end: float
    available: float
    source: str
    notes: tuple[str, ...]


DATE = "date and time"
"""Unit of a column of text stamps, in words."""
COMPARED = "compared"
"""Role of a column that is drawn over another one, each less its mean and over its standard deviation."""


class AxisAbout(NamedTuple):
    """What several logs hold before they become a record.

    Attributes:
        names: of the channels, and of columns that are compared.
        units: of each, as it is shown.
        roles: of each: measurement, control or `COMPARED`.
        logs: of each.
        spans: first and last time of each, s from the earliest.
        interval: of the record that they would be; the first is later where they have no common time.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    roles: tuple[str, ...]
    logs: tuple[str, ...]
    spans: tuple[tuple[float, float], ...]
    interval: tuple[float, float]

    @property
    def overlaps(self) -> bool:
        """Whether the logs have a common time."""
        return self.interval[0] < self.interval[1]


class EstimatedStructure(NamedTuple):
    """Parameters of one structure before any structure is chosen.

    Attributes:
        label: of the structure.
        terms: names of its coefficients.
        rows: of each parameter its name, LaTeX label, SI unit, mean, standard deviation, and what adds most to that.
        alarms: why the draws are not to be used.
        remarks: what adds most to the ±, and how to reduce it.
    """

    label: str
    terms: tuple[str, ...]
    rows: tuple[tuple[str, str, str, float, float, str], ...]
    alarms: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


class CheckRow(NamedTuple):
    """One row of the checks of a record.

    Attributes:
        level: pass, note, caution or alarm.
        code: of the catalogue of messages; empty of a sentence without one.
        words: what was found.
        remedy: what to do; empty if there is nothing to do.
        view: of the dashboard where that is done; empty if the words name none.
    """

    level: str
    code: str
    words: str
    remedy: str = ""
    view: str = ""


class CheckedRecord(NamedTuple):
    """One record: its label, the gravest level, a row for each finding, and the file of its raw plot."""

    label: str
    level: str
    rows: tuple[CheckRow, ...]
    picture: str


class Checked(NamedTuple):
    """What the last check says of the records and of the vehicle, and whether all that it rests on is as it was then."""

    records: tuple[CheckedRecord, ...]
    cautions: tuple[str, ...]
    is_current: bool

    @property
    def has_alarms(self) -> bool:
        """Whether a record is not to be used as it is."""
        return any(one.level == "alarm" for one in self.records)


class FormData(NamedTuple):
    """What the forms need to know of a campaign."""

    imported: bool
    simulated: bool
    channels: tuple[str, ...]
    controls: tuple[str, ...]
    """Those of them that drive the vehicle."""
    fit: tuple[str, ...]
    predict: tuple[str, ...]


class OfferedTerm(NamedTuple):
    """A term that the vehicle of a campaign may have, and what its prior would be, in words."""

    name: str
    prior: str


class ExportTarget(NamedTuple):
    """A target of `seatrial export`: why it cannot be, empty if it can, and which terms it does not support."""

    name: str
    is_trial: bool
    refusal: str
    unsupported: tuple[str, ...]


class Margin(NamedTuple):
    """How far a design stays from one bound: what is bounded, the bound, what is reached, and the room left; in words."""

    what: str
    bound: str
    reached: str
    room: str
    kept: bool


class Clicked(NamedTuple):
    """One design, looked at: its control in the unit in which it is shown, over time, s."""

    words: str
    time: np.ndarray
    control: np.ndarray
    margins: tuple[Margin, ...]
    schedule: str


STEPS = 200
"""Steps of a slider."""


class Movable(NamedTuple):
    """A number that may be moved, in a unit of which there are `factor` in an SI unit; `sd` is 0 of what is taken as exact.

    A slider goes from `lower` to `upper`; `value` is the present one.
    """

    name: str
    label: str
    unit: str
    factor: float
    best: float
    sd: float
    lower: float
    upper: float
    value: float

    @property
    def step(self) -> float:
        """Step of its slider."""
        return float(f"{(self.upper - self.lower) / STEPS:.2g}")

    def shown(self, value: float) -> float:
        """Return a value with the digits that a step can change."""
        return round(value, 1 - floor(log10(self.step)))


class Tweaking(NamedTuple):
    """What is moved: structure and record, the first ones if empty; moved values as they are shown; whether the others follow."""

    structure: str = ""
    record: str = ""
    moved: tuple[tuple[str, float], ...] = ()
    follow: bool = False


class Tweaked(NamedTuple):
    """A record with moved values, as they are shown.

    Attributes:
        structures: labels, the chosen one first.
        records: labels, fitted ones first.
        numbers: all that may be moved.
        curves: `NAME`, `NAME residual`, `NAME best` and `NAME measured` of each channel.
        span: first and last time, s.
        channels: name and unit of each, and the shares explained now and by the best values.
        below: by how much the log likelihoods of the record and of all fitted ones are below the best, nats.
        distance: as that of `Tweak`.
        probability: likewise.
    """

    structures: tuple[str, ...]
    records: tuple[str, ...]
    numbers: tuple[Movable, ...]
    curves: dict[str, Any]
    span: tuple[float, float]
    channels: tuple[tuple[str, str, float, float], ...]
    below: tuple[float, ...]
    distance: float
    probability: float
