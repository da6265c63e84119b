"""A trial as the operator runs it: time and control where the control bends, in the units of the trade, as CSV and as JSON."""

from pathlib import Path

import numpy as np

from seatrial.core.display_units import shown_unit
from seatrial.core.files import write_json, write_text
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Manoeuvre

# Designs in words, in the units of the boundary.


def design_words(family: Family, amplitude: float, period: float) -> str:
    """Name one member of a family: `repeated doublet of ±200 rpm about 1194 rpm in n, period 10 s`."""
    factor, unit = shown_unit(family.control)
    return (
        f"{family.words} of {family.shape.sides}{amplitude * factor:.4g} {unit} about {family.trim * factor:.4g} {unit} "
        f"in {family.control}, {family.shape.period_is} {period:.3g} s"
    )


def write_schedule(path: Path, manoeuvre: Manoeuvre, sample_time: float, rule: str = "") -> Path:
    """Write a schedule as CSV and beside it as JSON, where they are missing or not the same; returns the CSV file.

    Between its rows the control is a straight line. A trial that is ended away from trim goes back to it, as fast as its edges are, or
    in one sample. A closed-loop trial has a `rule`, which its schedule only foresees.
    """
    factor, unit = shown_unit(manoeuvre.control)
    time, control = manoeuvre.sample(sample_time)
    bend = np.abs(np.diff(control, n=2)) > 1e-9 * max(1.0, float(np.abs(control).max()))
    corner = np.flatnonzero(np.concatenate([[True], bend, [True]]))
    rows = [(f"{time[i]:.6g}", f"{control[i] * factor:.10g}") for i in corner]
    rows += [(f"{at:.6g}", f"{value * factor:.10g}") for at, value in _way_back(manoeuvre, sample_time, control)]
    text = f"time_s,{manoeuvre.control}_{unit}\n" + "".join(f"{t},{value}\n" for t, value in rows)
    if not path.is_file() or path.read_bytes() != text.encode():
        write_text(path, text)
    content = {
        "manoeuvre": manoeuvre.name,
        "control": manoeuvre.control,
        "unit": unit,
        "settings_si": {name: float(value) for name, value in manoeuvre.parameters.items()},
        **({"rule": rule} if rule else {}),
        "time_s": [float(t) for t, _ in rows],
        "value": [float(value) for _, value in rows],
    }
    write_json(path.with_suffix(".json"), content)
    return path


def _way_back(manoeuvre: Manoeuvre, sample_time: float, control: np.ndarray) -> list[tuple[float, float]]:
    """Rows that hold the last value to the end and lead back to trim; none where the trial ends there."""
    trim, last = manoeuvre.parameters.get("trim"), float(control[-1])
    if trim is None or abs(last - trim) <= 1e-9 * max(1.0, abs(trim)):
        return []
    end, edge = control.size * sample_time, manoeuvre.parameters.get("ramp", 0.0)
    return [(end, last), (end + edge, trim)] if edge > 0 else [(end, trim)]
