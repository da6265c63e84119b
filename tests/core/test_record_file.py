import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

from seatrial.core.errors import InputError
from seatrial.core.record import make_record
from seatrial.core.record_file import FORMAT, read_record, write_record
from tests.cases import CHANNELS, PROVENANCE

TIME = np.arange(40) * 0.1 + 1e9
U = np.where(np.arange(40) % 4, np.nan, np.sin(TIME) / 3)
COLUMNS = {"n": np.full(40, 78.5), "u": U, "udot": np.cos(TIME)}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "runs" / "trial.nc"
    write_record(make_record(TIME, COLUMNS, CHANNELS, PROVENANCE, "run 7"), path)
    return path


def test_round_trip_is_exact(path):
    record = read_record(path)
    assert (record.channels, record.label, record.provenance) == (CHANNELS, "run 7", PROVENANCE)
    assert np.array_equal(record.time, TIME)
    for name, column in COLUMNS.items():
        assert np.array_equal(record.channel(name), column, equal_nan=True)


def test_plain_xarray_reads_it(path):
    code = f"""
import sys, xarray
data = xarray.open_dataset({str(path)!r})
assert not any("seatrial" in name for name in sys.modules)
print(list(data.data_vars), data.u.dims, data.u.units, data.n.role)
print(data.time.dtype, float(data.time[0]), int(data.u.isnull().sum()))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "['n', 'u', 'udot'] ('time',) m/s control\nfloat64 1000000000.0 30"


def test_file_of_another_kind(tmp_path):
    path = tmp_path / "trial.nc"
    path.write_text("time,u\n0,1\n")
    with pytest.raises(InputError, match="11 bytes that cannot be read as NetCDF"):
        read_record(path)


def test_no_such_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_record(tmp_path / "absent.nc")


ATTRS = {"format": FORMAT, "label": "run 7", "source": "trial.csv", "sha256": "0" * 64, "options": "{}"}
CHANNEL_ATTRS = {"units": "m/s", "role": "measurement"}


def dataset(values=COLUMNS["udot"], channel_attrs=CHANNEL_ATTRS, attrs=ATTRS):
    return xr.Dataset({"u": ("time", values, channel_attrs)}, {"time": TIME}, attrs)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (dataset(attrs={}), "not stated"),
        (dataset(attrs={**ATTRS, "format": "seatrial record 99"}), "record 99"),
        (dataset(channel_attrs={}), "units"),
        (dataset(attrs={"format": FORMAT}), None),
        (dataset(attrs={**ATTRS, "options": "{"}), None),
        (dataset().drop_vars("time"), "time"),
        (dataset(["fast"] * 40), None),
        (dataset(TIME * 0), "0.0.* in every sample"),
    ],
    ids=["foreign", "later format", "no units", "no provenance", "broken options", "no time", "text", "constant"],
)
def test_foreign_file(tmp_path, content, found):
    path = tmp_path / "other.nc"
    content.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match=found):
        read_record(path)
