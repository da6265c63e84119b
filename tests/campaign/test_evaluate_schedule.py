"""A schedule of one's own, and every other kind of trial, through the loop: weighed, run, imported, estimated, and taken up by the next."""

import json

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.named_files import folders_outside
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.simulate import Scheduled, add_trial, ask_for, record_keys
from seatrial.campaign.design.schedule import find_schedules, write_schedule
from seatrial.campaign.design.searches import (
    evaluate_own_schedule,
    evaluate_schedule_after,
)
from seatrial.campaign.design.sweep import design_first, design_next_by_mode
from seatrial.campaign.inference.quick_estimates import best_mode, posterior_modes
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.workflow.next_trial import propose_by_mode
from seatrial.cli.running import Exit
from seatrial.core.display_units import shown_as_written
from seatrial.core.errors import InputError
from seatrial.manoeuvres.free_form import SteppedInput
from seatrial.manoeuvres.relay import RelayFamily
from seatrial.manoeuvres.schedule import Schedule
from tests.campaign.small import NO_X_U, write_small
from tests.cli.test_cli import run

RPM = np.pi / 30
MINE = "time_s,n_rpm\n0,1194\n3,1194\n3,1394\n10,1394\n12,1000\n20,1000\n20,1194\n29.9,1194\n"
OWN = ('control = "n"', 'control = "n"\nschedule = "mine.csv"')
TRUTH = {"X_uabsu": -2.93, "T_nabsn": 6.28e-4}
IMPORT = """[import]
fit = ["1"]
schedule = "sent_{run}.csv"

[[import.files]]
path = "log_{run}.csv"
time = { column = "time", unit = "s" }
channels.n = { column = "n", unit = "rpm" }
channels.u = { column = "u", unit = "m/s" }
"""


def campaign(folder, *changes, own=MINE):
    write_small(folder, *NO_X_U, OWN, *changes)
    (folder / "mine.csv").write_text(own)
    return load_campaign(folder)


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (MINE.replace("1394", "1600"), r"mine.csv:4[^$]*1600 rpm at 3 s[^$]*\[limits.n\]"),
        (MINE.replace("n_rpm", "delta_r_deg"), "time and controls of the vehicle"),
        (MINE.replace("n_rpm", "n_m/s"), "unit"),
        (MINE.replace("\n12,", "\n8,"), "8 s after 10 s"),
        (MINE.replace("\n0,", "\n5,"), "a first row at 0 s"),
        ("time_s,n_rpm\n0,1194\n30,1194\n", "a control that moves"),
    ],
)
def test_a_schedule_that_cannot_be_run_is_refused_before_any_work(tmp_path, own, said):
    with pytest.raises(InputError, match=said) as raised:
        campaign(tmp_path, own=own)
    assert "key design.schedule" in raised.value.where


def test_a_schedule_is_found_or_missed_like_every_file(tmp_path):
    made = campaign(tmp_path)
    assert folders_outside(tmp_path / "elsewhere", (), None, [tmp_path / "mine.csv"]) == [str(tmp_path)]
    (tmp_path / "mine.csv").unlink()
    with pytest.raises(InputError, match=r"key design.schedule[^$]*no file"):
        load_campaign(tmp_path)
    assert made.own_schedule.label == "mine"


def test_another_control_keeps_its_own_limits(tmp_path):
    """The rudder is moved by the schedule although the swept designs drive the propeller."""
    from seatrial.campaign.config.templates import init_campaign

    path = init_campaign(tmp_path, "steering")
    path.write_text(
        path.read_text().replace("[limits.u]", '[limits.n]\nlower = "1000 rpm"\nupper = "1300 rpm"\n\n[limits.u]')
    )
    (tmp_path / "mine.csv").write_text(
        "time_s,delta_r_deg,n_rpm\n0,0,1194\n5,0,1194\n6,5,1250\n30,5,1400\n31,0,1194\n60,0,1194\n"
    )
    with pytest.raises(InputError, match=r"mine.csv:\d+[^$]*1400 rpm[^$]*\[limits.n\]"):
        ask_for(_simulated(path), None, tmp_path / "mine.csv")


def _simulated(path):
    text = path.read_text()
    truth = "Y_uv = -28.6\nY_uudelta_r = 9.64\nN_uv = -24.0\nN_ur = -2.0\nN_uudelta_r = -6.15\n"
    path.write_text(f"{text}\n[truth]\n{truth}")
    return load_campaign(path.parent)


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    made = campaign(tmp_path_factory.mktemp("own"))
    return made, design_first(made)


