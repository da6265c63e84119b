"""Sums of columns: against the same sum worked out by hand, and nothing but sums."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.logs.linear_sum import parse_sum
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource

SUMS = {
    "0.12 f_1 - 0.12 f_2": ((0.12, "f_1"), (-0.12, "f_2")),
    "-data[0]+2e-1*data[1]": ((-1.0, "data[0]"), (0.2, "data[1]")),
    "a.b/c - .5 'port thruster (N)'": ((1.0, "a.b/c"), (-0.5, "port thruster (N)")),
    "3 * /cmd/x": ((3.0, "/cmd/x"),),
}


@pytest.mark.parametrize("text", SUMS)
def test_parts(text):
    assert parse_sum(text, "here") == SUMS[text]


@pytest.mark.parametrize(
    "text", ["", "1", "a b", "a * b", "2 3 a", "f(a)", "a - ", "a; b", "__import__('os')", "'a", "2a"]
)
def test_what_is_no_sum_is_refused(text):
    with pytest.raises(InputError, match="here"):
        parse_sum(text, "here")


def test_a_channel_of_several_columns(tmp_path):
    one, two = np.sin(np.arange(30.0)), np.cos(0.3 * np.arange(30.0))
    rows = [f"{0.1 * k:.1f},{one[k]:.6f},{two[k] if k != 4 else ''}" for k in range(30)]
    (tmp_path / "log.csv").write_text("t,f_1,f 2\n" + "\n".join(rows) + "\n")
    text = "0.12 f_1 - 0.3 'f 2'"
    column = ColumnMap(text, "N*m", "control", scale=2.0, offset=1.0, parts=parse_sum(text, "here"))
    found = read_log_table(LogSource(tmp_path / "log.csv", "t", "s", {"tau_N": column})).columns["tau_N"]
    expected = 2.0 * (0.12 * one - 0.3 * two) + 1.0
    assert np.isnan(found[4])
    np.testing.assert_allclose(np.delete(found, 4), np.delete(expected, 4), atol=1e-6)
