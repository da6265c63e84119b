"""A law of thrust with a voltage against the maker's table of the T200, at six voltages; skipped if the table is not there.

Blue Robotics, T200 public performance data 10-20V, September 2019: 201 pulse widths from 1100 to 1900 us at each voltage, thrust in kgf.
"""

import os
import zipfile
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.optimize import least_squares

from seatrial.vehicles.thrusters import ThrustLaw, VoltageEffect

TABLE = Path(
    os.environ.get("SEATRIAL_DATA", "shared/data"), "t200/T200-Public-Performance-Data-10-20V-September-2019.xlsx"
)
VOLTS, STATED = np.array([10.0, 12.0, 14.0, 16.0, 18.0, 20.0]), 16.0
TAG = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
pytestmark = pytest.mark.skipif(not TABLE.is_file(), reason=f"no table of the T200 in {TABLE.parent}")


@pytest.fixture(scope="module")
def table():
    """Pulse widths, us, and thrust, N, shape (6, 201): the sheets after the first, columns A and F."""
    with zipfile.ZipFile(TABLE) as archive:
        sheets = [ElementTree.fromstring(archive.read(f"xl/worksheets/sheet{k}.xml")) for k in range(2, 8)]
    columns = []
    for sheet in sheets:
        cells = {cell.get("r"): cell.find(f"{TAG}v") for cell in sheet.iter(f"{TAG}c")}
        columns.append([[float(cells[f"{column}{row}"].text) for row in range(2, 203)] for column in "AF"])
    columns = np.array(columns)
    assert (columns[:, 0] == columns[0, 0]).all()
    return columns[0, 0], 9.80665 * columns[:, 1]


def dead_zone(command, thrust):
    return float(command[thrust == 0].min()), float(command[thrust == 0].max())


def test_the_dead_zone_shrinks_with_the_voltage(table):
    """1460 to 1540 us at 10 V, 1476 to 1528 us at 20 V; an end that moves as 1 / V is right to one point of the table, 4 us."""
    command, thrust = table
    ends = np.array([dead_zone(command, one) for one in thrust])
    assert ends[[0, -1]].tolist() == [[1460.0, 1540.0], [1476.0, 1528.0]]
    law = 28.0 + 20.0 * (STATED / VOLTS - 1.0)
    assert np.abs(ends - 1500.0 - np.outer(law, [-1.0, 1.0])).max() <= 4.0


def of_curve(command, thrust, numbers):
    """The curve at 16 V, and three exponents."""
    base = thrust[VOLTS == STATED][0]
    effect = VoltageEffect(STATED, (numbers[0],), (numbers[1], numbers[2] / 400.0), 20.0)
    law = ThrustLaw("t200.csv", dead_zone=dead_zone(command, base), voltage=effect)
    return partial(law.thrust, table=lambda acting: np.interp(acting, command, base))


def of_polynomial(command, thrust, numbers):
    """An odd polynomial of three coefficients, the share astern, and three exponents."""
    odd = np.zeros(6)
    odd[1::2] = numbers[3:6] / 400.0 ** np.array([1, 3, 5])
    effect = VoltageEffect(STATED, (numbers[0],), (numbers[1], numbers[2] / 400.0), 20.0)
    return ThrustLaw("", tuple(odd), 1500.0, (1472.0, 1528.0), numbers[6], effect).thrust


LAWS = {"curve": (of_curve, [1.1, -0.5, 1.6]), "polynomial": (of_polynomial, [1.1, -0.5, 1.6, 23.0, 58.0, -29.0, 0.78])}


def errors(law, table, rows, numbers):
    """Residuals over the greatest thrust of the table, shape (rows, 201)."""
    command, thrust = table
    found = [law(command, thrust, numbers)(command, volts=np.full(command.size, VOLTS[row])) for row in rows]
    return (np.array(found) - thrust[rows]) / np.abs(thrust).max()


@pytest.mark.parametrize("name", LAWS)
def test_one_law_fits_six_voltages(table, name):
    """Least squares: at most 2.8 % of the greatest thrust, 65.9 N, by three numbers about the curve at 16 V, 2.5 % by seven in all."""
    law, first = LAWS[name]
    every = range(6)
    found = least_squares(lambda numbers: errors(law, table, every, numbers).ravel(), first).x
    left = errors(law, table, every, found)
    assert np.abs(left).max() < {"curve": 0.028, "polynomial": 0.025}[name]
    assert np.sqrt(np.mean(left**2)) < {"curve": 0.006, "polynomial": 0.009}[name]


@pytest.mark.parametrize("name", LAWS)
def test_a_voltage_between_others_is_interpolated(table, name):
    """Fitted without one voltage, the law predicts it within 2.6 % of the greatest thrust; 20 V from 18 V and less within 3.5 %."""
    law, first = LAWS[name]
    out = []
    for row in range(6):
        rest = [one for one in range(6) if one != row]
        found = least_squares(lambda numbers, rest=rest: errors(law, table, rest, numbers).ravel(), first).x
        out.append(np.abs(errors(law, table, [row], found)).max())
    assert max(out[1:5]) < 0.026
    assert max(out) < 0.035


def test_without_a_change_of_the_exponent_above_16_v_the_fit_is_worse(table):
    """At part throttle the table gains nothing from 18 to 20 V: one exponent for all voltages leaves 4.8 % of the greatest thrust."""

    def alike(numbers):
        return errors(of_polynomial, table, range(6), np.r_[numbers[0], numbers[0], 0.0, numbers[3:]]).ravel()

    left = alike(least_squares(alike, LAWS["polynomial"][1]).x)
    assert np.abs(left).max() > 0.045


def test_up_to_16_v_one_exponent_is_enough(table):
    """From 10 to 16 V about the curve at 16 V: V^1.1 beyond the dead zone, within 2.2 % of the greatest thrust of all."""

    def residuals(numbers):
        return errors(of_curve, table, range(4), np.r_[numbers, numbers, 0.0]).ravel()

    found = least_squares(residuals, [1.0])
    assert found.x == pytest.approx([1.1], abs=0.01)
    assert np.abs(residuals(found.x)).max() < 0.022