def test_the_best_design_as_ones_own_schedule_is_worth_what_it_is_worth(designed, tmp_path):
    """Read back from its own table; only the last sample is more, which the table ends with."""
    made, found = designed
    store = Store(made.folder)
    again = campaign(tmp_path, own=store.schedule(store.design).read_text())
    before = store.design.read_bytes()
    judged = evaluate_own_schedule(again)
    assert judged.utility == pytest.approx(judged.beside, rel=2e-3)
    np.testing.assert_allclose(judged.sd, judged.sd_beside, rtol=2e-2)
    assert evaluate_own_schedule(made).utility != judged.utility
    index = judged.names.index("T_nabsn")
    per_turn = judged.sd[index] * (2 * np.pi) ** 2
    said = judged.lines(shown_as_written({"T_nabsn": "N/(rev/s)^2"}))[1]
    assert f"T_nabsn ± {per_turn:.2g} N/(rev/s)^2 (" in said
    assert store.design.read_bytes() == before
    assert find_schedules(made.folder)["own"].read_text().startswith("time_s,n_rpm\n0,1194\n")
    assert found.best.best == design_first(again).best.best


def test_it_is_the_first_trial_that_is_run(designed):
    made, _ = designed
    assert list(record_keys(made)) == ["mine"]
    (record,) = get_trials(made).fit
    wanted = np.interp(
        record.time, [0, 2.95, 2.95001, 10, 12, 19.95, 19.95001, 30], [1194, 1194, 1394, 1394, 1000, 1000, 1194, 1194]
    )
    np.testing.assert_allclose(record.channel("n") / RPM, wanted, rtol=1e-6)


@pytest.mark.proof
def test_the_command_says_what_it_is_worth_and_that_it_leaves_the_limits(monkeypatch, capsys, tmp_path):
    limit = ("[limits.n]", '[limits.distance]\nupper = "90 m"\n\n[limits.n]')
    campaign(tmp_path, limit, ("[design]", "[design]\nprobability = 0.5"), own=MINE + "90,1194\n")
    code, out, err = run(monkeypatch, capsys, "design", tmp_path, "--quiet")
    assert code == Exit.ALARMS
    assert "your schedule mine.csv, 90 s:" in out
    assert "by the same measure" in out
    assert "mine.csv may leave the limits of the motion" in err


def kinds(made):
    """Trials of every kind, shorter than they would be designed, each as the product keeps and reads it."""
    store, h, family = Store(made.folder), made.family.sample_time, made.family
    free = SteppedInput("n", family.trim, family.duration, family.start, 20.0, 5, edge=0.0)
    levels = family.trim + 15.0 * np.array([1.0, -1.0, 0.5, -0.5, 1.0])
    write_schedule(store.schedule(store.free_design), free.manoeuvre(levels), h)
    for number, period in enumerate((5.0, 10.0), 1):
        write_schedule(store.batch_schedule(number), family.manoeuvre(20.0, period), h)
    trim = made.control_trim(made.model(made.full))
    relay = RelayFamily(trim, "n", "u", 1.54, duration=family.duration, sample_time=h, start=1.0, active=25.0)
    law = {"family": relay.as_plain(), "amplitude": 20.0, "threshold": 0.1}
    write_schedule(store.schedule(store.relay_design), family.manoeuvre(20.0, 5.0), h, about={"relay": law})
    return {
        "own": ["mine"],
        "free_form": ["free_form"],
        "batch": ["batch_1", "batch_2"],
        "self_oscillation": ["self_oscillation"],
    }


@pytest.mark.parametrize(
    "kind",
    ["own", *(pytest.param(one, marks=pytest.mark.proof) for one in ("free_form", "batch", "self_oscillation"))],
)
def test_every_kind_of_trial_goes_through_the_loop(designed, tmp_path, kind):
    """Simulated, estimated by the mode, and the next one designed from that: it promises less than is not known yet."""
    made = campaign(tmp_path)
    labels = kinds(made)[kind]
    if kind != "own":
        ask_for(made, kind, None, alone=True)
    trials = get_trials(made)
    assert [record.label for record in trials.fit] == labels
    first = best_mode(posterior_modes(made, trials))
    known = {name: pair for name, _, (pair,) in first.rows}
    for name, true in TRUTH.items():
        mean, sd = known[name]
        assert abs(mean - true) < 4 * sd
        assert sd < 0.5 * made.prior(name).sd
    following = design_next_by_mode(made, first.drawn)
    assert following.basis == "the posterior mode of M-0"
    for name, before, after in zip(
        following.names, following.sd_before.values(), following.best.final_sd[following.best.best], strict=True
    ):
        noise = first.drawn.draws([name]).std()  # of which the ± beside the value holds more
        assert after < before == pytest.approx(noise, rel=0.15)
    proposal = propose_by_mode(made, first, following, len(trials.fit))
    assert proposal.trial is not None
    assert "by the posterior mode of M-0" in proposal.lines[0]
    again = evaluate_schedule_after(made, first.drawn, following)
    assert again.utility < evaluate_own_schedule(made).utility
    add_trial(made, proposal.trial)
    assert len(record_keys(made)) == len(labels) + 1


