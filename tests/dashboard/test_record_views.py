"""Views of long records: from the index as from the rows, no spike lost, in shown units and on the time of their files."""

import numpy as np
import pytest

from seatrial.core.record import SIMULATED, Channel, Provenance, make_record
from seatrial.core.record_file import write_record
from seatrial.dashboard.downsample import envelopes
from seatrial.dashboard.record_views import BLOCK_ROWS, about_record, index_of, record_view, view_of

ROWS = 40 * BLOCK_ROWS + 17


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(2)
    time = np.cumsum(rng.uniform(0.01, 0.03, ROWS))
    values = rng.normal(size=ROWS)
    values[rng.uniform(size=ROWS) < 0.3] = np.nan
    values[5000:7000] = np.nan
    values[12_345] = 50.0
    return time, values


def loader(time, values, asked):
    def load(a, b):
        asked.append(b - a)
        return {"time": time[a:b], "u": values[a:b]}

    return load


@pytest.mark.parametrize(("start", "end"), [(-5.0, 1e4), (100.0, 101.0), (101.3, 330.0), (0.0, 0.001)])
@pytest.mark.parametrize("columns", [10, 1000])
def test_a_view_spans_what_was_measured_there(rows, start, end, columns):
    time, values = rows
    load = loader(time, values, [])
    found = view_of(index_of(ROWS, load), load, start, end, columns)["u"]
    inside = (time >= start) & (time <= end) & np.isfinite(values)
    assert found.time.size <= 4 * columns + 4
    if inside.any():
        assert np.nanmin(found.least) <= values[inside].min()
        assert np.nanmax(found.greatest) >= values[inside].max()
        # nothing is invented, and nothing comes from further away than two blocks
        near = (time >= start - 0.03 * 2 * BLOCK_ROWS) & (time <= end + 0.03 * 2 * BLOCK_ROWS) & np.isfinite(values)
        assert np.nanmin(found.least) >= values[near].min()
        assert np.nanmax(found.greatest) <= values[near].max()


def test_the_index_gives_the_ends_of_its_blocks(rows):
    time, values = rows
    found = index_of(ROWS, loader(time, values, []))
    whole = range(0, ROWS, BLOCK_ROWS)
    blocks = [values[at : at + BLOCK_ROWS][np.isfinite(values[at : at + BLOCK_ROWS])] for at in whole]
    expected = [(one.min(), one.max()) if one.size else (np.nan, np.nan) for one in blocks]
    np.testing.assert_array_equal(np.column_stack([found.least["u"], found.greatest["u"]]), expected)
    np.testing.assert_array_equal(found.time, time[::BLOCK_ROWS])


def test_a_short_view_is_that_of_its_rows(rows):
    time, values = rows
    load = loader(time, values, [])
    found = view_of(index_of(ROWS, load), load, 100.0, 101.0, 700)["u"]
    first, last = np.searchsorted(time, [100.0, 101.0])
    here = {"u": values[first - 1 : last + 1]}
    direct = envelopes(time[first - 1 : last + 1], here, here, 700)["u"]
    for one, other in zip(found, direct, strict=True):
        np.testing.assert_array_equal(one, other)


def test_no_view_reads_the_whole_of_a_long_record(rows):
    time, values = rows
    index, asked = index_of(ROWS, loader(time, values, [])), []
    for start, end in ((0.0, 1e4), (100.0, 300.0), (200.0, 200.5)):
        view_of(index, loader(time, values, asked), start, end, 5)
    assert sum(asked) <= 2 * 5 * BLOCK_ROWS + 2


@pytest.mark.parametrize(("source", "start"), [("a log", 2.0), (SIMULATED, 0.0)])
def test_a_record_is_on_the_time_of_its_files_and_a_doublet_that_starts_late_is_no_offset(tmp_path, source, start):
    time = np.arange(4000) * 0.1
    columns = {"u": np.sin(time), "n": np.where(time > 100, 120.0, 100.0)}
    channels = (Channel("u", "m/s", "measurement"), Channel("n", "rad/s", "control"))
    options = {"start": 2.0, "end": 401.9, "available": 500.0} if source != SIMULATED else {"start": 2.0}
    write_record(make_record(time, columns, channels, Provenance(source, "0", options), "1"), tmp_path / "1.nc")
    about = about_record(tmp_path / "1.nc")
    assert (about.names, about.units, about.roles) == (("u", "n"), ("m/s", "rpm"), ("measurement", "control"))
    assert (about.samples, about.start, about.source) == (4000, start, source)
    assert about.end == pytest.approx(start + 399.9)
    view = record_view(tmp_path / "1.nc", start, start + 1.0, 700)
    np.testing.assert_allclose(view["u"].time[:3], start + time[:3])
    assert record_view(tmp_path / "1.nc", 0.0, 500.0, 10)["n"].greatest.max() == pytest.approx(120.0 * 30 / np.pi)
