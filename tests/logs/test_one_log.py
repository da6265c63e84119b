"""A log read in one call is what the map, the reader and the alignment make of it."""

import numpy as np
import pytest

import seatrial as st

ROWS = 21
T = np.arange(ROWS) * 0.5


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "run7.csv"
    rows = (f"{100 + t:.1f},{1200 + 10 * t:g},{1.5 + 0.1 * t:g},{90 + t:g}" for t in T)
    path.write_text("t,prop,speed,heading\n" + "\n".join(rows) + "\n")
    return path


MAP = {"n": ("prop", "rpm"), "u": ("speed", "m/s"), "psi": ("heading", "deg")}


def test_channels_roles_and_units(log):
    record = st.read_log(log, MAP, ["n"], time=("t", "s"))
    assert (record.controls, record.measured, record.label) == (("n",), ("u", "psi"), "run7")
    np.testing.assert_allclose(record.time, T)
    np.testing.assert_allclose(record.channel("n"), (1200 + 10 * T) * 2 * np.pi / 60)
    np.testing.assert_allclose(record.channel("psi"), np.radians(90 + T))


def test_a_control_is_a_line_between_its_samples_where_that_is_said(log):
    record = st.read_log(log, MAP, ["n"], time=("t", "s"), between={"n": "line"})
    np.testing.assert_allclose(record.channel("n")[:-1], (1202.5 + 10 * T[:-1]) * 2 * np.pi / 60)
    with pytest.raises(st.InputError, match=r"between[^$]*found[^$]*u"):
        st.read_log(log, MAP, ["n"], time=("t", "s"), between={"u": "line"})


def test_a_grid_and_its_ends(log):
    record = st.read_log(log, MAP, ["n"], time=("t", "s"), step=1.0, start=2.0, end=8.0, label="middle")
    assert record.label == "middle"
    np.testing.assert_allclose(record.time, np.arange(7.0))
    assert record.channel("u")[0] == pytest.approx(1.7)


def test_velocities_over_the_earth_are_turned(tmp_path):
    path, small = tmp_path / "earth.csv", 1e-4 * T
    rows = (f"{t:.1f},{1200 + t:g},{e},{1.5 + 0.1 * t:g},{e},{e},{e},{90 + e}" for t, e in zip(T, small, strict=True))
    path.write_text("t,prop,north,east,down,roll,pitch,yaw\n" + "\n".join(rows) + "\n")
    channels = {"n": ("prop", "rpm")} | {f"v_{name}": (name, "m/s") for name in ("north", "east", "down")}
    channels |= {"phi": ("roll", "deg"), "theta": ("pitch", "deg"), "psi": ("yaw", "deg")}
    record = st.read_log(path, channels, ["n"], time=("t", "s"))
    assert set(record.measured) == {"u", "v", "w", "phi", "theta", "psi"}
    np.testing.assert_allclose(record.channel("u"), 1.5 + 0.1 * T, atol=1e-3)
    np.testing.assert_allclose(record.channel("v"), 0.0, atol=2e-3)


def test_a_hole_is_among_the_cautions_and_told_in_print(tmp_path):
    stamps = np.delete(0.1 * np.arange(200), slice(100, 140))
    path = tmp_path / "run8.csv"
    path.write_text(
        "t,prop,speed\n" + "".join(f"{t:.1f},{1200 + 100 * (t > 15):g},{1.5 + 0.1 * t:g}\n" for t in stamps)
    )
    record = st.read_log(path, {"n": ("prop", "rpm"), "u": ("speed", "m/s")}, ["n"], time=("t", "s"))
    assert "no sample of n, u from 9.90 s to 14.00 s" in record.cautions[0]
    assert "controls n [rad/s]; measured u [m/s]; 1 caution: read record.cautions" in repr(record)


COLUMNS = (st.Channel("n", "rad/s", "control"), st.Channel("u", "m/s", "measurement"))
SHAFT = 120.0 + 20.0 * np.sin(0.7 * 0.1 * np.arange(300))
"""Speed of a propeller at 10 Hz, rad/s: a sine of 9 s."""


def made(shaft, stamps=1.7e9, **stated):
    time, speed = stamps + 0.1 * np.arange(shaft.size), 1.5 + 0.001 * np.arange(shaft.size)
    return st.make_record(time, {"n": shaft, "u": speed}, COLUMNS, st.Provenance("own", ""), **stated)


def test_a_measured_control_of_own_columns_is_a_line_between_its_samples():
    """The mean of a sine over each step by its integral: trapezia miss it by a millionth, held samples by half a step."""
    with pytest.warns(
        UserWarning, match=r'control n: it looks measured.*between=\{"n": "line"\}.*between=\{"n": "held"\}'
    ) as warned:
        record = made(SHAFT)
    assert warned[0].filename == __file__
    edges = 0.7 * 0.1 * np.arange(300)
    means = 120.0 - 20.0 * np.diff(np.cos(edges)) / np.diff(edges)
    np.testing.assert_allclose(record.channel("n")[:-1], means, atol=0.01)
    assert np.abs(SHAFT[:-1] - means).max() > 0.6
    assert (len(record.cautions), record.provenance.options["between"]) == (1, {"n": "line"})


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("between", ["line", "held"])
def test_a_stated_control_of_own_columns_is_not_doubted(tmp_path, between):
    """The same numbers in a log, read with the same word, make the same record."""
    record = made(SHAFT, stamps=0.0, between={"n": between})
    rows = (f"{0.1 * k:.1f},{n!r},{1.5 + 0.001 * k!r}" for k, n in enumerate(SHAFT.tolist()))
    (tmp_path / "log.csv").write_text("t,n,u\n" + "\n".join(rows) + "\n")
    channels = {"n": ("n", "rad/s"), "u": ("u", "m/s")}
    logged = st.read_log(tmp_path / "log.csv", channels, ["n"], time=("t", "s"), between={"n": between})
    np.testing.assert_allclose(record.control, logged.control, rtol=1e-12)
    assert record.cautions == logged.cautions == ()


def test_a_measured_control_of_a_log_is_a_line_between_its_samples(tmp_path):
    rows = (f"{0.1 * k:.1f},{n!r},{1.5 + 0.001 * k!r}" for k, n in enumerate(SHAFT.tolist()))
    (tmp_path / "log.csv").write_text("t,n,u\n" + "\n".join(rows) + "\n")
    asked = tmp_path / "log.csv", {"n": ("n", "rad/s"), "u": ("u", "m/s")}, ["n"]
    with pytest.warns(
        UserWarning, match=r'control n: it looks measured.*between=\{"n": "line"\} in read_log'
    ) as warned:
        record = st.read_log(*asked, time=("t", "s"))
    assert warned[0].filename == __file__
    stated = st.read_log(*asked, time=("t", "s"), between={"n": "line"})
    np.testing.assert_array_equal(record.control, stated.control)
    assert (len(record.cautions), len(stated.cautions)) == (1, 0)


@pytest.mark.filterwarnings("error")
def test_a_command_of_own_columns_is_held():
    steps = np.repeat([100.0, 140.0, 90.0], 100)
    np.testing.assert_array_equal(made(steps).channel("n"), steps)
