"""Axes of logs against SciPy's rotations: signs, quaternions, and velocities over the earth turned into the body's."""

from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seatrial.core.errors import InputError
from seatrial.core.record import Channel
from seatrial.core.signals import QUATERNION, signal_unit
from seatrial.logs.axes import from_axes
from seatrial.logs.body_frame import to_body
from seatrial.logs.source import LogTable
from tests.logs.log_cases import refusal

NED_OF_ENU = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
FRD_OF_FLU = np.diag([1.0, -1, -1])
ALL = dict.fromkeys(("u", "v", "w", "phi", "theta", "psi", "z"), "measurement") | {"n": "control"}


def only(*names):
    return dict.fromkeys(names, "measurement")


def table(source="log", start=0.0, rate=10.0, count=200, **columns):
    time = np.arange(count) / rate
    channels = tuple(Channel(name, signal_unit(name), "measurement") for name in columns)
    return LogTable(time, Decimal(repr(start)), columns, channels, source, "0" * 64)


def rotations(count=200, seed=0):
    return Rotation.random(count, np.random.default_rng(seed))


def angles_of(rotation):
    psi, theta, phi = rotation.as_euler("ZYX").T
    return {"phi": phi, "theta": theta, "psi": psi}


def parts_of(rotation):
    x, y, z, w = rotation.as_quat().T
    return dict(zip(QUATERNION, (w, x, y, z), strict=True))


def assert_same_angles(found, expected):
    for name, values in expected.items():
        np.testing.assert_allclose((found[name] - values + np.pi) % (2 * np.pi) - np.pi, 0, atol=1e-9, err_msg=name)


def test_quaternions_become_angles():
    rotation = rotations()
    (found,) = to_body([table(**parts_of(rotation), n=np.ones(200))], ALL)
    assert [channel.name for channel in found.channels] == ["n", "phi", "theta", "psi"]
    assert_same_angles(found.columns, angles_of(rotation))


def test_enu_is_turned_as_its_matrices_say():
    enu = rotations(seed=1)
    ned = Rotation.from_matrix(NED_OF_ENU @ enu.as_matrix() @ FRD_OF_FLU)
    (found,) = to_body([table(**from_axes(parts_of(enu), "ENU", "log"))], ALL)
    assert_same_angles(found.columns, angles_of(ned))
    assert_same_angles(from_axes(angles_of(enu), "ENU", "log"), angles_of(ned))


@pytest.mark.parametrize("names", ["u v w", "p q r", "tau_X tau_Y tau_Z", "tau_K tau_M tau_N", "udot vdot wdot"])
def test_vectors_of_the_body_in_enu(names):
    vectors = np.random.default_rng(2).normal(size=(50, 3))
    columns = dict(zip(names.split(), vectors.T, strict=True))
    found = from_axes(columns, "ENU", "log")
    np.testing.assert_array_equal(np.stack([*found.values()]).T, vectors @ FRD_OF_FLU.T)
    assert from_axes(columns, "NED", "log").keys() == columns.keys()


def test_velocities_over_the_earth_become_the_bodys():
    rotation, speed = rotations(seed=3), np.random.default_rng(4).normal(size=(200, 3))
    earth = rotation.apply(speed).T
    log = table(**parts_of(rotation), **dict(zip(("v_north", "v_east", "v_down"), earth, strict=True)))
    (found,) = to_body([log], only("u", "v", "w"))
    assert [channel.name for channel in found.channels] == ["u", "v", "w"]
    # Random attitudes turn by far more than half a turn between samples, where unwrapping must do no harm.
    np.testing.assert_allclose(np.stack([found.columns[name] for name in "uvw"]).T, speed, atol=1e-9)


