"""A vehicle model: named states, controls and coefficients, and the state's time derivative as a pure function."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from seatrial.core.coefficients import CoefficientName
from seatrial.core.result_table import text_html
from seatrial.core.signals import signal_unit

Params = Mapping[str, Any]
"""Value of every free coefficient by name, SI; scalars, or arrays under vmap."""
ROTATIONS = ("K", "M", "N")
"""Axes about which a vehicle turns."""
Derivative = Callable[[Params, tuple[Any, ...], tuple[Any, ...]], tuple[Any, ...]]
View = Callable[[Params, tuple[Any, ...], tuple[Any, ...]], Any]
Follow = Callable[[Params, Any, tuple[Any, ...], Any], Any]
"""`(params, before, control, time) ->` a state that follows a control, known in closed form, some time after it was `before`; s."""


@dataclass(frozen=True)
class Unknown:
    """A number of a vehicle that no coefficient is, and that `derivative` takes from `params`; where it is not there, as stated.

    Attributes:
        name: among the parameters: `gain_f_3`, `lag_n`, `z_b`.
        unit: SI.
        label: LaTeX.
        stated: value where nothing else is said, SI.
        signed: whether it may be below 0.
    """

    name: str
    unit: str
    label: str
    stated: float
    signed: bool = True


@dataclass(frozen=True)
class VehicleModel:
    """Continuous-time dynamics; models of the same equations are equal and hash alike, so compiled functions are shared.

    Attributes:
        name: short name.
        states: names of the states, for example `("u",)`.
        controls: names of the controls, for example `("n",)`.
        coefficients: free coefficients, whose values `derivative` expects in `params`.
        constants: everything else that enters the equations, as (name, value) pairs.
        per_unit_mass: whether forces are divided by an unknown effective mass, and moments by an unknown inertia, so that units lose
            their kilogram.
        derivative: `derivative(params, state, control) -> rate`, on tuples of scalars, SI.
        views: what a sensor may measure besides states and rates, such as Euler angles of a quaternion, by channel.
        pushed: axes on which `derivative` adds a force from outside, where `params` has one under its `outside_force`, in the unit of
            a constant force on that axis.
        unknowns: numbers beside the coefficients that are sought.
        late: how each of the last states follows its control while that is held, in their order: of actuators, of which no integrator is
            to make an error.
    """

    name: str = field(compare=False)
    states: tuple[str, ...]
    controls: tuple[str, ...]
    coefficients: tuple[CoefficientName, ...]
    constants: tuple[tuple[str, float], ...]
    per_unit_mass: bool
    derivative: Derivative = field(compare=False, repr=False)
    views: Mapping[str, View] = field(default_factory=dict, compare=False, repr=False)
    pushed: tuple[str, ...] = ()
    unknowns: tuple[Unknown, ...] = ()
    late: tuple[Follow, ...] = field(default=(), compare=False, repr=False)

    def __repr__(self) -> str:
        """Print what moves, what drives it, and what is open."""
        parts = [
            ("states", [f"{name} [{signal_unit(name)}]" for name in self.states]),
            ("controls", [f"{name} [{signal_unit(name)}]" for name in self.controls]),
            ("free", [f"{one} [{self.unit_of(one)}]" for one in self.coefficients]),
            ("also sought", [f"{one.name} [{one.unit}]" for one in self.unknowns]),
        ]
        return "; ".join([f'Vehicle "{self.name}"', *(f"{word} {', '.join(named)}" for word, named in parts if named)])

    _repr_html_ = text_html

    def unit_of(self, coefficient: CoefficientName) -> str:
        """Return the SI unit of a coefficient in this model."""
        dimension = coefficient.dimension
        if not self.per_unit_mass:
            return str(dimension)
        if coefficient.axis in ROTATIONS:  # kg m^2 of inertia, and the radian of the acceleration that the moment makes
            dimension = dimension._replace(m=dimension.m - 2, rad=dimension.rad + 1)
        return str(dimension._replace(kg=dimension.kg - 1))

    def channel_units(self) -> dict[str, str]:
        """Return the SI unit of everything a sensor may measure: the states and their rates, and other views of them."""
        names = [*self.states, *(state + "dot" for state in self.states), *self.views]
        return {name: signal_unit(name) for name in names}

    def output(self, channel: str, params: Params, state: tuple[Any, ...], control: tuple[Any, ...]) -> Any:
        """Return the value of a channel of `channel_units` at a state, SI.

        Args:
            channel: its name.
            params: value of each free coefficient, SI.
            state: in the order of `states`, SI.
            control: in the order of `controls`, SI.
        """
        if channel in self.states:
            return state[self.states.index(channel)]
        if channel in self.views:
            return self.views[channel](params, state, control)
        return self.derivative(params, state, control)[self.states.index(channel.removesuffix("dot"))]


def outside_force(axis: str) -> str:
    """Return the name among the parameters of a force or moment that no coefficient makes.

    Args:
        axis: X, Y, Z, K, M or N.
    """
    return f"outside_{axis}"
