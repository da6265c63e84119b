"""FMI 2 co-simulation unit: the equations in plain Python, packed with their interpreter's library by pythonfmu.

Whoever runs the unit needs Python with its shared library on the path, as pythonfmu does; nothing of seatrial or NumPy.
Source: FMI 2.0.4; github.com/NTNU-IHB/PythonFMU, version 0.7 (MIT licence).
"""

import io
import re
import sys
import tempfile
import zipfile
from contextlib import AbstractContextManager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from uuid import UUID

from seatrial.core.errors import needing_extra
from seatrial.core.files import write_text
from seatrial.core.signals import CURRENT_COMPONENTS, signal_unit
from seatrial.export.equations import docstring_line, parameters_of, python_module, states_of
from seatrial.export.target import Exporter, Statement
from seatrial.export.vehicle import ExportedVehicle
from seatrial.export.xml_text import identifier

STEP = 0.01  # Longest step of the integration inside the unit, s, unless its parameter `step` says otherwise
_UNDATED = (1980, 1, 1, 0, 0, 0)  # Of each member of the archive: the same vehicle gives the same bytes


@dataclass(frozen=True)
class CoSimulationUnit(Exporter):
    """See the module."""

    name: str = "fmu"
    target: str = "FMI 2.0 co-simulation (pythonfmu 0.7)"
    simulates = "moves"

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        super().check(vehicle)
        with _packing():
            import pythonfmu  # noqa: F401  # pyright: ignore[reportMissingImports]  (refused before anything is computed)

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, bytes]:
        """See `Exporter`."""
        name = identifier(vehicle.name)
        units = {key: signal_unit(key) for key in (*states_of(vehicle), *vehicle.controls, *CURRENT_COMPONENTS)}
        units |= {key: unit for key, (_, unit) in parameters_of(vehicle).items()}
        parts = {
            "UNITS": "{\n" + "".join(f'    "{key}": "{unit}",\n' for key, unit in units.items()) + "}",
            "CLASS": name,
            "TITLE": repr(docstring_line(statement.lines[0])),
            "STEP": repr(STEP),
        }
        text = python_module(_TEMPLATE, vehicle, statement.lines, _NOTES, **parts)
        return {f"{name}.fmu": packed(text, f"fmu_of_{name}")}


def packed(script: str, module: str) -> bytes:
    """Return the unit of a script that defines one slave.

    Args:
        script: text of the module.
        module: its name, which no other module has.

    Raises:
        InputError: pythonfmu is not installed.
    """
    with _packing():
        from pythonfmu.builder import FmuBuilder  # pyright: ignore[reportMissingImports]

    path = list(sys.path)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / f"{module}.py"
        write_text(source, script)
        try:
            made = FmuBuilder.build_FMU(source, dest=folder)
        finally:  # the builder imports the script, and would find this one again under the same name
            sys.path[:] = path
            sys.modules.pop(module, None)
        return _finished(made, UUID(hex=sha256(script.encode()).hexdigest()[:32]))


def _packing() -> AbstractContextManager[None]:
    return needing_extra("export", "export to fmu", "{}, which packs co-simulation units, is not installed")


def _finished(path: Path, guid: UUID) -> bytes:
    """Return the archive in order, without its date, and with an identifier that follows from its content."""
    stream = io.BytesIO()
    with zipfile.ZipFile(path) as made, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as result:
        for name in sorted(made.namelist()):
            content = made.read(name)
            if name == "modelDescription.xml":
                text = re.sub(r'\bguid="[^"]*"', f'guid="{guid}"', content.decode(), count=1)
                text = re.sub(r'\s*generationDateAndTime="[^"]*"', "", text, count=1)
                # FMI 2 has the outputs that are computed at the start once more; pythonfmu has not.
                outputs = r"<Outputs>(.*?)</Outputs>"
                content = re.sub(outputs, r"\g<0><InitialUnknowns>\1</InitialUnknowns>", text, flags=re.DOTALL).encode()
            result.writestr(zipfile.ZipInfo(name, _UNDATED), content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


_NOTES = (
    "inputs: the controls, and current_x, current_y, current_z of the water to the north, east and down; outputs: the states;",
    "parameters: coefficients and numbers by name, u_0, v_0, ... for the initial state, and step, the longest step inside, s.",
    "Actuators that lag begin where their first commands are.",
)
_TEMPLATE = '''"""
@DOC@
"""

from functools import partial
from math import ceil, cos, isfinite, sin, tan

from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real

fmin, fmax = min, max
@SOURCE@

UNITS = @UNITS@
CURRENT = ("current_x", "current_y", "current_z")


class @CLASS@(Fmi2Slave):
    """See the top of the file."""

    author = "seatrial"
    description = @TITLE@

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.values = dict(PARAMETERS)
        self.settings = {"step": @STEP@}
        self.inputs = dict.fromkeys((*CONTROLS, *CURRENT), 0.0)
        self.start = dict.fromkeys(STATES[:12], 0.0)
        self.state = [0.0] * len(STATES)
        fixed, continuous = Fmi2Variability.fixed, Fmi2Variability.continuous
        for name in self.inputs:
            self.declare(name, name, self.inputs, Fmi2Causality.input, continuous)
        for name in self.values:
            self.declare(name, name, self.values, Fmi2Causality.parameter, Fmi2Variability.tunable)
        for name in self.start:
            self.declare(name + "_0", name, self.start, Fmi2Causality.parameter, fixed)
        self.declare("step", "time", self.settings, Fmi2Causality.parameter, fixed)
        for place, name in enumerate(STATES):
            read = partial(self.output, place)
            self.register_variable(
                Real(
                    name,
                    causality=Fmi2Causality.output,
                    variability=continuous,
                    initial=Fmi2Initial.calculated,
                    description=UNITS[name],
                    getter=read,
                )
            )

    def declare(self, name, unit, table, causality, variability):
        """Let a variable be read and set in a table."""
        key = unit if unit in table else name
        self.register_variable(
            Real(
                name,
                causality=causality,
                variability=variability,
                description=UNITS.get(unit, "s"),
                getter=partial(table.get, key),
                setter=partial(table.__setitem__, key),
            )
        )

    def output(self, place):
        """A state; before the first step, its initial value."""
        return self.state[place]

    def enter_initialization_mode(self):
        self.begin()

    def exit_initialization_mode(self):
        self.begin()

    def begin(self):
        """Take the initial state from the parameters."""
        self.state = [*self.start.values(), *followed([self.inputs[name] for name in CONTROLS])]

    def do_step(self, current_time, step_size):
        control = [self.inputs[name] for name in CONTROLS]
        water = [self.inputs[name] for name in CURRENT]
        count = max(1, ceil(step_size / self.settings["step"] - 1e-9))
        for _ in range(count):
            self.state = runge_kutta(self.state, control, list(self.values.values()), step_size / count, water)
        return all(map(isfinite, self.state))
'''
