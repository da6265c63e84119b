"""A live session: every sample through the gates, into the file and through the filter, and a look at what is known now and then."""

import time
from collections import deque
from dataclasses import dataclass

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.live.advice import Adviser, Look
from seatrial.campaign.live.channels import Arrival, Channels, lined_controls
from seatrial.campaign.live.gates import ClockGate, Notes, ValueGate
from seatrial.campaign.live.innovations import InnovationMemory
from seatrial.campaign.live.next_segment import Library
from seatrial.campaign.live.recursion import live_recursion
from seatrial.campaign.live.session_files import Kept
from seatrial.campaign.live.sources import Piece
from seatrial.campaign.live.stream_check import StreamCheck
from seatrial.numerics.gaussian import Gaussian

OFTEN = 1.0
"""Seconds of the stream between two looks."""


@dataclass(frozen=True)
class LiveSettings:
    """How a stream is taken.

    Attributes:
        gap: s without a sample, beyond which the states begin anew.
        hold: s for which a goal has to be met before it is called so.
    """

    gap: float = 2.0
    hold: float = 5.0


class Session:
    """One stream into one campaign.

    Args:
        campaign: of `load_campaign`; its whole structure is followed, from its priors.
        name: of the stream, for messages.
        settings: how it is taken.
        library: of segments; None where there is none.

    Raises:
        InputError: a prior that is missing, or a curve that cannot be read.
    """

    def __init__(
        self, campaign: Campaign, name: str, settings: LiveSettings = LiveSettings(), library: Library | None = None
    ):
        self.campaign, self.notes = campaign, Notes()
        self.recursion = live_recursion(campaign)
        self.controls, self.measured = self.recursion.model.controls, campaign.channels
        self.channels = Channels(campaign, name, self.notes.say)
        self.clock = ClockGate(settings.gap, self.notes.say)
        sizes = {name: max(abs(one.lower), abs(one.upper)) for name, one in campaign.control_limits.items()}
        known = {name: size for name, size in sizes.items() if np.isfinite(size) and size > 0}
        self.values = ValueGate({} if library is None else library.sizes, known, self.notes.say)
        self.memory = InnovationMemory(len(self.measured))
        self.adviser = Adviser(self.recursion, self.measured, campaign.goal, settings.hold, campaign.shown, library)
        lined = lined_controls(campaign.imports)
        self.check = StreamCheck(campaign, lined, self.notes.say)
        self.lined = np.array([name in lined for name in self.controls])
        self.delay = float(campaign.prior("delay").mean) if campaign.has_delay else 0.0
        self.control: dict[str, float] = {}
        self.sent: deque[tuple[float, np.ndarray]] = deque()
        self.coefficients = self.recursion.prior
        self.belief: Gaussian | None = None
        self.held = np.zeros(0)
        self.samples, self.looked, self.came = 0, -np.inf, time.monotonic()
        self.kept: Kept | None = None

    @property
    def is_due(self) -> bool:
        """Whether it is time for another look."""
        return self.belief is not None and self.clock.time - self.looked >= OFTEN

    def warm(self) -> None:
        """Compile the step before the first sample comes."""
        r, m = self.recursion, len(self.measured)
        belief, nothing = r.begin({}, r.prior), np.full(m, np.nan)
        trim = np.array([r.trim.get(name, 0.0) for name in self.controls])
        for seconds in (0.0, 0.01):
            belief = r.step(belief, trim, seconds, trim, nothing)[0]
        for name in self.adviser.trimmed:
            r.shares_of_trim(name, r.prior.mean, r.prior.cov)
        self.check.warm()

    def take(self, piece: Piece) -> list[Look]:
        """Take what has come, and return the looks for which it was time.

        Raises:
            InputError: a stream without what the campaign needs.
        """
        if self.kept is not None:
            self.kept.add_raw(piece.raw)
        found = []
        for arrival in self.channels.of(piece):
            self.add(arrival)
            if self.is_due:
                found.append(self.look())
        if self.kept is not None:
            self.kept.flush()
        return found

    def add(self, arrival: Arrival) -> None:
        """Take one sample."""
        now = time.monotonic()
        passed = self.clock.admit(arrival.stamp, arrival.part, now - self.came)
        self.came = now
        if passed.kind == "dropped":
            return
        values = self.values.admit(arrival.values)
        if self.kept is not None:
            self.kept.add(self.clock.time, values)
        self.control |= {name: values[name] for name in self.controls if name in values}
        if missing := [name for name in self.controls if name not in self.control]:
            self.notes.say("waiting", f"waiting for the first {' and '.join(missing)}")
            return
        self._step(values, passed.step, passed.kind == "begins" or self.belief is None)

    def look(self) -> Look:
        """Judge what is known; to be called once there is a sample."""
        assert self.belief is not None
        found = self.recursion.coefficients(self.belief)
        if np.isfinite(found.chol_cov).all():
            self.coefficients = found
        self.looked = self.clock.time
        doubts = [*map(_left_out, sorted(self.values.left_out)), *self.check.judge()]
        look = self.adviser.look(self.clock.time, self.samples, self.coefficients, self.memory, doubts)
        if self.adviser.failure is not None:
            self.notes.say("library", f"other designs could not be weighed: {self.adviser.failure}")
        if self.kept is not None:
            self.kept.show(look.as_json())
        return look

    def _step(self, values: dict[str, float], step: float, begins: bool) -> None:
        sent = np.array([self.control[name] for name in self.controls])
        if begins:
            self._begin({**self.control, **values})
            self.sent.clear()
            self.check.begin()
        self.check.add(self.clock.time, self.control, values)
        now = self._arriving(sent)
        measured = np.array([values.get(name, np.nan) for name in self.measured])
        held, step = (now, 0.0) if begins else (np.where(self.lined, 0.5 * (self.held + now), self.held), step)
        self.belief, found = self.recursion.step(self.belief, held, step, now, measured)  # pyright: ignore[reportArgumentType]
        self.held = now
        if found.failed:
            self.notes.say(
                "failed",
                "the filter lost its covariance: the states are initialised again; check units and signs, or narrow the priors",
            )
            self.belief = None
            return
        self.samples += 1
        self.memory.add(found.normalised)

    def _begin(self, known: dict[str, float]) -> None:
        """Begin the states anew, with what is known of the coefficients."""
        if self.belief is not None:
            found = self.recursion.coefficients(self.belief)
            if np.isfinite(found.chol_cov).all():
                self.coefficients = found
        self.belief = self.recursion.begin(known, self.coefficients)

    def _arriving(self, sent: np.ndarray) -> np.ndarray:
        """Return the control that arrives at the actuators now, sent a delay ago."""
        if not self.delay:
            return sent
        self.sent.append((self.clock.time, sent))
        while len(self.sent) > 1 and self.sent[1][0] <= self.clock.time - self.delay:
            self.sent.popleft()
        return self.sent[0][1]


def _left_out(name: str) -> str:
    return (
        f"check the unit of {name}: most of its values are far beyond what the campaign foresees, and {name} is left out; "
        "there is no advice until it is right"
    )
