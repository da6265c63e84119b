"""A vehicle model: named states, controls and coefficients, and the state's time derivative as a pure function."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import lru_cache, wraps
from threading import RLock
from typing import Any, ParamSpec

from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.errors import InputError
from seatrial.core.result_table import text_html
from seatrial.core.signals import declare_signal, signal_unit
from seatrial.core.units import to_si

Params = Mapping[str, Any]  # Value of every free coefficient by name, SI; scalars, or arrays under vmap
ROTATIONS = ("K", "M", "N")  # Axes about which a vehicle turns
Derivative = Callable[[Params, tuple[Any, ...], tuple[Any, ...]], tuple[Any, ...]]
View = Callable[[Params, tuple[Any, ...], tuple[Any, ...]], Any]
# `(params, before, control, time) ->` a state that follows a control, known in closed form, some time after it was
# `before`; s.
Follow = Callable[[Params, Any, tuple[Any, ...], Any], Any]


@dataclass(frozen=True)
class VehicleUnknown:
    """A number of a vehicle that no coefficient is, and that `derivative` takes from `params`; if it is not there, as stated.

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
    """Continuous-time dynamics and key of compiled code: models are equal if their functions are the same objects.

    Builders of models are a `cached_model`, so that equal parts give equal models, which share compiled code.

    Attributes:
        name: short name.
        states: names of the states, for example `("u",)`.
        controls: names of the controls, for example `("n",)`.
        coefficients: free ones, with values in `params` of `derivative`.
        constants: all other numbers of the equations, as (name, value) pairs.
        per_unit_mass: whether forces are divided by an unknown effective mass, and moments by an unknown inertia, so that units lose
            their kilogram.
        derivative: `derivative(params, state, control) -> rate`, on tuples of scalars, SI.
        outputs: further quantities for sensors, such as Euler angles of a quaternion, by channel.
        disturbance_axes: axes on which `derivative` adds a force from outside, where `params` has one under its `outside_force`, in
            the unit of a constant force on that axis.
        unknowns: estimated numbers other than the coefficients.
        exact_lags: how each of the last states follows its control while that is held, in their order: of actuators, of which no
            integrator is to make an error.
    """

    name: str = field(compare=False)
    states: tuple[str, ...]
    controls: tuple[str, ...]
    coefficients: tuple[CoefficientName, ...]
    constants: tuple[tuple[str, float], ...]
    per_unit_mass: bool
    derivative: Derivative = field(repr=False)
    outputs: Mapping[str, View] = field(default_factory=dict, hash=False, repr=False)
    disturbance_axes: tuple[str, ...] = ()
    unknowns: tuple[VehicleUnknown, ...] = ()
    exact_lags: tuple[Follow, ...] = field(default=(), repr=False)

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
        """Return the SI unit of everything a sensor may measure: the states and their rates, and other outputs."""
        names = [*self.states, *(state + "dot" for state in self.states), *self.outputs]
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
        if channel in self.outputs:
            return self.outputs[channel](params, state, control)
        return self.derivative(params, state, control)[self.states.index(channel.removesuffix("dot"))]


def make_model(
    name: str,
    derivative: Derivative,
    states: Mapping[str, str],
    controls: Mapping[str, str],
    coefficients: Mapping[str, str],
) -> VehicleModel:
    """Make a model of your equation of motion.

    Args:
        name: short name.
        derivative: `derivative(params, state, control)` returns the rate of each state in SI, as a tuple. `params` has a number for each
            coefficient by name; `state` and `control` are tuples in the orders below. Write it with `jax.numpy`. Programs are compiled
            for each function object: define it once.
        states: SI unit of each state by name. Names that seatrial has (`u`, `r`, `z`) have its units; others are your own.
        controls: SI unit of each control by name, likewise.
        coefficients: SI unit of each coefficient by name; a name of the grammar (`X_u`) has its unit.

    Raises:
        InputError: a unit that is unknown, not of SI or not that of its name; an equation that takes something else from `params`, or
            returns another number of rates than there are states.
    """
    for signal, unit in (*states.items(), *controls.items()):
        declare_signal(signal, unit)
    names = tuple(
        CoefficientName.parse(text) if is_coefficient(text) else CoefficientName.own(text, unit)
        for text, unit in coefficients.items()
    )
    for term, unit in zip(names, coefficients.values(), strict=True):
        to_si(1.0, unit, term.unit, f'coefficient "{term}", unit')
    import jax

    where = f'model "{name}", derivative'
    try:  # traced, because an equation may divide by what is 0 at any values tried here
        rates = jax.eval_shape(
            derivative, dict.fromkeys(coefficients, 1.0), (1.0,) * len(states), (1.0,) * len(controls)
        )
    except KeyError as missing:
        raise InputError(
            where,
            found=f"params[{missing}], which is no coefficient",
            expected=f"one of {', '.join(coefficients) or 'none'}",
            remedy="add it to `coefficients`, with its unit",
        ) from missing
    if not isinstance(rates, tuple) or len(rates) != len(states):
        raise InputError(
            where,
            found=f"{len(rates)} rates" if isinstance(rates, tuple) else type(rates).__name__,
            expected=f"a tuple of {len(states)} rates, one for each of {', '.join(states)}",
            remedy="return them in the order of `states`",
        )
    return VehicleModel(name, tuple(states), tuple(controls), names, (), False, derivative)


Parts = ParamSpec("Parts")
MAX_MODELS = 1024  # Models that a builder remembers: more structures than a selection compiles, some 30 kB each


def cached_model(build: Callable[Parts, VehicleModel]) -> Callable[Parts, VehicleModel]:
    """Decorate what builds a model: equal arguments give the same model, and thus the same functions.

    Arguments are compared by their content, in its order, and functions among them by identity. A `CoefficientName` counts with its text,
    by which a derivative asks for its value. What the model's functions read later must be a copy: the caller may change a mapping.
    """
    lock = RLock()

    @lru_cache(maxsize=MAX_MODELS)
    def build_once(call: _Call) -> VehicleModel:
        return build(*call.args, **call.options)

    @wraps(build)
    def built(*args: Parts.args, **options: Parts.kwargs) -> VehicleModel:
        with lock:  # or two threads at once would each have functions of their own
            return build_once(_Call(_content((args, options)), args, options))

    return built


@dataclass(frozen=True)
class _Call:
    """Arguments, compared by their content alone."""

    content: Any
    args: tuple[Any, ...] = field(compare=False)
    options: Mapping[str, Any] = field(compare=False)


def _content(value: Any) -> Any:
    """Return what a value is made of, in a form that can be hashed."""
    if isinstance(value, CoefficientName):
        return value.text  # of which the rest follows
    if hasattr(value, "tolist"):  # an array or a number of NumPy or JAX
        value = value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), *(_content(getattr(value, one.name)) for one in fields(value))
    if isinstance(value, Mapping):
        return tuple((name, _content(part)) for name, part in value.items())
    return tuple(map(_content, value)) if isinstance(value, tuple | list) else value


def outside_force(axis: str) -> str:
    """Return the name among the parameters of a force or moment that no coefficient makes.

    Args:
        axis: X, Y, Z, K, M or N.
    """
    return f"outside_{axis}"
