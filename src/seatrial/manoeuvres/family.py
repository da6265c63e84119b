"""A family of open-loop trials: one shape on one control, of which a design chooses amplitude and period."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.core.errors import InputError, nearest
from seatrial.core.programs import program
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.schedule import Schedule
from seatrial.manoeuvres.shapes import SHAPES, Shape


@dataclass(frozen=True)
class Family:
    """What all members share; SI. Check one with `check_family`.

    Attributes:
        control: channel that is driven; others stay at trim.
        trim: its trim value.
        duration: of the trial, s.
        active: time from the start for which the control may differ from trim, s; the quiet tail that follows is informative too.
        sample_time: s.
        start: when the control first leaves trim, s.
        ramp: time every edge takes, from one level to the next, s; 0 for steps.
        kind: shape, a key of `SHAPES`.
        seed: of random levels.
    """

    control: str
    trim: float
    duration: float
    active: float
    sample_time: float
    start: float = 1.0
    ramp: float = 0.0
    kind: str = "repeated-doublet"
    seed: int = 0

    @property
    def shape(self) -> Shape:
        """The shape of the input."""
        return SHAPES[self.kind]

    @property
    def words(self) -> str:
        """Name of the kind in a sentence."""
        return self.kind.replace("-", " ").replace("multistep 3211", "3-2-1-1")

    def time(self) -> Float[np.ndarray, " n"]:
        """Sample times, s."""
        return np.arange(round(self.duration / self.sample_time)) * self.sample_time

    def signal(self, amplitude: Any, period: Any, time: Any) -> Array:
        """Control at the given times; settings and times broadcast."""
        levels = self.shape.draw(self.seed)
        share = _share(self.shape, jnp.asarray(time) - self.start, period, self.active, self.ramp, levels)
        return self.trim + amplitude * share

    def fits(self, period: Float[np.ndarray, "*p"]) -> Bool[np.ndarray, "*p"]:
        """Whether the whole shape fits into the active time, and its edges and samples between its turns."""
        period = np.asarray(period, float)
        turns = self.shape.shortest(period) * (1 + 1e-9)
        within = (period > 0) & (period <= self.shape.longest(self.active) * (1 + 1e-9))
        return within & (turns >= max(self.ramp, self.sample_time))

    def manoeuvre(self, amplitude: float, period: float) -> Manoeuvre:
        """One member.

        Raises:
            InputError: a period that does not fit.
        """
        if not self.fits(np.array(period)):
            raise InputError(f"manoeuvre {self.words}, period", found=f"{period:g} s", **self.expected())
        settings = {
            "trim": self.trim,
            "amplitude": amplitude,
            "period": period,
            "start": self.start,
            "active": self.active,
            "ramp": self.ramp,
            "seed": float(self.seed),
        }

        def signal(time: np.ndarray) -> np.ndarray:
            return np.asarray(self.signal(amplitude, period, time))

        return Manoeuvre(self.words, self.control, self.duration, settings, signal)

    def schedule(self, amplitude: float, period: float, **held: float) -> Schedule:
        """One member as controls over time, SI; all other controls are held at the value given.

        Raises:
            InputError: a period that does not fit.
        """
        time, driven = self.manoeuvre(amplitude, period).sample(self.sample_time)
        others = {name: np.full(time.size, float(value)) for name, value in held.items()}
        return Schedule(time, {self.control: driven, **others})

    def expected(self) -> dict[str, str]:
        """What a period has to be, and how to mend one that is not, for errors."""
        shortest = max(self.ramp, self.sample_time) / float(self.shape.shortest(1.0))
        return {
            "expected": f"a {self.shape.period_is} from {shortest:.4g} s, where its edges take {self.ramp:g} s and samples "
            f"{self.sample_time:g} s, to {self.shape.longest(self.active):.4g} s, so that it fits into {self.active:g} s",
            "remedy": "choose other periods, or change `active` or `ramp`",
        }


def check_family(family: Family) -> Family:
    """Check the settings that all members share, and return the family.

    Raises:
        InputError: naming the setting at fault.
    """
    where = f"manoeuvre {family.kind}"
    if family.kind not in SHAPES:
        raise InputError(where, found="no such shape", expected=", ".join(SHAPES), remedy=nearest(family.kind, SHAPES))
    if not (family.start >= 0 and family.active > 0 and family.start + family.active <= family.duration * (1 + 1e-9)):
        raise InputError(
            where,
            found=f"start {family.start:g} s + active {family.active:g} s",
            expected=f"an end within the duration, {family.duration:g} s",
            remedy="lengthen the duration: the quiet tail after the input is informative too",
        )
    if not family.ramp >= 0:
        raise InputError(
            where, found=f"edges of {family.ramp:g} s", expected="0 s or more", remedy="0 s makes each edge a step"
        )
    return family


@program(static_argnums=0)
def _share(shape: Shape, elapsed: Array, period: Any, active: float, ramp: float, levels: Array) -> Array:
    return shape.share(elapsed, period, active, ramp, levels)
