"""Whatever the bytes, a log is read or refused with an InputError; nothing else is ever raised."""

from contextlib import suppress

from hypothesis import example, given, settings
from hypothesis import strategies as st

from seatrial.core.errors import InputError
from seatrial.logs.align import align
from seatrial.logs.log_table import read_log_table
from tests.logs.log_cases import source, written

NAMES = ("run.csv", "run.csv.gz", "run.tsv")
CELLS = st.sampled_from(
    [
        "0",
        "1",
        "2.5",
        "-3e4",
        "1e400",
        "-1e400",
        "inf",
        "nan",
        "",
        " ",
        '"',
        '""',
        '"1"',
        "'",
        "0x1F",
        "1_0",
        "١",
        "é",
        "True",
        "9" * 30,
        "1e-99999999999999999999",
        "9223372036854775807",
        "-9223372036854775808",
        "18446744073709551615",
        "1,5",
        "t",
        "rpm",
        "speed",
        "\0",
        "\t",
        "\x0b",
        "\x1c",
        "\u2028",
        "#",
    ]
)


def read_or_refuse(folder, content, name="run.csv", **changes):
    path = written(folder, content, name)
    with suppress(InputError):
        align([read_log_table(source(path, **changes))], step=0.5)


@given(content=st.binary(max_size=400), name=st.sampled_from(NAMES))
@settings(max_examples=150)
def test_random_bytes(tmp_path_factory, content, name):
    read_or_refuse(tmp_path_factory.getbasetemp(), content, name)


@given(content=st.text(max_size=200))
@settings(max_examples=80)
def test_random_text(tmp_path_factory, content):
    read_or_refuse(tmp_path_factory.getbasetemp(), content)
    read_or_refuse(tmp_path_factory.getbasetemp(), "t,rpm,speed\n" + content)


@given(
    rows=st.lists(st.lists(CELLS, min_size=3, max_size=3), max_size=8),
    blank=st.sampled_from([",", "whitespace"]),
    clock=st.sampled_from(["as_stamped", "even", "drop_repeated"]),
    unit=st.sampled_from(["s", "ns", "h"]),
)
@settings(max_examples=300)
@example(rows=[["0", "1", '"'], ["1", "1", "2"], ["2", "1", '"']], blank=",", clock="even", unit="s")
@example(
    rows=[["-9223372036854775808", "1", "2"], ["0", "1", "2"], ["9223372036854775807", "1", "3"]],
    blank=",",
    clock="even",
    unit="s",
)
def test_tables_of_awkward_cells(tmp_path_factory, rows, blank, clock, unit):
    text = "\n".join((" " if blank == "whitespace" else ",").join(row) for row in [["t", "rpm", "speed"], *rows])
    read_or_refuse(tmp_path_factory.getbasetemp(), text, delimiter=blank, clock=clock, time_unit=unit)
