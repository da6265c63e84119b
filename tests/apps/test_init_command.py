"""Beginning a campaign by options or by answers: what is written loads, says what was said, and what cannot be is told by its option."""

import re
import shlex

import pytest
from typer.testing import CliRunner

from seatrial.apps.cli import app
from seatrial.apps.commands import init as asked
from seatrial.apps.running import Exit
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.new_campaign import (
    read_control,
    read_inertia,
    read_limit,
    read_moves,
    read_sensor,
    read_sought,
)
from seatrial.core.errors import InputError
from seatrial.design.motion_limits import MotionLimit
from tests.apps.test_cli import run

OWN = (
    "--mass '45 kg' --known 'X_udot -1.5' --thrust-deduction '10 %' --seek 'X_uabsu -8 to -2 kg/m' "
    "--seek 'T_nabsn 0.02 to 0.06 N/(rev/s)^2' --optional 'X_u -5 to 0' --speed '1.5 m/s' "
    "--control 'n 1000 rpm, 500 to 1500 rpm, 600 rpm/s' --sensor 'u 0.02 m/s, 5 Hz' --limit 'distance below 200 m' "
    "--limit 'u above 0.4 m/s' --goal 'X_uabsu 5 %' --duration '90 s' --name 'otter, first day'"
)


def changed(old, new):
    assert old in OWN
    return shlex.split(OWN.replace(old, new))


def test_what_was_said_is_in_the_campaign(monkeypatch, capsys, tmp_path):
    code, out, _ = run(monkeypatch, capsys, "init", tmp_path / "boat", *shlex.split(OWN))
    assert code in (Exit.OK, None)
    assert "seatrial prior" in out
    assert "read T_nabsn: 0.02 to 0.06 N/(rev/s)^2" in out
    assert "read X_u: -5 to 0 kg/s (SI, as no unit was given)" in out
    made = load_campaign(tmp_path / "boat")
    assert (made.name, made.full.terms) == ("otter, first day", ("X_uabsu", "T_nabsn", "X_u"))
    assert not made.has_records
    rev = 2 * 3.141592653589793
    thrust = made.prior("T_nabsn")
    assert (thrust.lower, thrust.upper) == pytest.approx((0.02 / rev**2, 0.06 / rev**2))
    assert made.limits.lower == pytest.approx(500 / 60 * rev)
    assert made.limits.rate == pytest.approx(600 / 60 * rev)
    assert MotionLimit("distance", upper=200.0) in made.motion_limits
    assert (made.sensors["u"].noise, made.sensors["u"].rate) == (0.02, 5.0)
    assert made.goal.shares == {"X_uabsu": 0.05}
    amplitude, period = made.design.grid()
    assert amplitude[[0, -1]] == pytest.approx([125 / 60 * rev, 375 / 60 * rev])
    assert (made.family.duration, made.family.active, period[0]) == (90.0, 67.5, 6.0)
    assert made.family.ramp >= 2 * amplitude[-1] / made.limits.rate


def test_a_published_vehicle_brings_its_priors_and_trim(monkeypatch, capsys, tmp_path):
    yaw = "--vehicle remus100_hall_anstee --moves u,v,r --seek Y_uv --seek Y_uudelta_r --seek N_uv --seek N_uudelta_r"
    rudder = "--speed '1.54 m/s' --control 'delta_r 0 deg, -15 to 15 deg' --control 'n 1194 rpm' --sensor 'r 0.3 deg/s'"
    run(monkeypatch, capsys, "init", tmp_path / "yaw", *shlex.split(f"{yaw} {rudder}"))
    made = load_campaign(tmp_path / "yaw")
    assert made.prior("N_uv").sd == pytest.approx(0.3 * abs(made.vehicle.published["N_uv"]))
    surge = "--vehicle remus100_surge --seek X_uabsu --seek T_nabsn --control 'n 1194 rpm, 600 to 1500 rpm'"
    run(monkeypatch, capsys, "init", tmp_path / "surge", *shlex.split(f"{surge} --sensor 'u 0.05 m/s'"))
    made = load_campaign(tmp_path / "surge")
    assert made.family.trim == pytest.approx(1194 / 30 * 3.141592653589793)


