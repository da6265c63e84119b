"""What a manoeuvre is: a named open-loop input in time, sampled where needed and checked against limits."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_number, check_order
from seatrial.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Manoeuvre:
    """An open-loop trial: `signal(t)` gives the control, SI, at times t in [0, duration].

    Attributes:
        name: family and main settings, for tables.
        control: control channel it drives.
        duration: s.
        parameters: its settings, SI.
        signal: vectorised over time.
        others: signals of other controls that move with it, by name.
    """

    name: str
    control: str
    duration: float
    parameters: Mapping[str, float]
    signal: Callable[[np.ndarray], np.ndarray]
    others: Mapping[str, Callable[[np.ndarray], np.ndarray]] = field(default_factory=dict)

    def sample(self, sample_time: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return the times 0, h, 2h, … below the duration, s, and the control at each, SI."""
        time = np.arange(round(self.duration / sample_time)) * sample_time
        return time, np.asarray(self.signal(time))


@dataclass(frozen=True)
class Limits:
    """Bounds of a control channel; None for no bound.

    Attributes:
        lower: least value, SI.
        upper: greatest value, SI.
        rate: greatest speed of change, SI units a second.

    Raises:
        InputError: a bound that is no finite number, a lower one that is not below the upper one, or a rate that is not positive.
    """

    lower: float | None = None
    upper: float | None = None
    rate: float | None = None

    def __post_init__(self) -> None:
        """Refuse bounds that leave nothing between them."""
        for name, least in (("lower", -inf), ("upper", -inf), ("rate", 0.0)):
            if (bound := getattr(self, name)) is not None:
                check_number(bound, f"Limits, {name}", above=least, remedy="give its SI value, or None for no bound")
        if self.lower is not None and self.upper is not None:
            check_order(self.lower, self.upper, "Limits")

    def excess(self, control: np.ndarray, sample_time: float) -> dict[str, tuple[float, float]]:
        """Return the broken bounds: name to (largest value found, bound). Empty if all are kept.

        Args:
            control: sampled control, SI, time along the last axis.
            sample_time: s.
        """
        broken = {}
        if not np.isfinite(control).all():
            broken["finite"] = (float(control[~np.isfinite(control)][0]), inf)
        if self.upper is not None and (top := float(control.max())) > self.upper + 1e-12 * abs(self.upper):
            broken["upper"] = (top, self.upper)
        if self.lower is not None and (bottom := float(control.min())) < self.lower - 1e-12 * abs(self.lower):
            broken["lower"] = (bottom, self.lower)
        if self.rate is not None:
            fastest = float(np.abs(np.diff(control)).max() / sample_time)
            if fastest > self.rate * (1 + 1e-9):
                broken["rate"] = (fastest, self.rate)
        return broken


def check_limits(manoeuvre: Manoeuvre, limits: Limits, sample_time: float) -> None:
    """Check one manoeuvre against its channel's limits.

    Args:
        manoeuvre: with its control.
        limits: of this control.
        sample_time: at which it is looked at, s.

    Raises:
        InputError: naming each limit broken, with the value reached.
    """
    _, control = manoeuvre.sample(sample_time)
    broken = limits.excess(control, sample_time)
    if broken:
        excess = "; ".join(
            f"{name} limit: reaches {value:.6g}, limit {bound:.6g}" for name, (value, bound) in broken.items()
        )
        raise InputError(
            f"manoeuvre {manoeuvre.name}, control {manoeuvre.control}",
            found=excess + " (SI)",
            expected="a control inside its limits at every sample",
            remedy="lower the amplitude, lengthen the ramp of the edges, or widen the limits if the vehicle allows it",
        )
