"""Curves by columns of pixels: no spike is lost, and nothing is invented."""

import numpy as np
import pytest

from seatrial.dashboard.downsample import COLUMNS, edges_of, envelopes


def naive(time, values, columns):
    """Least and greatest of every column that holds a sample, one by one."""
    borders = np.linspace(time[0], time[-1], columns + 1)
    place = np.clip(np.searchsorted(borders, time, side="right") - 1, 0, columns - 1)
    found = []
    for column in np.unique(place):
        here = values[place == column]
        here = here[np.isfinite(here)]
        found.append((here.min(), here.max()) if here.size else (np.nan, np.nan))
    return np.array(found).T


@pytest.mark.parametrize("even", [True, False])
def test_envelopes_match_a_loop_over_columns(even):
    rng = np.random.default_rng(1)
    time = np.arange(5000) * 0.1 if even else np.sort(rng.uniform(0, 500, 5000) ** 1.3)
    values = rng.normal(size=5000)
    values[rng.uniform(size=5000) < 0.3] = np.nan
    values[1000:1400] = np.nan
    drawn = envelopes(time, {"u": values}, {"u": values}, columns=50)["u"]
    np.testing.assert_array_equal([drawn.least, drawn.greatest], naive(time, values, 50))
    assert np.all(np.diff(drawn.time) > 0)


def test_few_samples_are_drawn_as_they_are():
    time, values = np.arange(100.0), np.arange(100.0) ** 2
    drawn = envelopes(time, {"u": values}, {"u": values}, columns=50)["u"]
    np.testing.assert_array_equal(drawn.least, values)
    np.testing.assert_array_equal(drawn.greatest, values)
    np.testing.assert_array_equal(drawn.time, time)


def test_one_spike_in_a_million_is_there():
    time, values = np.arange(10**6) * 0.01, np.zeros(10**6)
    values[123_456] = 7.0
    drawn = envelopes(time, {"u": values}, {"u": values})["u"]
    assert drawn.greatest.max() == 7.0
    assert drawn.time.size <= COLUMNS


def test_columns_without_a_sample_are_left_out():
    time = np.concatenate([np.arange(1000) * 0.01, 1000 + np.arange(1000) * 0.01])
    edges = edges_of(time, 100)
    assert edges[0] == 0
    assert edges[-1] == 2000
    assert np.all(np.diff(edges) > 0)