@pytest.mark.parametrize(
    "vehicle",
    [
        "--mass '30 kg' --seek 'Z_wabsw -60 to -10' --known 'Z_tau_Z 1' --control 'tau_Z 0 N, -20 to 20 N'",
        "--vehicle bluerov2_heavy --seek Z_wabsw --control 'f_5 0 N, -20 to 20 N'",
    ],
)
def test_a_depth_that_is_measured_is_simulated(monkeypatch, capsys, tmp_path, vehicle):
    said = shlex.split(f"{vehicle} --moves w --sensor 'z 0.01 m, 5 Hz'")
    code, out, err = run(monkeypatch, capsys, "init", tmp_path / "heave", *said)
    assert code in (Exit.OK, None), out + err
    made = load_campaign(tmp_path / "heave")
    assert made.model(made.full).states == ("w", "z")


def test_every_control_keeps_the_range_that_was_said(monkeypatch, capsys, tmp_path):
    more = (
        "--known 'X_tau_X 1' --moves u,r --inertia '1, 5, 5 kg m^2' --seek 'N_ur -9 to 0' --seek 'N_uudelta_r -9 to 0'"
    )
    controls = "--control 'tau_X 15 N, 2 to 26 N' --control 'delta_r 0 rad, -0.35 to 0.35 rad, 0.5 rad/s'"
    words = [
        "--mass",
        "30 kg",
        "--seek",
        "X_uabsu -9 to -1",
        *shlex.split(more),
        *shlex.split(controls),
        "--speed",
        "1.5 m/s",
    ]
    run(monkeypatch, capsys, "init", tmp_path / "boat", *words, "--sensor", "u 0.02 m/s", "--sensor", "r 0.5 deg/s")
    limits = load_campaign(tmp_path / "boat").control_limits
    assert (limits["tau_X"].lower, limits["tau_X"].upper) == (2.0, 26.0)
    assert (limits["delta_r"].lower, limits["delta_r"].upper, limits["delta_r"].rate) == (-0.35, 0.35, 0.5)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("--mass '45 kg'", "", "--vehicle, --mass[^$]*neither"),
        ("-8 to -2 kg/m", "-8 to -2 kg/s", "--seek[^$]*unit like"),
        ("-8 to -2 kg/m", "-2 to -8 kg/m", "--seek[^$]*lower number first"),
        ("-8 to -2 kg/m", "about 5", "--seek[^$]*a range such as"),
        ("'n 1000 rpm, 500", "'n 1600 rpm, 500", "--control[^$]*trim inside the range"),
        ("'n 1000 rpm, 500 to 1500 rpm, 600 rpm/s'", "'n 1000 rpm'", "--control n[^$]*a trim without a range"),
        ("'n 1000 rpm, 500 to 1500 rpm, 600 rpm/s'", "'f_1 0 N, -9 to 9 N'", "--control f_1[^$]*vehicle.thrusters"),
        ("'n 1000 rpm, 500 to 1500 rpm, 600 rpm/s'", "'u 1 m/s, 0 to 2 m/s'", "--control[^$]*a control: n, delta_r"),
        (
            "'n 1000 rpm, 500 to 1500 rpm, 600 rpm/s'",
            "'tau_X 0 N, -9 to 9 N'",
            '--control tau_X\n[^$]*--known "X_tau_X 1"',
        ),
        ("u 0.02 m/s", "u 0.02 kg", "--sensor"),
        ("distance below 200 m", "distanz below 200 m", "--limit[^$]*a signal or control"),
        ("X_uabsu 5 %", "X_uabsu 0 %", "--goal[^$]*more than 0"),
        ("--mass '45 kg'", "--mass '45 kg' --template design", "--template design[^$]*--mass"),
        ("'u 0.02 m/s, 5 Hz'", "'v 0.02 m/s, 5 Hz'", "--sensor v\n[^$]*one of u, udot"),
        ("--speed '1.5 m/s'", "", '--speed\n[^$]*remedy: +for example --speed "1.5 m/s"\n'),
        ("--thrust-deduction '10 %'", "--moves u,r", "--inertia\n[^$]*no I_zz"),
        ("--thrust-deduction '10 %'", "--moves u,x", "--moves\n"),
        ("X_uabsu 5 %", "X_w 5 %", "--goal X_w\n"),
        ("distance below 200 m", "p below 2 rad/s", "--limit p\n"),
        ("distance below 200 m", "n below 2000 rpm", "--limit n\n[^$]*beside --control n"),
        ("X_u -5 to 0", "X_uabsu -5 to 0", "--optional X_uabsu\n[^$]*again, beside --seek X_uabsu"),
        ("'90 s'", "'0.1 s'", "--duration\n"),
    ],
)
def test_what_cannot_be_is_told_by_its_option(monkeypatch, capsys, tmp_path, old, new, said):
    code, _, err = run(monkeypatch, capsys, "init", tmp_path / "boat", *changed(old, new))
    assert code == Exit.BAD_INPUT
    assert re.search(said, err), err
    assert "campaign.toml" not in err
    assert not (tmp_path / "boat").exists()