def write_log(folder, record, before=7.3, after=4.0):
    """The record as a log with quiet stretches about it, on a clock of its own."""
    step = record.time[1]
    lead, tail = round(before / step), round(after / step)
    n, u = (np.pad(record.channel(name), (lead, tail), mode="edge") for name in ("n", "u"))
    u = u + 1e-3 * np.sin(np.arange(u.size))
    rows = (f"{100 + step * i:.4f},{a / RPM:.6f},{b:.6f}" for i, (a, b) in enumerate(zip(n, u, strict=True)))
    (folder / "log_1.csv").write_text("time,n,u\n" + "\n".join(rows) + "\n")


def imported(folder, *changes):
    truth = "[truth]\nX_uabsu = -2.93\nT_nabsn = 6.28e-4\n"
    return campaign(folder, (truth, IMPORT), *changes)


def test_a_log_is_cut_to_what_was_commanded_and_says_how_well_that_was_followed(
    monkeypatch, capsys, designed, tmp_path
):
    (record,) = get_trials(designed[0]).fit
    write_log(tmp_path, record)
    (tmp_path / "sent_1.csv").write_text(MINE)
    (found,) = get_trials(imported(tmp_path)).fit
    assert found.time[-1] == pytest.approx(record.time[-1], abs=0.11)
    np.testing.assert_allclose(
        found.channel("n")[: record.time.size - 2], record.channel("n")[: record.time.size - 2], rtol=1e-5
    )
    assert found.provenance.options["start"] == pytest.approx(7.3, abs=0.05)
    code, out, err = run(monkeypatch, capsys, "import", tmp_path, "--quiet")
    assert code in (Exit.OK, None)
    assert "followed sent_1.csv: begun 7.3 s into the log; n within" in out
    assert "100% of its amplitude" in out
    assert err == ""


def test_a_control_may_be_a_line_between_its_samples_and_a_measurement_may_not(designed, tmp_path):
    (record,) = get_trials(designed[0]).fit
    write_log(tmp_path, record)
    whole, n, u = ('schedule = "sent_{run}.csv"\n', ""), '"n", unit = "rpm"', '"u", unit = "m/s"'
    (held,) = get_trials(imported(tmp_path, whole)).fit
    (line,) = get_trials(imported(tmp_path, whole, (n, f'{n}, between = "line"'))).fit
    one, other = (found.channel("n") for found in (held, line))
    np.testing.assert_allclose(other[:-1], 0.5 * (one[:-1] + one[1:]), rtol=1e-9)
    with pytest.raises(InputError, match=r"channels.u.between[^$]*a measurement"):
        get_trials(imported(tmp_path, whole, (u, f'{u}, between = "line"')))


def test_stated_ends_stand_and_another_trial_is_refused(designed, tmp_path):
    (record,) = get_trials(designed[0]).fit
    write_log(tmp_path, record)
    (tmp_path / "sent_1.csv").write_text(MINE)
    stated = imported(
        tmp_path, ('schedule = "sent_{run}.csv"', 'schedule = "sent_{run}.csv"\nstart = "5 s"\nend = "38 s"')
    )
    (found,) = get_trials(stated).fit
    assert found.time[-1] == pytest.approx(33.0, abs=0.11)
    rng = np.random.default_rng(2).uniform(900, 1490, 30)
    (tmp_path / "sent_1.csv").write_text("time_s,n_rpm\n" + "\n".join(f"{i},{x:.1f}" for i, x in enumerate(rng)) + "\n")
    with pytest.raises(InputError, match=r"key import.schedule[^$]*no stretch in which n moves as in sent_1.csv"):
        get_trials(load_campaign(tmp_path))


def test_what_goes_out_of_several_controls_is_said(tmp_path):
    from seatrial.campaign.design.schedule import write_own
    from seatrial.export.trials.trial import read_trial

    made = campaign(tmp_path)
    time = np.arange(100) * 0.1
    both = Schedule(time, {"n": np.where(time > 5, 130.0, 125.0), "delta_r": np.where(time > 2, 0.1, 0.0)})
    path = write_own(Store(made.folder).schedule(Store(made.folder).own_design), both, "mine.csv")
    assert path.read_text().startswith("time_s,n_rpm,delta_r_deg\n")
    assert [one["control"] for one in json.loads(path.with_suffix(".json").read_text())["controls"]] == ["n", "delta_r"]
    with pytest.raises(InputError, match="one control, because an exported trial moves one"):
        read_trial(made.folder, "own")
    asked = Scheduled("both", "mine.csv", both)
    assert asked.as_plain()["controls"].keys() == {"n", "delta_r"}
