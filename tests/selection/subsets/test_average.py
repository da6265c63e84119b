"""Averages over structures: what they predict for."""

import re

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.conjugate import unit_information
from seatrial.selection.subsets.gram import gram


@pytest.mark.parametrize("shape", [(3,), (2, 2), (2, 4)])
def test_prediction_needs_a_column_for_each_term(shape):
    random = np.random.default_rng(1)
    stats = gram(random.normal(size=(20, 3)), random.normal(size=20))
    found = all_subsets(stats, unit_information(stats, 1.0), tuple("abc"))
    with pytest.raises(InputError, match=re.escape("(m, 3)")):
        found.predict(np.ones(shape))
