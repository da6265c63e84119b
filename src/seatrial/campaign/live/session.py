"""A live session: every sample through the gates, into the file and through the filter, and a look at what is known now and then."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from math import isfinite
from typing import Literal, NamedTuple

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.live.advice import Adviser, Look
from seatrial.campaign.live.channels import Arrival, Channels, lined_controls
from seatrial.campaign.live.innovations import InnovationMemory
from seatrial.campaign.live.next_segment import Library
from seatrial.campaign.live.recursion import live_recursion
from seatrial.campaign.live.session_files import Kept
from seatrial.campaign.live.sources import Piece
from seatrial.campaign.live.stream_check import StreamCheck
from seatrial.core.display_units import shown_unit
from seatrial.core.record import MAX_MAGNITUDE
from seatrial.estimation.priors import nominal
from seatrial.numerics.gaussian import Gaussian

LOOK_SECONDS = 1.0  # Seconds of the stream between two looks


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
        library: of segments; None if there is none.

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
        self.delay = nominal(campaign.prior("delay")) if campaign.has_delay else 0.0
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
        return self.belief is not None and self.clock.time - self.looked >= LOOK_SECONDS

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
        looks = []
        for arrival in self.channels.of(piece):
            self.add(arrival)
            if self.is_due:
                looks.append(self.look())
        if self.kept is not None:
            self.kept.flush()
        return looks

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
        coefficients = self.recursion.coefficients(self.belief)
        if np.isfinite(coefficients.chol_cov).all():
            self.coefficients = coefficients
        self.looked = self.clock.time
        doubts = [*map(_left_out, sorted(self.values.left_out)), *self.check.judge()]
        look = self.adviser.look(self.clock.time, self.samples, self.coefficients, self.memory, doubts)
        if self.adviser.failure is not None:
            self.notes.say("library", f"other designs could not be evaluated: {self.adviser.failure}")
        if self.kept is not None:
            self.kept.show(look.as_json())
        return look

    def _step(self, values: dict[str, float], step: float, begins: bool) -> None:
        sent = np.array([self.control[name] for name in self.controls])
        if begins:
            # Begin the states anew, with what is known of the coefficients.
            known = {**self.control, **values}
            if self.belief is not None:
                coefficients = self.recursion.coefficients(self.belief)
                if np.isfinite(coefficients.chol_cov).all():
                    self.coefficients = coefficients
            self.belief = self.recursion.begin(known, self.coefficients)
            self.sent.clear()
            self.check.begin()
        self.check.add(self.clock.time, self.control, values)
        now = self._arriving(sent)
        measured = np.array([values.get(name, np.nan) for name in self.measured])
        held, step = (now, 0.0) if begins else (np.where(self.lined, 0.5 * (self.held + now), self.held), step)
        self.belief, stepped = self.recursion.step(self.belief, held, step, now, measured)  # pyright: ignore[reportArgumentType]
        self.held = now
        if stepped.failed:
            self.notes.say(
                "failed",
                "the filter lost its covariance: the states are initialised again; check units and signs, or narrow the priors",
            )
            self.belief = None
            return
        self.samples += 1
        self.memory.add(stepped.normalised)

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
        f"check the unit of {name}: most of its values are far outside the range of the campaign, and {name} is left out. There is no "
        f"advice before the correction"
    )


# What may pass: stamps in their order, and values that the vehicle can have. What may not is told once, in words.

# Seconds by which a stamp may lie behind the latest and be of one that was overtaken; further back the clock was set
# anew
MAX_LATE_SECONDS = 1.0
BEYOND = 50.0  # Times what the priors foresee, from which a value is none of this vehicle in this unit
BEYOND_LIMIT = 5.0  # Likewise times the limit of a control
RECENT_VALUES = 20  # Values of a channel over which is looked whether most of them can be
# Times what is foreseen, or the limit, below which most must lie before a channel that was left out is taken again
MAX_TIMES_INSIDE = 2.0


class Notes:
    """What is told to the user: each kind once, what happens to the clock every time, and how often each was found."""

    MOST = 20
    """Times that one thing is told."""

    def __init__(self) -> None:
        self.fresh: list[str] = []
        self.counts: dict[str, int] = {}

    def say(self, kind: str, text: str) -> None:
        """Note something."""
        self.counts[kind] = self.counts.get(kind, 0) + 1
        if self.counts[kind] <= (self.MOST if kind in ("gap", "restart") else 1):
            self.fresh.append(text)

    def take(self) -> list[str]:
        """Return what has not been told yet."""
        looks, self.fresh = self.fresh, []
        return looks


class Passed(NamedTuple):
    """What becomes of a stamp.

    Attributes:
        step: s since the sample before; 0 if states begin anew.
        kind: `goes on`, `begins` (the first, or behind a gap or a restart), or `dropped`.
    """

    step: float
    kind: Literal["goes on", "begins", "dropped"]


class ClockGate:
    """Stamps in their order.

    Args:
        gap: s without a sample, beyond which states begin anew.
        say: told what is dropped, and where states begin anew.
    """

    def __init__(self, gap: float, say: Callable[[str, str], None]):
        self.gap, self.say = Decimal(repr(gap)), say
        self.last: Decimal | None = None
        self.parts: set[int] = set()
        self.origin = Decimal(0), 0.0
        self.time = 0.0
        """Seconds since the first sample, strictly increasing whatever the stream's clock does."""

    def admit(self, stamp: Decimal, part: int, elapsed: float) -> Passed:
        """Judge a stamp.

        Args:
            stamp: on the stream's clock, s.
            part: of the stream.
            elapsed: s since the last sample by this machine's clock, which counts where the stream's was set anew.
        """
        if self.last is None:
            return self._pass(stamp, part, 0.0, "begins")
        step = stamp - self.last
        if step == 0 and part in self.parts:
            self.say("repeats", "repeated stamps are dropped")
            return Passed(0.0, "dropped")
        if step < -Decimal(MAX_LATE_SECONDS):
            self.say(
                "restart",
                f"the clock went back by {-step:.6g} s: the states are initialised again, but the coefficients are kept",
            )
            return self._pass(stamp, part, max(elapsed, 1e-3), "begins")
        if step < 0:
            self.say("late", f"samples that come late (by {-step:.3g} s) are dropped")
            return Passed(0.0, "dropped")
        if step > self.gap:
            self.say("gap", f"no data for {step:.4g} s: the states are initialised again")
            return self._pass(stamp, part, float(step), "begins")
        return self._pass(stamp, part, float(step), "goes on")

    def _pass(self, stamp: Decimal, part: int, step: float, kind: Literal["goes on", "begins"]) -> Passed:
        if self.last is None or stamp < self.last:
            self.origin = stamp, self.time + step
        self.parts = {*self.parts, part} if stamp == self.last else {part}
        self.last = stamp
        self.time = self.origin[1] + float(stamp - self.origin[0])
        return Passed(step, kind)


