"""Lengths that share a program: few, and none much longer than asked for."""

import numpy as np

from seatrial.compiled.batching import bucket_length, filled


def test_buckets_are_few_and_hardly_longer():
    lengths = np.arange(1, 20001)
    sizes = np.array([bucket_length(int(n)) for n in lengths])
    assert (sizes >= lengths).all()
    assert (sizes <= np.maximum(lengths + 1, 1.125 * lengths)).all()
    assert (np.diff(sizes) >= 0).all()
    assert [bucket_length(int(n)) for n in np.unique(sizes)] == list(np.unique(sizes))
    assert np.unique(sizes[lengths > 16]).size <= 8 * 11


def test_arrays_are_filled_with_a_value_or_their_last_sample():
    array = np.array([[1.0, 2.0], [3.0, 4.0]])
    assert filled(array, 4).tolist() == [[1.0, 2.0], [3.0, 4.0], [3.0, 4.0], [3.0, 4.0]]
    assert filled(array, 3, 0.0).tolist() == [[1.0, 2.0], [3.0, 4.0], [0.0, 0.0]]