def answered(folder, *lines):
    return CliRunner().invoke(app, ["init", str(folder)], input="\n".join(lines) + "\n")


def test_in_a_terminal_it_asks_and_asks_again(monkeypatch, tmp_path):
    monkeypatch.setattr(asked, "_is_terminal", lambda: True)
    body = ("own", "45 pounds", "45 kg", "X_udot -2.5", "u", "1.5 m/s", "X_udot -1.5", "", "0.1")
    sought = ("X_uabsu -8 to -2 kg/m", "X_uabsu", "T_nabsn 0.02 to 0.06 N/(rev/s)^2", "", "")
    rest = (
        "n 1000 rpm, 500 to 1500 rpm, 600 rpm/s",
        "",
        "u 0.02 m/s, 5 Hz",
        "",
        "",
        "60 s",
        "X_uu 5 %",
        "X_uabsu 5 %",
        "",
        "otter",
    )
    said = answered(tmp_path / "boat", *body, *sought, *rest)
    assert said.exit_code == 0, said.output
    assert 'unknown unit "pounds"' in said.output
    assert "velocities of the model, parted by commas: some of u, v, w, p, q, r" in said.output
    assert "X_uu, which is not sought" in said.output
    assert "a range such as" in said.output
    made = load_campaign(tmp_path / "boat")
    assert (made.name, made.hull.mass) == ("otter", 45.0)
    again = next(line for line in said.output.splitlines() if line.strip().startswith("seatrial init"))
    words = [word.replace(str(tmp_path / "boat"), str(tmp_path / "again")) for word in shlex.split(again)[1:]]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert (tmp_path / "again" / "campaign.toml").read_text() == (tmp_path / "boat" / "campaign.toml").read_text()


def test_velocities_and_inertias_are_read_as_they_are_asked_for():
    assert read_moves("u, v,r", "--moves") == ("u", "v", "r")
    assert read_inertia("0.2, 3.4, 3.4 kg m^2", "--inertia") == ("0.2 kg m^2", "3.4 kg m^2", "3.4 kg m^2")
    for read, text, said in (
        (read_moves, "u v", '"u v"'),
        (read_moves, ",", "velocities of the model"),
        (read_inertia, "0.2, 3.4 kg m^2", "three moments of inertia"),
        (read_inertia, "0.2, 3.4, 3.4 kg", "kg m"),
    ):
        with pytest.raises(InputError, match=said):
            read(text, "--it")


def test_in_a_terminal_a_template_is_one_answer(monkeypatch, tmp_path):
    monkeypatch.setattr(asked, "_is_terminal", lambda: True)
    said = answered(tmp_path / "boat", "steering")
    assert said.exit_code == 0, said.output
    assert "wrote" in said.output


def test_lines_are_read_as_they_are_spoken():
    assert read_control("delta_r 0 deg", "--control").lower == ""
    assert read_sought("X_u -3 to 0", "--seek").unit == ""
    assert read_limit("q -5 to 5 deg/s", "--limit").upper == "5 deg/s"
    assert read_sensor("psi 1 deg", "--sensor").rate == ""
    with pytest.raises(InputError, match="with decimal points"):
        read_sensor("u 0,05 m/s, 5 Hz", "--sensor")