class ValueGate:
    """Values that a vehicle can have.

    Args:
        sizes: largest magnitude that is foreseen of a channel, SI; of others only what a record cannot hold is left out.
        limits: of a control, SI.
        say: told what is left out.
    """

    def __init__(self, sizes: Mapping[str, float], limits: Mapping[str, float], say: Callable[[str, str], None]):
        self.most = {name: BEYOND * size for name, size in sizes.items()}
        self.most |= {name: BEYOND_LIMIT * limit for name, limit in limits.items()}
        self.sizes, self.limits, self.say = sizes, limits, say
        self.recent: dict[str, deque[float]] = {}
        self.left_out: set[str] = set()
        """Channels of which no value is taken, since most of the latest cannot be: the others are in the same wrong unit."""

    def admit(self, values: dict[str, float]) -> dict[str, float]:
        """Return the values that can be."""
        finite = {name: value for name, value in values.items() if isfinite(value)}
        can_be = {name: value for name, value in finite.items() if not self._is_beyond(name, value)}
        for name in finite:
            self._judge(name, abs(finite[name]))
        return {name: value for name, value in can_be.items() if name not in self.left_out}

    def _judge(self, name: str, size: float) -> None:
        recent = self.recent.setdefault(name, deque(maxlen=RECENT_VALUES))
        recent.append(size)
        usual = {**self.sizes, **self.limits}.get(name, MAX_MAGNITUDE)
        least = MAX_TIMES_INSIDE * usual if name in self.left_out else self.most.get(name, MAX_MAGNITUDE)
        if 2 * sum(one >= least for one in recent) > len(recent):
            self.left_out.add(name)
        else:
            self.left_out.discard(name)

    def _is_beyond(self, name: str, value: float) -> bool:
        most = self.most.get(name, MAX_MAGNITUDE)
        if abs(value) < most:
            return False
        factor, unit = shown_unit(name)
        known = f"no vehicle has {most * factor:.3g} {unit}"
        if name in self.limits:
            known = f"its limit is {most / BEYOND_LIMIT * factor:.3g} {unit}"
        elif name in self.sizes:
            known = f"the priors allow {most / BEYOND * factor:.3g} {unit} at most"
        self.say(
            f"beyond {name}",
            f"{name} of {value * factor:.3g} {unit}, where {known}: check the unit of its column; such values are left out",
        )
        return True
