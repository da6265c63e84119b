"""What `check` says first of an ROV with two thrusters whose log is mapped wrongly; the log is made by Euler steps here."""

import math

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.check import check_records, summary_line
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.prior.cautions import doubtful_radii
from seatrial.cli.main import app
from seatrial.core.errors import InputError
from seatrial.messages.render import statement
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names
from seatrial.vehicles.hull import whole_hull
from tests.campaigns import MEASURED, import_log, joined, priors, sensors, small_design, uniform, write_campaign

CAMPAIGN = joined(
    """[campaign]
name = "two thrusters"
seed = 1

[vehicle]
mass = "14.5 kg"
inertia = ["0.3 kg m^2", "0.4 kg m^2", "0.42 kg m^2"]
moves = ["u", "r"]

[[vehicle.thrusters]]
place = ["-0.2 m", "-0.15 m", "0 m"]
direction = [1, 0, 0]

[[vehicle.thrusters]]
place = ["-0.2 m", "0.15 m", "0 m"]
direction = [1, 0, 0]

[structure]
always = ["X_u", "X_uabsu", "N_r", "N_rabsr"]
""",
    priors(X_u=uniform(-20.0, 0.0), X_uabsu=uniform(-60.0, 0.0), N_r=uniform(-3.0, 0.0), N_rabsr=uniform(-3.0, 0.0)),
    sensors(u="0.01 m/s", r="0.01 rad/s"),
    MEASURED,
    small_design("f_1", "5 N", "10 N"),
    import_log("log", "log.csv", f_1=("port", "N"), f_2=("starboard", "N"), u=("u", "m/s"), r=("r", "rad/s")),
)
SENSOR = '[sensors.r]\nnoise = "0.01 rad/s"\n'


def write(folder, *changes, late=0):
    """The campaign, and the log of a vehicle that it describes; its motion late by so many rows of 0.1 s."""
    rng = np.random.default_rng(2)
    port, starboard = np.repeat(rng.choice([-4.0, 0.0, 4.0, 8.0], (2, 40)), 20, axis=1)
    u = r = 0.0
    motion = []
    for left, right in zip(port, starboard, strict=True):
        motion.append((u, r))
        for _ in range(10):
            u += 0.01 * (left + right - 4.0 * u - 12.0 * u * abs(u)) / 14.5
            r += 0.01 * (0.15 * (left - right) - 0.3 * r - 0.6 * r * abs(r)) / 0.42
    shown = np.roll(np.array(motion), late, axis=0) + 0.01 * rng.normal(size=(len(motion), 2))
    columns = np.column_stack([0.1 * np.arange(len(port)), port, starboard, shown])
    np.savetxt(folder / "log.csv", columns, delimiter=",", header="t,port,starboard,u,r", comments="", fmt="%.8g")
    write_campaign(folder, CAMPAIGN, *changes)


def judged(folder, *changes, late=0):
    write(folder, *changes, late=late)
    campaign = load_campaign(folder)
    return check_records(campaign, get_trials(campaign))


SWAPPED = (('"port"', '"x"'), ('"starboard"', '"port"'), ('"x"', '"starboard"'))
REVERSED = (('"u", unit = "m/s"', '"u", unit = "m/s", scale = -1.0'),)
DEGREES = (('"r", unit = "rad/s"', '"r", unit = "rad/s", scale = 57.29578'),)


def test_a_log_that_is_mapped_right_passes(tmp_path):
    (found,) = judged(tmp_path)
    assert found.level == "pass", found.lines()


@pytest.mark.parametrize(
    ("changes", "late", "first", "told"),
    [
        (SWAPPED, 0, ("alarm", "r", "direction"), "check the order of the thruster columns f_1 and f_2"),
        (REVERSED, 0, ("alarm", "u", "direction"), "set scale = -1 for u or its command"),
        (DEGREES, 0, ("alarm", "r", "size"), "degrees taken for radians in r, or the reverse?"),
        ((), -15, ("caution", "u", "timing"), "put command and response on one clock"),
    ],
    ids=["port and starboard swapped", "u reversed", "degrees taken for radians", "a clock that is off"],
)
def test_the_cause_is_named_first_and_no_thruster_is_accused(tmp_path, changes, late, first, told):
    (found,) = judged(tmp_path, *changes, late=late)
    line, remedy = found.lines()[1:3]
    assert line.split()[:2] == [*first[:2]]
    assert told in remedy
    later = [one for one in found.findings if one.code == "not-judged-yet"]
    thrusters = next(one for one in later if one.values["check"] == "thruster-gain")
    assert (thrusters.subject, thrusters.level) == (("f_1", "f_2"), "note")
    assert f"the {first[2]} of " in statement(thrusters)
    assert not any(one.code == "rate-not-measured" for one in found.findings)
    failed = first[0] == "alarm"
    assert ("correct each alarm" in summary_line([found])) == failed
    assert any(one.values["check"] == "not-excited" for one in later) == failed


