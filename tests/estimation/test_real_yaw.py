"""Yaw of a real ship model in zigzags: rows in weak form explain it, and say that what is left over is not white."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.regression.row_fit import fit_rows, independent_rows
from seatrial.estimation.regression.rows import whitened_rows
from seatrial.estimation.regression.weak_form import weak_trials
from seatrial.vehicles.axis_equation import axis_equation

DATA = Path(os.environ.get("SEATRIAL_DATA", Path(__file__).parents[2] / "../shared/data")) / "kvlcc2_hsva"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no real records: set SEATRIAL_DATA to their folder")
CHANNELS = (
    Channel("u", "m/s", "measurement"),
    Channel("v", "m/s", "measurement"),
    Channel("r", "rad/s", "measurement"),
    Channel("delta_r", "rad", "control"),
)
FULL = ("N_0", "N_r", "N_v", "N_ur", "N_uv", "N_uudelta_r", "N_rabsr", "N_vabsv", "N_rabsv", "N_vabsr", "N_r3")
NOISE = {"u": 1.5e-4, "v": 1.8e-4, "r": 1e-5}


def zigzag(run):
    """Body velocities by hand from heading and earth-fixed velocities; the rudder's sign turned to that of the heading."""
    path = DATA / f"HSVA_CPMC_KVLCC2_Z_{run}.dat.gz"
    with gzip.open(path, "rt", encoding="cp1252") as stream:
        table = np.loadtxt(stream, skiprows=4)
    heading, rate, rudder = np.radians(table[:, [3, 6, 8]]).T
    east, north = table[:, 5], table[:, 4]
    columns = {
        "u": north * np.cos(heading) + east * np.sin(heading),
        "v": east * np.cos(heading) - north * np.sin(heading),
        "r": rate,
        "delta_r": -rudder,
    }
    return make_record(table[:, 0], columns, CHANNELS, Provenance(path.name, "0" * 64), run)


@pytest.fixture(scope="module")
def records():
    return [zigzag(run) for run in ("10_05", "20_05", "20_10_P", "35_05")]


def test_yaw_is_explained_and_its_forces_have_the_signs_of_a_ship(records):
    equations = [axis_equation("N", FULL)]
    rows = whitened_rows(equations, weak_trials(records, equations, 5.0), NOISE)
    fit = fit_rows(rows)
    assert rows.r2[0] > 0.98
    value = dict(zip(fit.names, fit.values, strict=True))
    slope = value["N_r"] + 1.1 * value["N_ur"]
    assert slope < 0 < value["N_uudelta_r"]
    assert "residuals of axis N are correlated" in fit.status


def test_wider_windows_leave_independent_residuals(records):
    equations = [axis_equation("N", FULL)]
    rows, fit = independent_rows(equations, records, NOISE, 2.5)
    assert fit.status == ""
    assert 60 < len(rows.target) < 300
    assert rows.r2[0] > 0.98


def test_three_linear_terms_explain_less(records):
    linear = [axis_equation("N", ("N_r", "N_v", "N_delta_r"))]
    r2 = whitened_rows(linear, weak_trials(records, linear, 5.0), NOISE).r2[0]
    assert 0.85 < r2 < 0.95
