"""The command that judges records before anything is fitted to them; what it expects is made by Euler steps here."""

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.check import check_records, record_doubts, step_cautions
from seatrial.campaign.data.import_logs import get_trials
from seatrial.cli.main import app
from seatrial.core.errors import NumericalError
from tests.campaigns import MEASURED, joined, normal, priors, sensors

CAMPAIGN = joined(
    """[campaign]
name = "check"
seed = 1

[vehicle]
mass = "30 kg"

[structure]
always = ["X_tau_X", "X_uabsu"]
""",
    priors(X_tau_X=normal(1.0, 0.2), X_uabsu=normal(-6.0, 3.0)),
    sensors(u="0.02 m/s"),
    """[design]
control = "tau_X"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = { from = "5 N", to = "10 N", points = 2 }
period = { from = "5 s", to = "10 s", points = 2 }

[import]
fit = ["one"]

[[import.files]]
path = "{run}.csv"
time = { column = "t", unit = "s" }

[import.files.channels]
tau_X = { column = "force", unit = "N" }
u = { column = "speed", unit = "m/s", scale = SCALE }
""",
    MEASURED,
)


MUTE = CAMPAIGN.replace("mean = 1.0\nsd = 0.2", "mean = 0.0\nsd = 3.0").replace(
    "mean = -6.0\nsd = 3.0", "mean = 0.0\nsd = 20.0"
)
"""Priors that do not say which way a force drives: at their means nothing moves."""
FORCE = np.where(np.arange(400) < 150, 10.0, np.where(np.arange(400) < 300, -10.0, 0.0))
NOISE = 0.02


def speed(gain=1.0, drag=-6.0, constant=0.0):
    """Speed of a 30 kg vehicle by Euler steps, under a slow doublet."""
    u, found = 0.0, []
    for force in FORCE:
        found.append(u)
        for _ in range(10):
            u += 0.01 * (gain * force + drag * u * abs(u) + constant) / 30.0
    return np.array(found)