def test_a_single_thruster_that_is_turned_round_is_still_told_first(tmp_path):
    (found,) = judged(tmp_path, ('"starboard", unit = "N"', '"starboard", unit = "N", scale = -1.0'))
    assert found.lines()[1].split()[:2] == ["alarm", "f_2"]
    assert "reverse its direction" in found.lines()[2]


def test_a_rate_without_a_sensor_is_told_by_import_and_its_coefficients_in_one_line(tmp_path):
    write(tmp_path, (SENSOR, ""))
    told = "r is mapped but has no [sensors.r], so it is not used"
    imported = CliRunner().invoke(app, ["import", str(tmp_path), "--quiet"])
    assert imported.exit_code == 0, imported.output
    assert imported.output.count(told) == 1
    checked = CliRunner().invoke(app, ["check", str(tmp_path), "--quiet"])
    assert told in checked.output
    (line,) = [line for line in checked.output.splitlines() if "cannot determine" in line]
    assert line.split()[0] == "caution"
    assert "N_r and N_rabsr, because no sensor measures r" in line


MASS = '"14.5 kg"'


@pytest.mark.parametrize("written", ["-14.5 kg", "0 kg"])
def test_a_mass_that_is_not_positive_is_told_with_its_key_and_line(tmp_path, written):
    write(tmp_path, (MASS, f'"{written}"'))
    with pytest.raises(InputError) as caught:
        load_campaign(tmp_path)
    line = CAMPAIGN.splitlines().index(f"mass = {MASS}") + 1
    assert caught.value.where == f"{tmp_path / 'campaign.toml'}:{line}, key vehicle.mass"
    assert (caught.value.found, caught.value.expected) == (written, "a number above zero")


def test_a_mass_in_grams_makes_a_radius_of_gyration_that_no_vehicle_has(tmp_path):
    """sqrt(0.42 / 0.0145) = 5.38 m; the thrusters are sqrt(0.2^2 + 0.15^2) = 0.25 m from the origin."""
    write(tmp_path, (MASS, '"14.5 g"'))
    output = CliRunner().invoke(app, ["check", str(tmp_path), "--quiet"]).output
    (line,) = [line for line in output.splitlines() if "I_zz" in line]
    assert (
        "a radius of gyration of 5.38 m, and the most distant thruster is 0.25 m from the origin: 0.02 m to 2.5 m is expected"
        in line
    )
    write(tmp_path)
    assert "radius of gyration" not in CliRunner().invoke(app, ["check", str(tmp_path), "--quiet"]).output


@pytest.mark.parametrize("name", vehicle_names())
def test_no_published_vehicle_has_a_doubtful_radius_of_gyration(name):
    vehicle = load_vehicle(name)
    reach = max((math.hypot(*one.place) for one in vehicle.thrusters), default=0.0)
    assert doubtful_radii(vehicle.hull, reach) == []


def test_the_size_of_a_body_is_told_without_thrusters():
    def body(mass):
        return whole_hull("body", mass, (None, None, 0.42))

    assert doubtful_radii(body(14.5)) == []
    (line,) = doubtful_radii(body(14500.0))
    assert "a radius of gyration of 0.00538 m: 0.02 m to 120 m is expected" in line


def test_files_without_a_common_time_are_told_with_the_unit_that_is_doubted(tmp_path):
    """The commands in a file of their own, whose stamps of seconds are read as milliseconds."""
    files = (
        "channels.u = { column",
        '\n[[import.files]]\npath = "motion.csv"\ntime = { column = "t", unit = "s" }\nchannels.u = { column',
    )
    write(tmp_path, ('time = { column = "t", unit = "s" }\n', 'time = { column = "t", unit = "ms" }\n'), files)
    log = tmp_path / "log.csv"
    header, *rows = log.read_text().splitlines()
    log.write_text(
        "\n".join([header, *(f"{1762250000 + 0.1 * at:.1f},{row.split(',', 1)[1]}" for at, row in enumerate(rows))])
    )
    (tmp_path / "motion.csv").write_text(log.read_text())
    campaign = load_campaign(tmp_path)
    with pytest.raises(InputError) as caught:
        get_trials(campaign)
    line = CAMPAIGN.splitlines().index("[import]") + 1
    assert caught.value.where == f"{campaign.path}:{line}, key import: log.csv, motion.csv"
    assert "u of motion.csv: 1760487750 s to 1760487829.9 s" in caught.value.found  # 1762250000 s less 1762250 s
    assert caught.value.remedy.startswith(
        'correct the unit of time first: log.csv has a row every 0.0001 s with the unit "ms"'
    )
    assert 'is it "s"? Then it would be one every 0.1 s' in caught.value.remedy
