import contextlib

import numpy as np
import pytest
import xarray as xr

from seatrial.core.dataset_file import open_dataset, write_dataset
from seatrial.core.errors import InputError

CONTENT = xr.Dataset(
    {"draws": (("draw", "parameter"), np.arange(8000.0).reshape(4000, 2), {"units": "kg/s"})},
    coords={"parameter": ["X_u", "X_uabsu"]},
    attrs={"key": "k", "acceptance": 0.25, "alarms": "[]", "count": np.int64(3), "grid": np.array([1.0, 2.0])},
)


def test_round_trip_keeps_everything(tmp_path):
    write_dataset(tmp_path / "a.nc", CONTENT)
    xr.testing.assert_identical(open_dataset(tmp_path / "a.nc").drop_attrs(), CONTENT.drop_attrs())
    assert open_dataset(tmp_path / "a.nc").attrs["acceptance"] == 0.25


def test_other_tools_read_and_write_it(tmp_path):
    """A file without a seal is read; a sealed one is plain NetCDF."""
    write_dataset(tmp_path / "a.nc", CONTENT)
    assert float(xr.load_dataset(tmp_path / "a.nc", engine="h5netcdf")["draws"][3, 1]) == 7.0
    CONTENT.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    assert float(open_dataset(tmp_path / "b.nc")["draws"][3, 1]) == 7.0


@pytest.mark.parametrize("at", np.linspace(0.0, 0.999, 40))
def test_damage_anywhere_is_noticed_or_harmless(tmp_path, at):
    """A run of zeroed bytes at any place either changes nothing that is read or is refused."""
    path = tmp_path / "a.nc"
    write_dataset(path, CONTENT)
    damaged = bytearray(path.read_bytes())
    start = int(at * len(damaged))
    damaged[start : start + 64] = bytes(64)
    path.write_bytes(damaged)
    with contextlib.suppress(InputError):
        found = open_dataset(path)
        np.testing.assert_array_equal(found["draws"].values, CONTENT["draws"].values)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_truncated_files_are_refused(tmp_path, share, capsys):
    path = tmp_path / "a.nc"
    write_dataset(path, CONTENT)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match="cannot be read as NetCDF"):
        open_dataset(path)
    assert capsys.readouterr() == ("", "")