def write(folder, scale="1.0", text=CAMPAIGN):
    """A vehicle of the prior means of `CAMPAIGN`, with noise."""
    folder.mkdir()
    (folder / "campaign.toml").write_text(text.replace("SCALE", scale))
    shown = speed() + NOISE * np.random.default_rng(3).normal(size=FORCE.size)
    rows = zip(0.1 * np.arange(FORCE.size), FORCE, shown, strict=True)
    with (folder / "one.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("t", "force", "speed"), *rows])


@pytest.mark.parametrize(
    ("scale", "code", "told"),
    [("1.0", 0, "record one: pass"), ("-1.0", 3, "set scale = -1"), ("3.28084", 0, "feet taken for metres")],
)
def test_the_sign_and_the_unit_of_a_channel(tmp_path, scale, code, told):
    write(tmp_path / "a", scale)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"])
    assert result.exit_code == code, result.output
    assert told in result.output
    assert (
        result.output.splitlines()[-1]
        == {
            "1.0": "in all 0 alarms, 0 cautions: continue with `estimate`",
            "-1.0": "in all 1 alarm, 0 cautions: correct each alarm before you estimate",
            "3.28084": "in all 0 alarms, 1 caution: look at each caution, then continue with `estimate`",
        }[scale]
    )
    assert (tmp_path / "a" / "check-one.svg").read_text().endswith("</svg>\n")


def test_accepted_finding_is_one_line_and_no_alarm(tmp_path):
    write(tmp_path / "a", "-1.0", CAMPAIGN + '\n[checks]\naccept = ["direction-reversed"]\n')
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet", "--json"])
    document = json.loads(result.stdout)
    assert (result.exit_code, document["alarms"], document["cautions"]) == (0, [], [])
    (found,) = [one for one in document["result"]["records"][0]["findings"] if one["code"] == "direction-reversed"]
    assert (found["level"], found["remedy"]) == ("note", "")
    assert found["message"].startswith("accepted: u moves against the expected motion")


def test_a_start_from_rest_is_noted_by_check_alone(tmp_path):
    """The force of the record is never below rest, and its limits begin at 5 N."""
    write(tmp_path / "a", "1.0", CAMPAIGN + '\n[limits.tau_X]\nlower = "5 N"\nupper = "12 N"\n')
    log = tmp_path / "a" / "one.csv"
    log.write_text(log.read_text().replace(",-10.0,", ",0.0,"))
    campaign = load_campaign(tmp_path / "a")
    (record,) = get_trials(campaign).fit
    (judged,) = check_records(campaign, get_trials(campaign))
    (found,) = [one for one in judged.findings if one.code == "limits-exceeded"]
    assert found.level == "note"
    assert record_doubts(campaign, record) == []


@pytest.mark.parametrize(
    ("column", "unit", "scale", "remedy"),
    [
        ("SOG_kn", "m/s", 1.0, 'unit = "kn"'),
        ("SOG_kn", "m/s", 0.514444, ""),
        ("SOG_kn", "kn", 1.02, ""),
        ("speed [cm/s]", "m/s", 1.0, 'unit = "cm/s"'),
        ("SOG", "m/s", 1.0, ""),
    ],
)
def test_the_unit_that_the_name_of_a_column_states(tmp_path, column, unit, scale, remedy):
    """A factor of 1.94 alone is within what the priors allow; a remedy that is followed leaves no caution."""
    text = CAMPAIGN.replace('column = "speed", unit = "m/s"', f'column = "{column}", unit = "{unit}"')
    write(tmp_path / "a", str(scale), text)
    log, campaign = tmp_path / "a" / "one.csv", tmp_path / "a" / "campaign.toml"
    log.write_text(log.read_text().replace("force,speed", f"force,{column}"))

    def told():
        loaded = load_campaign(tmp_path / "a")
        return [text for text in record_doubts(loaded, get_trials(loaded).fit[0]) if "the unit of column" in text]

    assert [f"set {remedy} there" in text for text in told()] == ([True] if remedy else [])
    campaign.write_text(campaign.read_text().replace(f'unit = "{unit}"', remedy or f'unit = "{unit}"'))
    assert told() == []


def feedback(seed):
    """Commands that a controller computes from the measured speed, which a random walk of force drives; both are logged at once."""
    random, u, rows = np.random.default_rng(seed), 0.5, []
    push = np.cumsum(0.6 * random.normal(size=600))
    for k in range(600):
        shown = u + NOISE * random.normal()
        force = np.clip(40.0 * (0.5 - shown), -15.0, 15.0)
        rows.append((0.1 * k, force, shown))
        for _ in range(10):
            u += 0.01 * (force - 6.0 * u * abs(u) + push[k]) / 30.0
    return rows


def test_commands_that_are_computed_from_the_motion_cast_no_doubt_on_signs(tmp_path):
    """By their correlation of -1 the sign would be reversed."""
    write(tmp_path / "a")
    rows = feedback(0)
    assert np.corrcoef(np.array(rows)[:, 1:].T)[0, 1] < -0.999
    with (tmp_path / "a" / "one.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("t", "force", "speed"), *rows])
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"])
    assert result.exit_code == 0, result.output
    assert "note    tau_X is computed from u" in result.output
    assert "note    u moves against the expected motion (correlation -0." in result.output
    assert "not judged, because tau_X is computed from measured channels" in result.output
    assert "scale = -1" not in result.output
    assert "before its command" not in result.output
    assert "changes at nearly every sample" not in result.output
    assert 'write between = "held", not "line"' in result.output


@pytest.mark.parametrize(
    ("shift", "told"),
    [
        (0.0, "timing (within "),
        (3.0, "correct `shift` of speed.csv under [[import.files]], which is too small by about "),
    ],
)
def test_clock_shift_between_files_is_reported(tmp_path, shift, told):
    """The speed is in a file of its own, whose stamps are too small by `shift`."""
    one = CAMPAIGN.replace(
        "u = {",
        """
[[import.files]]
path = "speed.csv"
time = { column = "t", unit = "s" }
channels.u = {""",
    )
    write(tmp_path / "a", "1.0", one)
    lines = (tmp_path / "a" / "one.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    text = "".join(f"{float(t) - shift:.1f},{u}\n" for t, _, u in rows)
    (tmp_path / "a" / "speed.csv").write_text("t,speed\n" + text)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"])
    assert result.exit_code == 0, result.output
    assert told in result.output


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "SCALE",
            "1.94",
            "u with the controls at trim is about 2.398 m/s, but the stated trim is 1.2 m/s",
        ),
        (
            'unit = "N"',
            'unit = "lbf"',
            "tau_X is about 44.48 N, but the stated trim is 10 N",
        ),
        ('unit = "s"', 'unit = "ms"', 'has a row every 0.0001 s with the unit "ms", where'),
        ("SCALE", "5.0", "see the finding about its trim, which shows the unit better"),
    ],
)
def test_a_record_that_contradicts_the_trim_or_any_clock(tmp_path, old, new, told):
    """The unit error is within what the priors allow; 10 N hold (10/6)^(1/2) = 1.29 m/s less what is still missing after 15 s."""
    text = CAMPAIGN.replace('mass = "30 kg"', 'mass = "30 kg"\ntrim = { u = "1.2 m/s", tau_X = "10 N" }')
    write(tmp_path / "a", text=text.replace(old, new))
    assert told in CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"]).output


def test_empty_cells_are_told_with_what_is_done_with_them(tmp_path):
    """Once for a record that is cut into pieces."""
    write(tmp_path / "a", "1.0", CAMPAIGN.replace('fit = ["one"]', 'fit = ["one"]\nsplit = "20 s"'))
    log = tmp_path / "a" / "one.csv"
    lines = [line.split(",") for line in log.read_text().splitlines()]
    for row, cell in ((5, "nan"), (6, ""), (300, "NaN")):
        lines[row][2] = cell
    lines[7][1] = ""
    log.write_text("\n".join(map(",".join, lines)) + "\n")
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"])
    assert result.exit_code == 0, result.output
    said = [line.split("note    ")[1] for line in result.output.splitlines() if "empty or NaN" in line]
    assert said == [
        '1 of 400 rows of one.csv, column "force", are empty or NaN; each holds the value before it',
        '3 of 400 rows of one.csv, column "speed", are empty or NaN; the other rows are used',
    ]


