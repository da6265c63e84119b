"""Logs whose library damaged bytes can bring to abort: that ends a process of its own, and here is an error."""

import random
import subprocess
import sys

import numpy as np
import pytest

from seatrial.core import processes as apart
from seatrial.core.errors import InputError
from seatrial.dashboard.logs import look_into
from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.registry import catalogue, read_columns
from seatrial.logs.inspect import inspect_log
from tests.logs.log_writers import WRITERS

pytestmark = pytest.mark.usefixtures("in_others")


@pytest.mark.parametrize("name", ["parquet", "matlab 7.3"])
def test_what_is_read_apart_is_what_is_read_here(tmp_path, monkeypatch, name):
    written = WRITERS[name](tmp_path)
    log, columns = LogFile(written.path), [written.surge, written.clock]

    def read():
        return catalogue(log), read_columns(log, written.table, columns, [written.clock]).columns

    (tables, there), _ = read(), monkeypatch.setattr(apart, "_is_apart", True)
    expected, here = read()
    assert tables == expected
    for column in columns:
        np.testing.assert_array_equal(there[column], here[column])
        assert there[column].dtype == here[column].dtype


@pytest.mark.parametrize(("name", "library"), [("parquet", "pyarrow")])
def test_a_library_that_aborts(tmp_path, monkeypatch, name, library):
    written = WRITERS[name](tmp_path)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / f"{library}.py").write_text("import os\nos.abort()\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "broken"), *sys.path])
    for read in (lambda: catalogue(LogFile(written.path)), lambda: inspect_log(written.path)):
        with pytest.raises(InputError, match=r"(?s)run\.parquet.*breaks its reader \(SIGABRT\).*export it again"):
            read()
    with pytest.raises(InputError, match=r"(?s)logs/run\.parquet.*breaks its reader"):
        look_into(str(written.path), "logs/run.parquet", ())


def test_a_damaged_file_ends_the_command_with_an_error(tmp_path):
    """Some of these bytes abort the reader of today."""
    written = WRITERS["parquet"](tmp_path)
    whole, draw = bytearray(written.path.read_bytes()), random.Random(73)
    for _ in range(draw.choice([1, 1, 2, 8, 64])):
        whole[draw.randrange(len(whole))] = draw.randrange(256)
    written.path.write_bytes(whole)
    command = [sys.executable, "-m", "seatrial", "inspect", str(written.path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"error: {written.path}")
    assert "remedy:" in ended.stderr