def test_the_attitude_of_another_file_is_interpolated_over_the_turn():
    heading = 0.3 * np.arange(400) / 20.0 + 3.0
    wrapped = (heading + np.pi) % (2 * np.pi) - np.pi
    compass = table("compass", start=100.0, rate=20.0, psi=wrapped, count=400)
    time = 2.003 + np.arange(100) / 10.0
    psi = 0.3 * time + 3.0
    gps = table(
        "gps", start=102.003, count=100, v_north=np.cos(psi) - 0.2 * np.sin(psi), v_east=np.sin(psi) + 0.2 * np.cos(psi)
    )
    velocity, kept = to_body([gps, compass], only("u", "v", "psi"))
    np.testing.assert_allclose(velocity.columns["u"], 1.0, atol=1e-9)
    np.testing.assert_allclose(velocity.columns["v"], 0.2, atol=1e-9)
    assert "w" not in velocity.columns
    assert velocity.notes[-1] == "u, v are over the earth, turned by phi = 0, theta = 0, psi of compass"
    np.testing.assert_array_equal(kept.columns["psi"], wrapped)
    (alone,) = to_body([gps, compass], only("v") | {"u": "control"})
    assert (alone.source, [channel.role for channel in alone.channels]) == ("gps", ["control", "measurement"])


def test_holes_of_the_attitude_are_holes_of_the_velocity():
    psi = np.where(np.arange(200) // 10 == 7, np.nan, 0.0)
    compass = table("compass", psi=np.where((np.arange(200) > 60) & (np.arange(200) < 90), np.nan, psi))
    gps = table("gps", start=-1.0, count=240, v_north=np.ones(240), v_east=np.zeros(240))
    found = to_body([gps, compass], only("u"))[0].columns["u"]
    known = np.isfinite(found)
    time = np.arange(240) / 10.0 - 1.0
    np.testing.assert_array_equal(known, (time > -1e-9) & (time < 19.9 + 1e-9) & ((time < 6.05) | (time > 8.95)))


def test_what_is_missing_or_twice_is_said():
    ones = np.ones(200)
    gps = table("gps", v_north=ones, v_east=ones)
    with refusal("gps, channels v_north, v_east", "no heading in any file", "map the heading too"):
        to_body([gps], ALL)
    with refusal("gps, channels v_north", "no v_east"):
        to_body([table("gps", v_north=ones, psi=ones)], ALL)
    with refusal("gps, channels v_north, v_east", "no v_down"):
        to_body([gps, table("imu", theta=ones, psi=ones)], ALL)
    with refusal("gps, channels u", "v_north, v_east", "one or the other"):
        to_body([table("gps", v_north=ones, v_east=ones, u=ones, psi=ones)], ALL)
    with refusal("log, channels q_w, q_x", "no q_y, q_z"):
        from_axes({"q_w": ones, "q_x": ones}, "NED", "log")
    halves = dict.fromkeys(QUATERNION, 0.5 * ones)
    broken = table(**(halves | {"q_w": np.where(np.arange(200) == 30, 0.0, 0.5)}))
    with refusal("log, channels q_w", "a length of 0.866 at 3 s; 1 such rows", "scalar part"):
        to_body([broken], ALL)
    with refusal("phi, theta, psi", "one or the other"):
        to_body([table(**halves, phi=ones, theta=ones, psi=ones)], ALL)


def test_rows_without_attitude_stay_holes():
    parts = parts_of(rotations())
    parts["q_x"] = np.where(np.arange(200) < 5, np.nan, parts["q_x"])
    (found,) = to_body([table(**parts)], ALL)
    assert np.isnan(found.columns["psi"]).sum() == 5


def turning(per_row, rate=10.0):
    """A compass and a log of yaw rate and velocities over the earth of a vehicle that turns evenly, 0.3 rad/s."""
    psi = per_row * np.arange(200)
    compass = table("compass", rate=0.3 / per_row, psi=(psi + np.pi) % (2 * np.pi) - np.pi)
    time = np.arange(int(10 * compass.time[-1])) / 10.0
    nav = table(
        "nav", count=time.size, r=np.full(time.size, 0.3), v_north=np.cos(0.3 * time), v_east=np.sin(0.3 * time)
    )
    return nav, compass


def test_a_heading_that_disagrees_with_the_yaw_rate_is_told():
    nav, compass = turning(0.03)
    kept = to_body([nav, compass], only("u", "r"))
    assert [one.cautions for one in kept] == [()]
    for wrong, told in ((np.radians, "0.0175 times"), (np.negative, "-1 times")):
        columns = {"psi": wrong(np.unwrap(compass.columns["psi"]))}
        (found,) = to_body([nav, replace(compass, columns=columns)], only("u", "r"))
        assert f'channel "psi" of compass: it turns {told} as fast as r of nav' in found.cautions[0]


def test_a_heading_too_slow_to_turn_velocities_by_is_told():
    nav, compass = turning(0.5)
    (found,) = to_body([nav, compass], only("u"))
    assert "it changes by 29 deg from one sample to the next" in found.cautions[0]


def test_two_headings_and_other_clocks_are_refused():
    nav, compass = turning(0.03)
    with refusal("second", 'channel "psi"', "compass gives too"):
        to_body([nav, compass, replace(compass, source="second")], only("u"))
    with refusal("compass", "samples from 5000 s", "same clock"):
        to_body([nav, replace(compass, epoch=compass.epoch + 5000)], only("u"))
    lone = replace(compass, columns={"psi": np.where(np.arange(200) == 5, 1.0, np.nan)})
    with refusal("compass", "1 samples"):
        to_body([nav, lone], only("u"))


GYROS = {
    "as it is": (np.eye(3), ()),
    "in deg/s": (np.eye(3) * 180 / np.pi, ("degrees taken for radians",) * 3),
    "forward, left, up": (np.diag([1.0, -1.0, -1.0]), ("its opposite", "its opposite")),
    "axes exchanged": (np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]]), ("exchanged", "exchanged", "left-handed")),
    "mirrored": (np.diag([1.0, -1.0, 1.0]), ("its opposite", "left-handed")),
    "about another axis": (np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), ("exchanged", "exchanged")),
}