@pytest.mark.parametrize("scale", ["1.0", "-1.0"])
def test_priors_that_say_neither_way_cast_no_doubt_on_a_record(tmp_path, scale):
    write(tmp_path / "a", scale, MUTE)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"])
    assert result.exit_code == 0, result.output
    assert "record one: pass" in result.output
    assert "note    direction, size and timing of u are not judged" in result.output
    assert "  caution" not in result.output


def test_what_a_record_can_tell_under_priors_that_say_neither_way(tmp_path):
    sd = {"X_tau_X": 3.0, "X_uabsu": 20.0, "X_0": 0.01}
    text = (
        MUTE.replace('"X_uabsu"]', '"X_uabsu", "X_0"]')
        + '[prior.X_0]\ndistribution = "normal"\nmean = 0.0\nsd = 0.01\n'
    )
    write(tmp_path / "a", "1.0", text)
    campaign = load_campaign(tmp_path / "a")
    trials = get_trials(campaign)
    (judged,) = check_records(campaign, trials)
    found = {finding.subject[0]: finding for finding in judged.findings if finding.code == "not-excited"}

    truth, step = np.array([1.0, -6.0, 0.0]), 1e-4 * np.eye(3)
    slopes = np.array([(speed(*(truth + one)) - speed(*(truth - one))) / 2e-4 / NOISE for one in step])
    before = np.array([sd[name] for name in found])
    left = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T + np.diag(before**-2)))) / before
    assert [finding.level for finding in found.values()] == ["pass", "pass", "caution"]
    for finding, share in zip(found.values(), left, strict=True):
        assert finding.values["about"] == "fit"
        assert finding.values["remaining"] == pytest.approx(share, abs=0.006)


def test_excitation_of_a_whole_vehicle_under_priors_that_say_neither_way(tmp_path):
    write(tmp_path / "a", "1.0", MUTE.replace('mass = "30 kg"', 'mass = "30 kg"\nmoves = ["u"]'))
    result = CliRunner().invoke(app, ["check", str(tmp_path / "a"), "--quiet"])
    assert result.exit_code == 0, result.output
    assert "excitation (at a fit of the measured motion)" in result.output
    assert "record one: pass" in result.output


def test_a_control_beyond_its_limit_is_told_with_both_numbers(tmp_path):
    """The force goes from -10 N to 10 N; a hundredth of that beyond a limit is none."""
    for name, bounds in (("far", 'upper = "8 N"\nlower = "-10 N"'), ("near", 'upper = "9.9 N"\nlower = "-12 N"')):
        write(tmp_path / name, "1.0", f"{CAMPAIGN}\n[limits.tau_X]\n{bounds}\n")
        campaign = load_campaign(tmp_path / name)
        (judged,) = check_records(campaign, get_trials(campaign))
        found = [finding for finding in judged.findings if finding.code == "limits-exceeded"]
        assert len(found) == (name == "far")
        assert all((one.values["reached"], one.values["bound"], one.values["end"]) == (10, 8, "upper") for one in found)


@pytest.mark.parametrize(("mass", "differs"), [("30 kg", None), ("0.5 kg", 36.0), ("0.25 kg", 0.0)])
def test_steps_that_are_too_long_for_a_quick_vehicle_are_reported(tmp_path, mass, differs):
    """Naive Runge-Kutta steps of this vehicle in 0.1 s and 0.05 s differ by 4e-6, by 36 and by no end, over the noise."""
    write(tmp_path / "a", "1.0", CAMPAIGN.replace("30 kg", mass))
    campaign = load_campaign(tmp_path / "a")
    (judged,) = check_records(campaign, get_trials(campaign))
    found = [finding for finding in judged.findings if finding.code == "steps-too-coarse"]
    assert [finding.subject for finding in found] == ([] if differs is None else [("u",)])
    for finding in found:
        assert finding.values["differs"] == pytest.approx(differs, abs=4.0)
        assert finding.values["shorter"] == pytest.approx(0.025)
    assert step_cautions(campaign, get_trials(campaign)) == [finding.among(run="one") for finding in found]


def test_estimate_says_that_steps_are_too_long_before_it_fits_anything(tmp_path, monkeypatch):
    write(tmp_path / "a", "1.0", CAMPAIGN.replace("30 kg", "0.5 kg"))

    def fit(*given, **near):
        raise NumericalError("here the fit begins")

    monkeypatch.setattr("seatrial.campaign.inference.modes.find_mode", fit)
    for by in ("mode", "chains"):
        result = CliRunner().invoke(app, ["estimate", str(tmp_path / "a"), "--by", by, "--quiet"])
        before, _, _ = f"{result.output}{result.exception}".partition("here the fit begins")
        assert before.count("caution: run one: the steps of 0.1 s are too long") == 1
        assert "here the fit begins" in f"{result.output}{result.exception}"
