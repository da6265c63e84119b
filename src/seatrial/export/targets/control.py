"""Linear models about steady motion ahead, for python-control and, as a MAT-file, for MATLAB: the mean and an ensemble of draws.

Each trim has its poles, time constants and gains with ±, Bode plots with the band of the draws, and Nomoto's K and T of a rudder.
"""

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_number, check_sequence
from seatrial.core.signals import signal_unit
from seatrial.export import linear
from seatrial.export.ensemble import DRAWS, OF_ONE_MODEL, Ensemble, ensemble_of
from seatrial.export.motion import motion_of
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.terms import actuator_losses
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance
from seatrial.export.xml_text import text
from seatrial.vehicles.actuators import Actuator

_DRAWN = ("surge", "yaw")  # Subsystems with a Bode plot
_HOLDS = "none of first order about each trim below; away from it linear models lack all terms of higher order"
_VERDICTS = {"": "", "published": " (by published values only)", "undetermined": " (not determined by the data)"}
_DECADES, _POINTS = (-1.5, 1.5), 40  # Of a Bode plot about its fastest and slowest pole
# Points of a Bode plot about a natural frequency, in units of its half width.
FEW_DRAWS = 50  # Fewer do not give a ± to a tenth of itself
_NEAR = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)


@dataclass(frozen=True)
class Control(Exporter):
    """See the module.

    Attributes:
        speeds: ahead, m/s; those of `usual_speeds` if none is named.
        count: number of draws, each with its models.
        seed: of the draws.
    """

    name: str = "control"
    target: str = "linear models for python-control 0.10 and MATLAB (MAT-file 5)"
    speeds: tuple[float, ...] = ()
    count: int = DRAWS
    seed: int = 0
    takes_unknown_mass: ClassVar[bool] = True
    sometimes: ClassVar[tuple[str, ...]] = tuple(f"bode_{name}.svg" for name in _DRAWN)

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        super().check(vehicle)
        for speed in check_sequence(self.speeds, "export to control, speeds", "give speeds such as (1.0, 1.5), m/s"):
            check_number(speed, "export to control, speeds", least=0.0, remedy="give speeds ahead in m/s")

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`: the motion itself, of which the files have the slopes."""
        dead = [f"{name}, the dead zone: add it to the commands" for name in vehicle.thrust_law if name[:5] == "dead_"]
        lags = {name: Actuator(one.time_constant) for name, one in vehicle.actuators.items()}
        return Carried(motion_of(vehicle), (*dead, *actuator_losses(vehicle, lags)), actuators=lags, holds=_HOLDS)

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str | bytes]:
        """See `Exporter`."""
        models = self._models(vehicle)[1]
        head = "".join(f"# {line}\n" for whole in statement.lines for line in whole.splitlines() or [""])
        parts = linear.parts_of(vehicle, models[0])
        states = {part.name: list(part.states) for part in parts}
        drives = {part.name: [part.input, part.direction.tolist()] for part in parts}
        module = head + _MODULE.replace("@PARTS@", json.dumps(states)).replace("@DRIVES@", json.dumps(drives))
        files: dict[str, str | bytes] = {
            "linear_models.py": module,
            "linear_models.mat": _mat_file(models, "\n".join(statement.lines), self.target),
        }
        trim = vehicle.hull.trim.get("u", models[0].speed)
        nearest = min(models, key=lambda one: abs(one.speed - trim))
        for part in linear.parts_of(vehicle, nearest):
            if part.name in _DRAWN and part.b[0].any():
                drawn = _bode(nearest, part)
                inside = drawn.index(">", drawn.index("<svg")) + 1
                about = f"<desc>{text(chr(10).join(statement.lines))}</desc>"
                files[f"bode_{part.name}.svg"] = drawn[:inside] + about + drawn[inside:]
        return files

    def _models(self, vehicle: ExportedVehicle) -> tuple[Ensemble | None, list[linear.LinearModel]]:
        ensemble = ensemble_of(vehicle, self.count, self.seed) if vehicle.estimated.names else None
        return ensemble, linear.linearise(vehicle, tuple(self.speeds) or linear.usual_speeds(vehicle), ensemble)

    def notes(self, vehicle: ExportedVehicle, provenance: ExportProvenance) -> list[str]:
        """Return trim, poles, time constants and gains of each speed, and what their ± is."""
        ensemble, models = self._models(vehicle)
        size = 0 if ensemble is None else len(ensemble.values)
        lines = [
            f"linear models, with ± as half the width of the central 68 % of {size} draws of the estimated coefficients"
            if size
            else "linear models without ±: all values are published"
        ]
        if vehicle.estimated.quoted == "averaged":
            lines.append(f"caution: {OF_ONE_MODEL}; compare --structure with the labels of others")
        if 0 < size < FEW_DRAWS:
            lines.append(f"caution: a ± of {size} draws is itself uncertain by {100 / np.sqrt(2 * (size - 1)):.0f} %")
        if size and provenance.speeds is None:
            lines.append("caution: the speeds of the fitted records are not known, because u was not measured")
        for model in models:
            lines.append(f"at {model.speed:g} m/s, {_trim_words(vehicle, model)}:")
            lines += _beyond_records(model.speed, provenance.speeds)
            for part in linear.parts_of(vehicle, model):
                lines += [f"  {part.name}: {_words(known)}" for known in linear.numbers_of(part, size)]
        return lines


def _beyond_records(speed: float, fitted: tuple[float, float] | None) -> list[str]:
    """Return a caution about a speed that the fitted records lack; none if their speeds are not known."""
    if fitted is None or fitted[0] <= speed <= fitted[1]:
        return []
    return [
        f"caution: {speed:g} m/s lies outside the speeds of the fitted records, {fitted[0]:.2g} to {fitted[1]:.2g} m/s"
    ]


def _words(known: linear.Known) -> str:
    words = f"{known.name} {known.value.real:.4g}" + (f" ± {known.sd:.2g}" if known.sd else "") + f" {known.unit}"
    words += f", oscillating at {known.value.imag:.3g} rad/s" if known.value.imag else ""
    return words + _VERDICTS[known.verdict]


def _trim_words(vehicle: ExportedVehicle, model: linear.LinearModel) -> str:
    """Return the trim in words: what is not zero, what is beyond a limit, and draws without one."""
    rows = [
        (name, value)
        for name, value in zip(model.states, model.state[0], strict=True)
        if not name.endswith("_act") and name != "u"
    ]
    rows += list(zip(model.inputs, model.control[0], strict=True))
    words = [f"{name} = {value:.4g} {linear.input_unit(name)}" for name, value in rows if abs(value) > 1e-9]
    limits = [vehicle.actuators.get(name, Actuator(0.0)) for name in model.inputs]
    rows = zip(model.inputs, limits, model.control[0], strict=True)
    beyond = [name for name, limit, value in rows if not limit.lower <= value <= limit.upper]
    words += [f"beyond the limits of {' '.join(beyond)}"] if beyond else []
    if model.balance:
        words.append(f"held by a constant surge acceleration of {model.balance:.3g} m/s^2, since no control holds it")
    missing = int(np.isnan(model.a[1:, 0, 0]).sum())
    words += [f"{missing} draws have no trim there and are NaN"] if missing else []
    return ", ".join(words) or "all other signals zero"


def _mat_file(models: list[linear.LinearModel], about: str, title: str) -> bytes:
    """Return a MAT-file whose arrays end in the speeds, and those of the ensemble in draws and speeds."""
    from scipy.io import savemat

    first = models[0]
    attributes = {"A": "a", "B": "b", "trim_states": "state", "trim_inputs": "control"}
    arrays = {
        key: np.moveaxis(np.stack([getattr(model, one) for model in models], 1), (0, 1), (-2, -1))
        for key, one in attributes.items()
    }
    content: Mapping[str, object] = {
        "about": about,
        "states": np.array(first.states, object),
        "inputs": np.array(first.inputs, object),
        "outputs": np.array(first.outputs, object),
        "state_units": np.array([signal_unit(name.removesuffix("_act")) for name in first.states], object),
        "input_units": np.array([signal_unit(name) for name in first.inputs], object),
        "speeds": np.array([model.speed for model in models]),
        "C": np.eye(len(first.states))[: len(first.outputs)],
        "D": np.zeros((len(first.outputs), len(first.inputs))),
        **{key: array[..., 0, :] for key, array in arrays.items()},
        **{f"ensemble_{key}": array[..., 1:, :] for key, array in arrays.items()},
    }
    stream = io.BytesIO()
    savemat(stream, content, oned_as="column")
    # The first 116 bytes are a text, which SciPy fills with the time and the system.
    return f"MATLAB 5.0 MAT-file, {title}".encode()[:116].ljust(116) + stream.getvalue()[116:]


def _bode(model: linear.LinearModel, part: linear.Part) -> str:
    from seatrial.report.drawing import draw_svg
    from seatrial.report.figures.bode import bode_figure
    from seatrial.report.figures.style import own_settings

    unit = f"{signal_unit(part.output)} / {linear.input_unit(part.input)}"
    with own_settings():
        title = f"{part.output} by {part.input} at {model.speed:g} m/s"
        frequency = bode_frequencies(model, part)
        return draw_svg(bode_figure(frequency, linear.responses(model, part, frequency), title, unit), part.name)


def bode_frequencies(model: linear.LinearModel, part: linear.Part) -> Float[np.ndarray, " f"]:
    """Return the frequencies of a Bode plot, rad/s: even by their logarithm about the poles of a part, and close at each resonance."""
    sizes = np.abs(np.linalg.eigvals(part.a[0]))
    sizes = sizes[sizes > 1e-6] if (sizes > 1e-6).any() else np.ones(1)
    low, high = np.log10([sizes.min(), sizes.max()]) + _DECADES
    poles = np.linalg.eigvals(model.a[0])
    # Without damping there is no finite peak.
    poles = poles[(poles.imag > 0) & (np.abs(poles.real) > 1e-6 * np.abs(poles))]
    peaks = np.abs(poles) + np.outer(_NEAR, poles.real)
    peaks = peaks[(peaks > 10.0**low) & (peaks < 10.0**high)]
    return np.unique(np.concatenate([np.logspace(low, high, _POINTS), peaks]))


_MODULE = '''"""Linear models of a vehicle about steady motion ahead, for python-control; the numbers are in linear_models.mat.

model(speed) is that of the mean, model(speed, draw=3) one of the ensemble, model(speed, part="yaw") a subsystem
without the lags of the actuators. Inputs, states and outputs are differences from the trim, in SI and radians.
"""

from pathlib import Path

import control
import numpy as np
from scipy.io import loadmat

DATA = loadmat(Path(__file__).with_name("linear_models.mat"), simplify_cells=True)
STATES, INPUTS, OUTPUTS = ([str(x).strip() for x in np.atleast_1d(DATA[key])] for key in ("states", "inputs", "outputs"))
SPEEDS = np.atleast_1d(DATA["speeds"])
DRAWS = np.size(DATA["ensemble_A"]) // (len(STATES) ** 2 * len(SPEEDS))
# States of each subsystem; its input, and the direction of the controls that this input is.
PARTS = @PARTS@
DRIVES = @DRIVES@


def model(speed, draw=None, part=None):
    """Return a control.StateSpace: the mean or a draw, the whole vehicle or a subsystem, at one of SPEEDS, m/s."""
    k, d, c = int(np.argmin(np.abs(SPEEDS - speed))), len(STATES), len(INPUTS)
    if abs(SPEEDS[k] - speed) > 1e-3:
        raise ValueError(f"no model at {speed} m/s: there are models at {', '.join(f'{one:g}' for one in SPEEDS)} m/s")
    if part is not None and part not in PARTS:
        raise ValueError(f"no subsystem {part!r}: the vehicle has {', '.join(PARTS)}")
    if draw is None:
        a, b = (np.reshape(DATA[key], (d, n, len(SPEEDS)))[:, :, k] for key, n in (("A", d), ("B", c)))
    elif not 0 <= draw < DRAWS:
        raise ValueError(f"no draw {draw}: there are {DRAWS}")
    else:
        shapes = (("A", (d, d, DRAWS, -1)), ("B", (d, c, DRAWS, -1)))
        a, b = (np.reshape(DATA[f"ensemble_{key}"], shape)[:, :, draw, k] for key, shape in shapes)
    outputs = np.eye(d)[: len(OUTPUTS)]
    if part is None:
        return control.ss(a, b, outputs, np.zeros((len(OUTPUTS), c)), states=STATES, inputs=INPUTS, outputs=OUTPUTS)
    at = [STATES.index(name) for name in PARTS[part]]
    name, direction = DRIVES[part]
    direct = b.copy()
    for i, state in enumerate(STATES):
        if state.endswith("_act"):
            direct[:, INPUTS.index(state[:-4])] = a[:, i]
    return control.ss(
        a[np.ix_(at, at)], (direct @ direction)[at, None], np.eye(len(at)), 0,
        states=PARTS[part], inputs=[name or "none"], outputs=PARTS[part],
    )


def ensemble(speed, part=None):
    """Return the models of all draws at one of SPEEDS."""
    return [model(speed, draw, part) for draw in range(DRAWS)]
'''