@pytest.mark.parametrize("what", GYROS)
def test_a_gyro_that_turns_otherwise_than_the_attitude_is_doubted(tmp_path, what):
    """The attitude is SciPy's, turned by known body rates; quaternions have any sign."""
    matrix, expected = GYROS[what]
    time, rates, turns = turned()
    x, y, z, w = (turns.as_quat() * np.where(np.arange(1000) % 7, 1, -1)[:, None]).T
    cautions = cautions_of(tmp_path, time, rates @ matrix.T, q_w=w, q_x=x, q_y=y, q_z=z)
    assert len(cautions) == len(expected)
    for text, part in zip(cautions, expected, strict=True):
        assert part in text


@pytest.mark.parametrize(
    ("order", "signs", "told"),
    [
        ("xyzw", (1, 1, 1, 1), "are x, y, z and w"),
        ("zwxy", (1, 1, 1, 1), "are z, w, x and y"),
        ("wxyz", (1, -1, -1, -1), "scale = -1 for q_x, q_y and q_z"),
    ],
)
def test_another_reading_of_the_quaternion_is_named_where_the_gyro_agrees_with_it(tmp_path, order, signs, told):
    time, rates, turns = turned()
    held = dict(zip("xyzw", turns.as_quat().T, strict=True))
    columns = {f"q_{part}": sign * held[holds] for part, sign, holds in zip("wxyz", signs, order, strict=True)}
    (text,) = cautions_of(tmp_path, time, rates, **columns)
    assert told in text


@pytest.mark.parametrize(
    ("in_degrees", "told"),
    [
        ("phi theta psi", "phi, theta and psi are in degrees"),
        ("psi", "if psi is in"),
        ("phi theta", "phi and theta are"),
    ],
)
def test_angles_in_degrees_are_named_where_the_gyro_agrees_with_them(tmp_path, in_degrees, told):
    time, rates, turns = turned()
    angles = dict(zip(("psi", "theta", "phi"), turns.as_euler("ZYX").T, strict=True))
    shown = {name: np.degrees(one) if name in in_degrees.split() else one for name, one in angles.items()}
    (text,) = cautions_of(tmp_path, time, rates, **shown)
    assert told in text


