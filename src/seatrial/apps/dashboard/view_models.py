"""What the two working processes answer with: plain tuples, so that the server can take them without what made them."""

from typing import NamedTuple

import numpy as np

from seatrial.core.errors import SeatrialError, file_error


class PlainError(SeatrialError):
    """An error of another process, in words."""


def words_of(error: BaseException) -> str:
    """Say what went wrong, in words for the page."""
    return str(file_error(error) if isinstance(error, OSError) else error)


class Stage(NamedTuple):
    """One step of a campaign: its name, whether its results are current, stale or missing, and the command that makes them."""

    name: str
    state: str
    command: str


class Plot(NamedTuple):
    """A drawing, and where its axes are: left, top, right, bottom as shares of it; the values at the ends of both axes."""

    svg: str
    box: tuple[float, float, float, float]
    x: tuple[float, float]
    y: tuple[float, float]


class RecordAbout(NamedTuple):
    """What a record holds: channels with unit and role, samples, its ends in seconds from where its files overlap, and its origin."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    roles: tuple[str, ...]
    samples: int
    start: float
    end: float
    available: float
    source: str
    notes: tuple[str, ...]


class Swept(NamedTuple):
    """A stored sweep, for the forms beside its picture; numbers in the units in which they are shown, NaN where a limit is broken."""

    families: tuple[str, ...]
    control: str
    unit: str
    amplitude: tuple[float, ...]
    period: tuple[float, ...]
    gain: np.ndarray
    worth: np.ndarray
    best: tuple[int, int, int]
    names: tuple[str, ...]
    sd_before: tuple[float, ...]
    final_sd: np.ndarray
    peak_speed: np.ndarray
    length: np.ndarray
    basis: str
    refused: dict[str, str]
    safety: tuple[str, ...]
    prediction: tuple[str, ...]


class Limit(NamedTuple):
    """A row of the form of limits: signal, unit in which it is shown, bounds as written, and whether it may have a rate."""

    name: str
    unit: str
    lower: str
    upper: str
    rate: str
    has_rate: bool


class FormData(NamedTuple):
    """What the forms need to know of a campaign."""

    name: str
    imported: bool
    simulated: bool
    control: str
    channels: tuple[str, ...]
    limits: tuple[Limit, ...]
    spare: tuple[str, ...]
    """Signals that may be limited and are not."""
    truth: tuple[tuple[str, float], ...]
    fit: tuple[str, ...]
    predict: tuple[str, ...]


class Beginning(NamedTuple):
    """A template to begin from: what it is, and the published vehicles it may be of, its own first; none where it is by hand."""

    template: str
    meaning: str
    vehicles: tuple[str, ...]


class Margin(NamedTuple):
    """How far a design stays from one bound: what is bounded, the bound, what is reached, and the room left; in words."""

    what: str
    bound: str
    reached: str
    room: str
    kept: bool


class Clicked(NamedTuple):
    """One design, looked at."""

    words: str
    control: Plot
    margins: tuple[Margin, ...]
    schedule: str
