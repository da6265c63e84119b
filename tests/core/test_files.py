import errno
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from seatrial.core.errors import file_error
from seatrial.core.files import atomic_path, remove_orphans, sha256_of, sha256_of_json, write_json, write_text


def test_writes_the_whole_file_and_nothing_else(tmp_path):
    path = tmp_path / "new" / "deep" / "a.txt"
    write_text(path, "ṽ = 1\n")
    assert path.read_text(encoding="utf-8") == "ṽ = 1\n"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("before", [None, "old"])
def test_an_error_leaves_what_was_there(tmp_path, before):
    path = tmp_path / "a.txt"
    if before:
        path.write_text(before)

    def interrupted():
        with atomic_path(path) as temporary:
            temporary.write_text("half of the new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [file.read_text() for file in tmp_path.iterdir()] == ([before] if before else [])


def test_readers_see_the_old_file_until_the_end(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with atomic_path(path) as temporary:
        temporary.write_text("new")
        assert temporary.parent == path.parent
        assert path.read_text() == "old"
    assert path.read_text() == "new"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), {1, 2}])
def test_json_that_others_cannot_read_is_refused(tmp_path, value):
    with pytest.raises((ValueError, TypeError)):
        write_json(tmp_path / "a.json", {"x": value})
    assert not list(tmp_path.iterdir())


def test_json_round_trip_keeps_letters_and_nulls(tmp_path):
    write_json(tmp_path / "a.json", {"Δu": [1, 2.5, None]})
    assert json.loads((tmp_path / "a.json").read_bytes()) == {"Δu": [1, 2.5, None]}


@pytest.mark.skipif(os.name == "nt" or sys.platform == "darwin", reason="every path there is text")
def test_a_path_that_is_no_utf_8_is_written_and_read_again(tmp_path):
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/bo\xffat/a.json"))
    for _ in range(2):  # written, then compared with what is there
        write_json(path, {"file": str(path)})
    assert Path(json.loads(path.read_bytes())["file"]) == path


def test_hashes_match_hashlib_and_ignore_the_order_of_keys(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(range(256)) * 5000)
    assert sha256_of(path) == hashlib.sha256(path.read_bytes()).hexdigest()
    assert sha256_of_json({"a": 1, "b": [2, 3]}) == sha256_of_json({"b": [2, 3], "a": 1})
    assert sha256_of_json({"a": 1}) != sha256_of_json({"a": 2})


@pytest.mark.parametrize(
    ("error", "named"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "a.nc"),
        (OSError(errno.ENOSPC, "Can't write data (file write failed: errno = 28)"), "a.nc"),
        (OSError(errno.EROFS, "Read-only file system", "/x/.a.nc.abcdefgh.part"), "a.nc"),
        (FileNotFoundError(errno.ENOENT, "No such file", "/x/log.csv"), "/x/log.csv"),
    ],
)
def test_what_the_disk_refuses_is_named(tmp_path, error, named):
    def refused():
        with atomic_path(tmp_path / "a.nc") as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(type(error)) as raised:
        refused()
    said = file_error(raised.value)
    assert said.where.endswith(named)
    assert said.found in os.strerror(error.errno)
    assert not list(tmp_path.iterdir())


WRITES = """
import sys, time
from pathlib import Path
from seatrial.core.errors import file_error
from seatrial.core.files import atomic_path
with atomic_path(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    print(temporary.name, flush=True)
    time.sleep(60)
"""


def test_what_a_killed_process_left_is_removed_and_what_another_writes_is_not(tmp_path):
    deep = tmp_path / "results" / "records"
    kept = [tmp_path / ".mine.part", tmp_path / "results" / "a.abcdefgh.part"]  # no temporary files of ours
    process = subprocess.Popen([sys.executable, "-c", WRITES, str(deep / "a.nc")], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    left = deep / process.stdout.readline().strip()
    for path in kept:
        path.write_text("mine")
    remove_orphans(tmp_path)
    assert left.exists()
    process.kill()
    process.wait()
    with atomic_path(deep / "b.nc") as ours:
        remove_orphans(tmp_path)
        assert ours.exists()
        assert left.exists()
    remove_orphans(tmp_path)
    assert not left.exists()
    assert all(path.exists() for path in kept)
    assert (deep / "b.nc").exists()
