import numpy as np
import pytest
import xarray as xr

from seatrial.core.dataset import DataColumn, Dataset
from seatrial.core.dataset_file import SEAL, open_dataset, write_dataset
from seatrial.core.errors import InputError

CONTENT = xr.Dataset(
    {"draws": (("draw", "parameter"), np.arange(8000.0).reshape(4000, 2), {"units": "kg/s"})},
    coords={"parameter": ["X_u", "X_uabsu"]},
    attrs={"key": "k", "acceptance": 0.25, "alarms": "[]", "count": np.int64(3), "grid": np.array([1.0, 2.0])},
)


def test_round_trip_keeps_everything(tmp_path):
    write_dataset(tmp_path / "a.nc", CONTENT)
    xr.testing.assert_identical(open_dataset(tmp_path / "a.nc").to_xarray().drop_attrs(), CONTENT.drop_attrs())
    assert open_dataset(tmp_path / "a.nc").attrs["acceptance"] == 0.25


KINDS = xr.Dataset(
    {
        "real": (("a", "b"), np.array([[1.0, np.nan], [np.inf, -0.0], [3.0, 4.0]]), {"units": "kg/s"}),
        "single": ("a", np.arange(3, dtype=np.float32)),
        "whole": ("a", np.array([1, -2, 3])),
        "small": ("b", np.array([1, 255], np.uint8)),
        "yes": (("b", "a"), np.array([[True, False, True], [False, False, True]]), {"label": "kept"}),
        "text": ("b", np.array(["ṽ", "a longer one"], object)),
        "alone": ((), 2.5),
        "word": ((), "one"),
        "none": ("empty", np.empty(0)),
        "no_words": ("empty", np.empty(0, "U3")),
        "without": ("no_coordinate", np.arange(4.0)),
    },
    coords={
        "a": ("a", [0.1, 0.2, 0.3], {"unit": "s"}),
        "b": ["X_u", "X_uabsu"],
        "beside": ("a", [3, 2, 1]),
        "scalar": 4.0,
    },
    attrs={
        "key": "k",
        "blank": "",
        "ṽ": "ṽ",
        "share": 0.25,
        "nan": np.nan,
        "count": np.int64(3),
        "grid": [1.0, 2.0],
    },
)


def test_what_was_written_here_is_read_as_xarray_reads_it(tmp_path):
    write_dataset(tmp_path / "a.nc", KINDS)
    theirs = xr.load_dataset(tmp_path / "a.nc", engine="h5netcdf", decode_times=False)
    del theirs.attrs[SEAL]
    ours = open_dataset(tmp_path / "a.nc")
    xr.testing.assert_identical(ours.to_xarray(), theirs)
    assert {name: (one.values.dtype, one.dims) for name, one in ours.variables.items()} == {
        name: (one.dtype, one.dims) for name, one in theirs.variables.items()
    }
    assert {name: type(value) for name, value in ours.attrs.items()} == {
        name: type(value) for name, value in theirs.attrs.items()
    }


def test_it_is_written_as_xarray_writes_it(tmp_path):
    write_dataset(tmp_path / "a.nc", KINDS)
    KINDS.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    ours, theirs = (xr.load_dataset(tmp_path / f"{x}.nc", engine="h5netcdf", decode_times=False) for x in "ab")
    del ours.attrs[SEAL]
    xr.testing.assert_identical(ours, theirs)


@pytest.mark.parametrize(
    "chosen", [{"b": "X_uabsu"}, {"b": ["X_uabsu", "X_u"]}, {"a": 0.2, "b": "X_u"}, {"a": [0.3, 0.1]}]
)
def test_labels_choose_what_they_choose_in_xarray(chosen):
    ours = Dataset.of(KINDS)
    for name in ("real", "yes", "single"):
        here = {dim: label for dim, label in chosen.items() if dim in ours[name].dims}
        np.testing.assert_array_equal(ours[name].sel(**here).values, KINDS[name].sel(here).values)
    np.testing.assert_array_equal(ours.sel(**chosen)["real"].values, KINDS.sel(chosen)["real"].values)
    assert ours.isel(a=slice(2)).sizes == dict(KINDS.isel(a=slice(2)).sizes)


@pytest.mark.parametrize(
    "calculate",
    [
        lambda data: data["a"] - 1,
        lambda data: 2 * data["a"] / data["b"],
        lambda data: np.exp(-data["a"]),
        lambda data: data["a"] > 1,
        lambda data: abs(data["a"]).max(),
        lambda data: data[["a"]].to_dataframe(),
        lambda data: data.a.sel(x="q"),
        lambda data: [*list(data), len(data), len(data["a"]), int(data["a"].sel(x="q")), sum(data["a"])],
    ],
)
def test_calculations_are_those_of_xarray(calculate):
    ours = Dataset({"a": ("x", np.arange(3.0)), "b": ("x", np.ones(3))}, {"x": ["p", "q", "r"]})
    found, expected = calculate(ours), calculate(ours.to_xarray())
    found = found.to_xarray() if isinstance(found, DataColumn) else found
    assert found.equals(expected) if hasattr(found, "equals") else found == expected


def test_xarrays_methods_take_ours(tmp_path):
    write_dataset(tmp_path / "a.nc", KINDS)
    one, other = (open_dataset(tmp_path / "a.nc") for _ in range(2))
    (name, *_) = [name for name, column in one.variables.items() if column.values.dtype.kind == "f"]
    assert one.equals(other)
    assert one[name].equals(other[name])
    assert not one.equals(other.isel(**{one.variables[name].dims[0]: slice(1)}))
    assert one[name].where(other[name] == other[name], other[name]).equals(one[name])


def test_a_label_or_a_length_that_is_not_there_is_refused():
    with pytest.raises(KeyError, match="no X_v along b, which has X_u, X_uabsu"):
        Dataset.of(KINDS).sel(b="X_v")
    with pytest.raises(ValueError, match="has the shape"):
        Dataset({"x": ("a", np.zeros(2)), "y": ("a", np.zeros(3))})


def test_what_was_written_here_is_read_without_xarrays_readers(tmp_path, monkeypatch):
    write_dataset(tmp_path / "a.nc", KINDS)
    monkeypatch.setattr("xarray.load_dataset", lambda *about, **options: pytest.fail("opened"))
    assert open_dataset(tmp_path / "a.nc")["whole"].values.tolist() == [1, -2, 3]


def test_other_tools_read_and_write_it(tmp_path):
    """A file without a seal is read; a sealed one is plain NetCDF."""
    write_dataset(tmp_path / "a.nc", CONTENT)
    assert float(xr.load_dataset(tmp_path / "a.nc", engine="h5netcdf")["draws"][3, 1]) == 7.0
    CONTENT.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    assert float(open_dataset(tmp_path / "b.nc")["draws"][3, 1]) == 7.0


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_truncated_files_are_refused(tmp_path, share, capsys):
    path = tmp_path / "a.nc"
    write_dataset(path, CONTENT)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match="cannot be read as NetCDF"):
        open_dataset(path)
    assert capsys.readouterr() == ("", "")