@pytest.mark.parametrize("in_degrees", [False, True])
def test_jumps_of_the_attitude_are_told_and_hide_no_unit(tmp_path, in_degrees):
    """The mean of angles on both sides of half a turn is an angle where the vehicle never was."""
    time, rates, turns = turned()
    psi, theta, phi = turns.as_euler("ZYX").T
    (over,) = np.flatnonzero(np.abs(np.diff(psi)) > np.pi)
    psi[over : over + 10] = 0.0
    cautions = cautions_of(tmp_path, time, rates * (180 / np.pi if in_degrees else 1.0), phi=phi, theta=theta, psi=psi)
    jumps = [text for text in cautions if "jumps" in text]
    assert len(jumps) == 1
    assert float(jumps[0].split("first at ")[1].split(" s")[0]) == pytest.approx(time[over], abs=0.2)
    assert len(cautions) == (4 if in_degrees else 1)
    assert all("degrees taken for radians" in text for text in cautions if text not in jumps)


def turned():
    """Instants, body rates, and the attitude that SciPy makes of them, over several turns."""
    from scipy.spatial.transform import Rotation

    time = 0.02 * np.arange(1000)
    rates = np.stack([0.8 * np.sin(0.9 * time), 0.7 * np.cos(0.7 * time), 0.5 + 0.6 * np.sin(0.5 * time)], axis=1)
    turn, turns = Rotation.identity(), []
    for row in rates:
        turns.append(turn)
        turn = turn * Rotation.from_rotvec(0.02 * row)
    return time, rates, Rotation.concatenate(turns)


def cautions_of(folder, time, rates, **attitude):
    """What is doubted in a log of a gyro and an attitude."""
    from seatrial.logs.read_log import read_log

    columns = {"t": time, "n": np.sin(time), **dict(zip("pqr", rates.T, strict=True)), **attitude}
    path = folder / "log.csv"
    np.savetxt(
        path, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="", fmt="%.9g"
    )
    channels = {
        name: (name, "1" if name.startswith("q_") else "rad" if name in attitude else "rad/s") for name in columns
    }
    record = read_log(
        path,
        {name: one for name, one in channels.items() if name != "t"},
        ["n"],
        time=("t", "s"),
        between={"n": "line"},
    )
    return record.provenance.options["cautions"]


@pytest.mark.parametrize("gravity", [1.0, 0.0])
def test_an_accelerometer_in_units_of_gravity_or_without_it_is_refused(tmp_path, gravity):
    from seatrial.logs.read_log import read_log

    time = 0.1 * np.arange(50)
    noise = 0.01 * np.random.default_rng(0).normal(size=(50, 3))
    np.savetxt(
        tmp_path / "log.csv",
        np.column_stack([time, np.sin(time), noise - [0, 0, gravity]]),
        delimiter=",",
        header="t,n,ax,ay,az",
        comments="",
    )
    channels = {"n": ("n", "rad/s"), **{f"a_{axis}": (f"a{axis}", "m/s^2") for axis in "xyz"}}
    with pytest.raises(InputError, match=r"(?s)a_x, a_y, a_z.*units of gravity"):
        read_log(tmp_path / "log.csv", channels, ["n"], time=("t", "s"), between={"n": "line"})


def test_topics_of_one_bag_are_told_apart():
    from decimal import Decimal

    from seatrial.logs.body_frame import doubts_of_gyro
    from seatrial.logs.source import LogTable

    time, rates, turns = turned()
    psi, theta, phi = turns.as_euler("ZYX").T

    def topic(name, **columns):
        return LogTable(time, Decimal(0), columns, (), "pool", "", {"table": name})

    said = doubts_of_gyro(
        [topic("/imu", **dict(zip("pqr", 2.0 * rates.T, strict=True))), topic("/pose", phi=phi, theta=theta, psi=psi)]
    )
    assert len(said) == 3
    assert said[0].startswith('channel "p" of /imu of pool: the attitude of /pose of pool turns as if')
