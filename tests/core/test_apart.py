"""A process of its own answers as this one would, and whatever breaks it breaks nothing else."""

import os
import signal
import subprocess
import sys
import time

import pytest

from seatrial.core import processes as apart
from seatrial.core.errors import InputError

pytestmark = pytest.mark.usefixtures("in_others")


def counted(number):
    yield from range(number)


def fails_after(number, error):
    yield from range(number)
    raise error


def own_id():
    yield os.getpid()


def aborts():
    yield os.getpid()
    os.abort()


def waits(seconds):
    yield os.getpid()
    time.sleep(seconds)


def computes():
    yield os.getpid()
    yield 3**3**19  # one instruction, which never lets another thread run


def fills():
    yield bytearray(1 << 34)


def grows(path):
    with open(path, "wb") as stream:
        stream.truncate(1 << 31)
    yield 0


def asks_one_of_little_memory():
    yield from apart.apart("inner", fills, memory=1 << 30)


def asks_another():
    yield from apart.apart("inner", own_id)
    yield os.getpid()


def is_alive(process):
    """Whether it runs: one that was killed and that nobody has waited for has no command line."""
    try:
        with open(f"/proc/{process}/cmdline", "rb") as stream:
            return bool(stream.read())
    except FileNotFoundError:
        return False


def until(there, seconds=20.0):
    end = time.monotonic() + seconds
    while not there() and time.monotonic() < end:
        time.sleep(0.01)
    return there()


def test_answers_are_those_of_this_process():
    assert list(apart.apart("x", counted, 5)) == list(counted(5))
    (process,) = apart.apart("x", own_id)
    assert process != os.getpid()


def test_a_file_that_grows_without_end(tmp_path):
    with pytest.raises(OSError, match="File too large"):
        list(apart.apart("x", grows, str(tmp_path / "unpacked"), memory=1 << 30))


def test_a_question_within_a_question_keeps_its_own_bound():
    with pytest.raises(InputError, match="memory allowed"):
        list(apart.apart("x", asks_one_of_little_memory, memory=1 << 36))


def test_errors_travel():
    found = apart.apart("x", fails_after, 1, InputError("a.csv", found="b", expected="c", remedy="d"))
    assert next(found) == 0
    with pytest.raises(InputError, match=r"(?s)a\.csv.*b.*c.*d"):
        next(found)
    with pytest.raises(PermissionError, match="no"):
        list(apart.apart("x", fails_after, 0, PermissionError(13, "no", "a.csv")))
    with pytest.raises(apart.Elsewhere, match="of its own") as caught:
        list(apart.apart("x", fails_after, 0, ZeroDivisionError("of its own")))
    assert caught.value.kind == "ZeroDivisionError"


@pytest.mark.parametrize(
    ("question", "about", "limits", "said"),
    [
        (aborts, (), {}, r"breaks its reader \(SIGABRT\)"),
        (waits, (60.0,), {"seconds": 1.0}, "not read after 1 s"),
        (fills, (), {"memory": 4 << 30}, "memory allowed"),
    ],
)
def test_what_breaks_it_is_an_error_here(question, about, limits, said):
    with pytest.raises(InputError, match=rf"(?s)log\.parquet.*{said}"):
        list(apart.apart("log.parquet", question, *about, **limits))


def test_it_ends_with_the_question():
    answers = apart.apart("x", waits, 60.0)
    process = next(answers)
    assert is_alive(process)
    del answers  # which ends it
    assert not is_alive(process)


def test_a_question_within_is_answered_there():
    inner, outer = apart.apart("x", asks_another)
    assert inner == outer != os.getpid()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process that its parent has ended")
def test_it_ends_with_its_parent():
    code = "from seatrial.core.processes import apart; from tests.core.test_apart import computes\n"
    code += "for one in apart('x', computes): print(one, flush=True)"
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert is_alive(child)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert until(lambda: not is_alive(child))
    parent.stdout.close()
