"""How a sensor shows the motion: with a lag and a bias, over ground or through the water, and with noise of one kind or another.

A lag is of first order, tau dy/dt = x - y. Across a step h over which x is a straight line its solution is

    y' = a y + b x + c x',  a = exp(-r), g = (1 - a) / r, b = g - a, c = 1 - g,  r = h / tau
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.core.argument_checks import check_choice, check_kind, check_text
from seatrial.core.errors import InputError
from seatrial.core.signals import ANGLES, POSITIONS, QUATERNION
from seatrial.estimation.simulation.mounts import LATE, Mount

# Independent and normal; an Ornstein-Uhlenbeck process; independent with the tails of Student's t; the first two added; independent and
# normal with a part in proportion to the signal, as "0.2 % ± 1 mm/s" of a Doppler log.
Noise = Literal["white", "coloured", "heavy", "drifting", "proportional"]
# Channels whose zero is a matter of choice: nothing is in proportion to them.
_WITHOUT_ZERO = (*ANGLES, *QUATERNION, *POSITIONS[:2])


@dataclass(frozen=True)
class Sensor:
    """One measured channel; its unknown properties are parameters.

    Attributes:
        channel: the measured state or rate.
        noise: kind of the residuals: `sigma_u`, and `tau_u` where coloured, `dof_u` where heavy-tailed, `drift_u` and
            `drift_time_u` where an error that drifts lies under white noise, `share_u` where a part of the standard deviation
            is proportional to the signal, sqrt(sigma_u^2 + (share_u u)^2).
        bias: whether it has a constant error, `bias_u`.
        lag: whether it has a lag, with the time constant `lag_u`, s.
        over_ground: whether a velocity is measured over ground, and not through the water.
        mount: its place, turn and scale; None for one at the body's origin, along its axes.

    Raises:
        InputError: no name, a kind of noise that there is not or that its channel cannot have, or something else than True and False.
    """

    channel: str
    noise: Noise = "white"
    bias: bool = False
    lag: bool = False
    over_ground: bool = True
    mount: Mount | None = None

    def __post_init__(self) -> None:
        """Refuse what no sensor is."""
        check_text(self.channel, "Sensor, channel", 'name the measured signal, for example "u"')
        check_choice(self.noise, get_args(Noise), "Sensor, noise")
        if self.noise == "proportional" and self.channel in _WITHOUT_ZERO:
            raise InputError(
                f"Sensor, noise of {self.channel}",
                found='"proportional", of an angle or a position',
                expected="a channel with a natural zero, such as a velocity or a depth",
                remedy=f"give {self.channel} another kind, for example white; in a campaign, write "
                'residuals = "white" in its [sensors] table',
            )
        for name in ("bias", "lag", "over_ground"):
            remedy = "give True or False; its size is a separate value or prior"
            check_kind(getattr(self, name), bool, f"Sensor, {name}", remedy)

    @property
    def noise_parameters(self) -> tuple[str, ...]:
        """Names of the parameters of its noise."""
        own = (name for name, kind in noise_kinds(self.channel).items() if kind == self.noise)
        return noise_name(self.channel), *own

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its parameters, in the order of the report."""
        bias, lag = (bias_name(self.channel),) * self.bias, (lag_name(self.channel),) * self.lag
        return (*self.noise_parameters, *bias, *lag)

    @property
    def is_late(self) -> bool:
        """Whether it shows the motion of some time before."""
        return self.mount is not None and self.mount.is_late

    def samples_late(self, values: Mapping[str, Any], step: Any) -> Any:
        """Return by how many samples, for even steps of so many seconds."""
        assert self.mount is not None
        return values.get(f"{LATE}_{self.mount.name}", self.mount.late) / step

    def show(self, values: Mapping[str, Any], x: Any, memory: "LagMemory | None", lag: "Lag | None") -> tuple:
        """Return what it shows without noise where the channel is `x`, and what it remembers."""
        if memory is not None and lag is not None:
            y = lag.a * memory.shown + lag.b * memory.true + lag.c * x
            memory, x = LagMemory(y, x), y
        return (x + values[bias_name(self.channel)] if self.bias else x), memory


class LagMemory(NamedTuple):
    """What a sensor with a lag showed at the last sample, and what was true."""

    shown: Any
    true: Any


class Lag(NamedTuple):
    """Coefficients of a lag; over all samples, or at one."""

    a: Any
    b: Any
    c: Any


def lags_before(step: Float[Array, " n"], tau: Any) -> Lag:
    """Return the coefficients for the step that leads to each sample; at the first the sensor has settled."""
    r = step[:-1] / tau
    small = r < 1e-4
    safe = jnp.where(small, 1.0, r)
    a = jnp.exp(-r)
    g = jnp.where(small, 1.0 - 0.5 * r + r * r / 6.0, -jnp.expm1(-safe) / safe)
    return Lag(
        *(jnp.concatenate([jnp.full(1, first), rest]) for first, rest in ((0.0, a), (0.0, g - a), (1.0, 1.0 - g)))
    )


def noise_name(channel: str) -> str:
    """Return the parameter name of a channel's noise standard deviation; where heavy-tailed, of the scale of Student's t."""
    return f"sigma_{channel}"


def correlation_name(channel: str) -> str:
    """Return the parameter name of the correlation time of a channel's residuals, s."""
    return f"tau_{channel}"


def dof_name(channel: str) -> str:
    """Return the parameter name of the degrees of freedom of a channel's heavy-tailed residuals."""
    return f"dof_{channel}"


def drift_name(channel: str) -> str:
    """Return the parameter name of the standard deviation of the slow error under a channel's white noise."""
    return f"drift_{channel}"


def drift_time_name(channel: str) -> str:
    """Return the parameter name of the correlation time of that slow error, s."""
    return f"drift_time_{channel}"


def share_name(channel: str) -> str:
    """Return the parameter name of the part of a channel's noise in proportion to its signal, over that signal."""
    return f"share_{channel}"


def noise_kinds(channel: str) -> dict[str, Noise]:
    """Return the kind of noise by the names of the parameters that it has for a channel beside its size."""
    return {
        correlation_name(channel): "coloured",
        dof_name(channel): "heavy",
        drift_name(channel): "drifting",
        drift_time_name(channel): "drifting",
        share_name(channel): "proportional",
    }


def bias_name(channel: str) -> str:
    """Return the parameter name of a channel's constant error."""
    return f"bias_{channel}"


def lag_name(channel: str) -> str:
    """Return the parameter name of the time constant of a channel's sensor, s."""
    return f"lag_{channel}"
