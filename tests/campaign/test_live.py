import json
import os
import socket
import sys
import threading
import time
from dataclasses import replace
from decimal import Decimal
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares
from typer.testing import CliRunner

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.schema import Goal
from seatrial.campaign.data.import_logs import import_trials
from seatrial.campaign.live.advice import Adviser
from seatrial.campaign.live.channels import Arrival
from seatrial.campaign.live.innovations import InnovationMemory, discounted
from seatrial.campaign.live.next_segment import make_library
from seatrial.campaign.live.recursion import live_recursion, within_bounds
from seatrial.campaign.live.session import ClockGate, LiveSettings, Notes, Session, ValueGate
from seatrial.campaign.live.session_files import Kept, import_lines, with_session
from seatrial.campaign.live.sources import GrowingText, MavlinkUdp, Piece, PipedText, open_source
from seatrial.cli.main import app
from seatrial.core.errors import InputError
from seatrial.estimation.priors.box import Uniform
from seatrial.filters.run import filter_within
from tests.campaign.small import NO_X_U, write_small
from tests.cases import RPM

TRUTH = {"X_uabsu": -2.93, "T_nabsn": 6.28e-4}
STEP, DEDUCTION = 0.1, 0.1
IMPORT = """
[import]
fit = ["1"]

[[import.files]]
path = "log_{run}.csv"
time = { column = "stamp", unit = "ms" }
channels.n = { column = "prop", unit = "rpm" }
channels.u = { column = "speed", unit = "m/s", scale = -1.0, offset = 0.5 }
"""


def write_campaign(folder, goal='sd = { X_uabsu = 0.3, T_nabsn = "5 %" }', more=""):
    write_small(folder, *NO_X_U)
    path = folder / "campaign.toml"
    text = path.read_text()
    head, tail = text.split("[truth]")
    rest = tail[tail.index("[estimation]") :].replace("chains", 'initial = "measured"\nchains')
    path.write_text(f"{head}[goal]\n{goal}\n{rest}{more}")
    return load_campaign(folder)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return write_campaign(tmp_path_factory.mktemp("live") / "small")


def trial(samples=600, seed=0, noise=0.05):
    """Control and measured speed of the small vehicle, the speed by a naive midpoint rule in a hundredth of a sample."""
    n = (1000 + 300 * np.sign(np.sin(2 * np.pi * np.arange(samples) * STEP / 12))) * RPM
    return n, speeds(TRUTH["X_uabsu"], TRUTH["T_nabsn"], n) + noise * np.random.default_rng(seed).normal(size=samples)


def speeds(drag, thrust, n, parts=4):
    def rate(u, w):
        return (drag * u * abs(u) + (1 - DEDUCTION) * thrust * w * abs(w)) / (30.48 + 0.93)

    found, u, h = [], 1.3, STEP / parts
    for w in n:
        found.append(u)
        for _ in range(parts):
            u += h * rate(u + 0.5 * h * rate(u, w), w)
    return np.array(found)


def feed(session, n, u, start=0.0, step=STEP):
    looks = []
    for k in range(len(n)):
        session.add(Arrival(Decimal(f"{start + k * step:.6f}"), 0, {"n": float(n[k]), "u": float(u[k])}))
        if session.is_due:
            looks.append(session.look())
    return looks


def test_step_by_step_is_the_filter_over_the_whole_record(campaign):
    r = live_recursion(campaign)
    rng = np.random.default_rng(1)
    n, u = trial(80)
    step, measured = rng.uniform(0.05, 0.2, 80), np.where(rng.uniform(size=80) < 0.2, np.nan, u)[:, None]
    noisy = replace(r.space, process_sd=np.array([0.02, 0.0, 0.01]), initial=r.begin({"u": u[0]}, r.prior))
    whole = jax.jit(lambda c, m, h: filter_within(r.method, noisy, c, m, h, np.sqrt(step)).final)(
        n[:, None], measured, step
    )
    r, belief = replace(r, space=noisy), noisy.initial
    for k in range(80):
        held = k - 1 if k else 0
        belief, found = r.step(belief, n[held : held + 1], step[held] * (k > 0), n[k : k + 1], measured[k])
        assert not found.failed
        assert np.isnan(found.normalised[0]) == np.isnan(measured[k, 0])
    np.testing.assert_allclose(belief.mean, whole.mean, rtol=1e-10)
    np.testing.assert_allclose(np.asarray(belief.cov), np.asarray(whole.cov), rtol=1e-9, atol=1e-13)


def test_the_recursive_answer_is_that_of_the_batch_within_a_third_of_its_sd(campaign):
    n, u = trial(600, seed=4)
    session = Session(campaign, "simulated")
    look = feed(session, n, u)[-1]
    prior = [campaign.prior(name) for name in TRUTH]
    scale = np.array([one.sd for one in prior])

    def misfits(z):
        values = z[:2] * scale
        away = (u - speeds(*values, n) - (z[2] * np.exp(-np.arange(600) * 0.05))) / 0.05
        return np.concatenate([away, z[:2] - np.array([one.mean for one in prior]) / scale])

    found = least_squares(misfits, [*(np.array(list(TRUTH.values())) / scale), 0.0], diff_step=1e-4)
    sd = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))[:2] * scale
    for one, mode, its_sd in zip(look.coefficients, found.x[:2] * scale, sd, strict=True):
        assert abs(one.mean - mode) < its_sd / 3
        assert 0.85 * its_sd < one.sd < 1.6 * its_sd


@pytest.mark.proof
def test_the_advice_of_a_trial_that_meets_its_goal_rests_or_is_of_another_vehicle(campaign):
    n, u = trial(700, seed=2)
    campaign = replace(campaign, goal=Goal(sds={"X_uabsu": 0.04}))
    session = Session(campaign, "simulated", LiveSettings(hold=4.0))
    looks = feed(session, n, u)
    first = next(look for look in looks if look.kind == "stop")
    met = [look.time for look in looks if look.coefficients[0].sd <= 0.04]
    assert first.time >= met[0] + 4.0
    assert looks[-1].advice == "the goal is met: stop"
    assert all(c.is_excited for c in looks[25].coefficients)
    assert any("goal in about" in look.advice for look in looks)

    still = Session(campaign, "simulated")
    rest = np.full(400, 1000 * RPM)
    looks = feed(still, rest, speeds(*TRUTH.values(), rest)[-1] + 0.05 * np.random.default_rng(0).normal(size=400))
    assert looks[-1].kind == "switch"
    assert not all(c.is_excited for c in looks[-1].coefficients)

    other = Session(campaign, "simulated")
    looks = feed(other, n, u + 0.3 * np.sin(2 * np.pi * np.arange(700) / 9))
    assert looks[-1].kind == "wrong"
    assert "innovations of u are" in looks[-1].advice


def advised(adviser, time, rms=1.0, doubts=()):
    """Return the kind of advice about a coefficient that is known better than its goal."""
    memory, known, goal = SimpleNamespace(count=np.array([100])), np.array([0.1]), np.array([0.2])
    return adviser._advise(time, memory, np.array([rms]), known, goal, 9.0, doubts)[0]


def test_a_goal_is_held_from_the_last_doubt_on():
    adviser = Adviser(SimpleNamespace(names=("X_u",)), ("u",), Goal(sds={"X_u": 0.2}), 4.0, {})
    kinds = [advised(adviser, time, doubts=("check u",) * (time <= 5)) for time in range(11)]
    assert kinds == ["check"] * 6 + ["go on"] * 4 + ["stop"]


def test_a_model_is_wrong_from_one_limit_on_and_until_a_lower_one():
    adviser = Adviser(SimpleNamespace(names=("X_u",)), ("u",), Goal(sds={"X_u": 0.2}), 0.0, {})
    kinds = [advised(adviser, time, rms) for time, rms in enumerate((2.1, 2.3, 2.1, 1.9, 2.1))]
    assert kinds == ["stop", "wrong", "wrong", "stop", "stop"]


def test_clock_jumps_repeats_and_drop_outs():
    notes = Notes()
    gate = ClockGate(2.0, notes.say)
    stamps = ["10", "10.1", "10.1", "10.05", "10.2", "99", "99.1", "3", "3.1"]
    kinds = [gate.admit(Decimal(one), 0, 0.25).kind for one in stamps]
    assert kinds == ["begins", "goes on", "dropped", "dropped", "goes on", "begins", "goes on", "begins", "goes on"]
    assert gate.time == pytest.approx(0.2 + 88.8 + 0.1 + 0.25 + 0.1)
    assert len(notes.take()) == 4
    assert gate.admit(Decimal("3.1"), 1, 0.0).kind == "goes on"
    assert gate.admit(Decimal("3.1"), 1, 0.0).kind == "dropped"


def test_states_begin_anew_and_coefficients_keep_what_is_known(campaign):
    n, u = trial(300)
    session = Session(campaign, "simulated")
    before = feed(session, n, u)[-1]
    session.add(Arrival(Decimal(5), 0, {"n": 100.0, "u": 0.2}))
    after = session.look()
    assert np.asarray(session.belief.mean)[0] == pytest.approx(0.2, abs=0.01)
    for old, new in zip(before.coefficients, after.coefficients, strict=True):
        assert new.sd <= 1.05 * old.sd
        assert new.mean == pytest.approx(old.mean, abs=0.5 * old.sd)
    assert any("initialised again" in note for note in session.notes.take())


def test_values_of_another_unit_are_told_once_and_a_channel_of_which_most_cannot_be_is_left_out():
    notes = Notes()
    gate = ValueGate({"u": 2.0}, {"n": 150.0}, notes.say)
    for _ in range(3):
        assert gate.admit({"u": 1500.0, "n": 1200.0, "x": 1e8, "v": np.nan, "w": 3e38}) == {"x": 1e8}
    assert len(notes.take()) == 3
    assert gate.left_out == {"u", "n", "w"}
    # Of a speed in cm/s the smaller values could be: none is taken until most are of a size that is foreseen.
    assert gate.admit({"u": 90.0, "n": 100.0}) == {}
    for _ in range(40):
        gate.admit({"u": 60.0, "n": 100.0})
    assert gate.left_out == {"u", "w"}
    for _ in range(10):
        gate.admit({"u": 1.0})
    assert gate.admit({"u": 1.0}) == {"u": 1.0}
    spike = ValueGate({"u": 2.0}, {}, notes.say)
    assert [spike.admit({"u": one}) for one in (1.0, 1e3, 1.1)] == [{"u": 1.0}, {}, {"u": 1.1}]


def test_there_is_no_advice_while_most_values_of_a_channel_are_left_out(campaign):
    n, u = trial(300)
    session = Session(campaign, "simulated")
    session.values = ValueGate({"u": 2.0}, {}, session.notes.say)
    looks = feed(session, n, 100 * u * np.where(np.arange(1, 301) % 5, 1.0, 0.3))
    assert {look.kind for look in looks} == {"check"}
    assert all(look.advice.startswith("check the unit of u: most of its values") for look in looks)
    assert looks[-1].coefficients[0].sd == pytest.approx(campaign.prior("X_uabsu").sd)
    looks = feed(session, n, u, start=30.0)
    assert looks[-1].kind != "check"


@pytest.mark.parametrize(
    ("factor", "begins", "words"),
    [
        (
            -1.0,
            "X_uabsu and T_nabsn are at the edges of their priors: check the unit and sign of u and n",
            "scale = -1",
        ),
        pytest.param(1.94384, "check the unit of u", "knots taken for m/s", marks=pytest.mark.proof),
    ],
    ids=["sign", "knots"],
)
def test_a_wrong_sign_or_unit_never_meets_the_goal_and_is_told_steadily(campaign, factor, begins, words):
    n, u = trial(1200, seed=6)
    session = Session(narrow(campaign), "simulated")
    looks = feed(session, n, factor * u)
    kinds = [look.kind for look in looks]
    assert "stop" not in kinds
    assert not any("goal is met" in look.advice for look in looks)
    first = kinds.index("check")
    assert looks[first].time < 30.0
    assert set(kinds[first:]) == {"check"}
    assert looks[first].advice.startswith(begins)
    assert words in looks[-1].advice
    assert len({look.advice.partition(" (")[0] for look in looks[first:]}) <= 3


def narrow(campaign):
    """Return the campaign with priors about its truth."""
    ranges = {"X_uabsu": (-4.5, -2.0), "T_nabsn": (5.0e-4, 8.0e-4)}
    priors = {**campaign.priors, **{name: Uniform(*ends) for name, ends in ranges.items()}}
    return replace(campaign, priors=priors)


@pytest.mark.proof
def test_a_speed_that_contradicts_the_trim_is_told(campaign):
    trim = campaign.hull.trim
    session = Session(campaign, "simulated")
    u = 1.94384 * trim["u"] + 0.05 * np.random.default_rng(0).normal(size=300)
    looks = feed(session, np.full(300, trim["n"]), u)
    assert looks[-1].kind == "check"
    assert "check the unit of u in the channel map (knots taken for m/s" in looks[-1].advice
    # Told as long as the trim is not seen again, and until it is as it should be for a while.
    away = np.full(700, 0.7 * trim["n"])
    assert feed(session, away, 1.3 * u[0] * np.ones(700), start=30.0)[-1].kind == "check"
    right = trim["u"] + 0.05 * np.random.default_rng(1).normal(size=900)
    looks = feed(session, np.full(900, trim["n"]), right, start=100.0)
    assert "knots" not in looks[-1].advice


@pytest.mark.proof
@pytest.mark.parametrize(
    ("factor", "is_told"), [(1.0, False), (1.94384, True), (3.6, True)], ids=["m/s", "knots", "km/h"]
)
def test_a_speed_that_wide_priors_explain_in_any_unit_is_held_against_the_trim(campaign, factor, is_told):
    """The control is never at its trim, at which the small vehicle does 1.54 m/s; coefficients in any unit are inside their priors."""
    n, u = trial(600, seed=8)
    ranges = {"X_uabsu": (-50.0, 0.0), "T_nabsn": (0.0, 5e-3)}
    priors = {**campaign.priors, **{name: Uniform(*ends) for name, ends in ranges.items()}}
    session = Session(replace(campaign, priors=priors), "simulated")
    looks = feed(session, n, factor * u)
    assert ("stop" in [look.kind for look in looks]) is not is_told
    told = [look.advice for look in looks if look.kind == "check"]
    assert bool(told) is is_told
    assert all("check the unit of u" in advice and "by the coefficients at trim" in advice for advice in told)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.proof) for seed in (1, 2, 3))])
def test_a_true_value_on_the_edge_of_its_prior_meets_the_goal(campaign, seed):
    n, u = trial(900, seed=seed)
    priors = {**campaign.priors, "X_uabsu": Uniform(-8.8, TRUTH["X_uabsu"])}
    looks = feed(Session(replace(campaign, priors=priors), "simulated"), n, u)
    assert looks[-1].kind == "stop"
    assert not any(look.kind in ("check", "wrong") for look in looks)


@pytest.mark.proof
def test_a_control_that_changes_smoothly_and_is_taken_as_held_is_told_once(tmp_path):
    smooth = (1000 + 300 * np.sin(2 * np.pi * np.arange(600) * STEP / 20)) * RPM
    told = {}
    for between in ("held", "line"):
        campaign = write_campaign(
            tmp_path / between, more=IMPORT.replace('unit = "rpm" }', f'unit = "rpm", between = "{between}" }}')
        )
        session = Session(campaign, "simulated")
        feed(session, smooth, speeds(TRUTH["X_uabsu"], TRUTH["T_nabsn"], smooth))
        told[between] = [note for note in session.notes.take() if 'between = "line"' in note]
    assert len(told["held"]) == 1
    assert "change at nearly every sample are used as steps: n. " in told["held"][0]
    assert told["line"] == []
    session = Session(campaign, "simulated")
    feed(session, *trial(600))
    assert not any("at nearly every sample" in note for note in session.notes.take())


def test_information_is_discounted_by_what_innovations_repeat():
    rng = np.random.default_rng(5)
    white, slow = rng.normal(size=6000), np.empty(6000)
    slow[0] = 0.0
    for k in range(1, 6000):
        slow[k] = 0.9 * slow[k - 1] + np.sqrt(1 - 0.81) * white[k]
    memory = InnovationMemory(2)
    for pair in zip(white, 2 * slow, strict=True):
        memory.add(np.array(pair))
    ones, repeated = memory.repeats()
    assert 1.0 <= ones < 1.7
    assert 0.8 * 19 < repeated < 1.8 * 19
    assert memory.discount() == pytest.approx(memory.mean_square[1] * repeated)
    assert memory.mean_square[1] == pytest.approx(4.0, rel=0.2)
    np.testing.assert_allclose(discounted(np.diag([0.01, 1.0]), 4.0), np.diag([1 / (1 + 99 / 4), 1.0]))


def test_a_belief_is_cut_at_its_bounds():
    draws = np.random.default_rng(0).multivariate_normal([0.2, 0.0], [[1.0, 0.6], [0.6, 1.0]], size=400_000)
    inside = draws[draws[:, 0] > 0]
    found = within_bounds(
        np.array([0.2, 0.0]), np.array([[1.0, 0.6], [0.6, 1.0]]), np.array([[0, np.inf], [-np.inf, np.inf]])
    )
    np.testing.assert_allclose(found, inside.mean(0), atol=0.01)


def test_a_growing_text_is_followed_over_truncation_and_rotation(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,n,u\n1,2,3\n4,5")
    stream = GrowingText(path)
    piece = stream.read(0.0)
    assert (piece.text, piece.begins, piece.raw) == (["time,n,u", "1,2,3"], True, b"time,n,u\n1,2,3\n4,5")
    assert stream.read(0.0).text == []
    with path.open("a") as more:
        more.write(",6\n7,8,9\n")
    piece = stream.read(0.0)
    assert (piece.text, piece.begins) == (["4,5,6", "7,8,9"], False)
    path.write_text("time,n,u\n")
    piece = stream.read(0.0)
    assert (piece.text, piece.begins) == (["time,n,u"], True)
    os.replace(path, tmp_path / "log.csv.1")
    assert stream.read(0.0).text == []
    path.write_text("time,n,u\n1,1,1\n2,2,2\n")
    assert stream.read(0.0).begins
    stream.close()


def test_a_pipe_ends_with_its_last_line():
    out, into = os.pipe()
    os.write(into, b"time,n,u\n0,1,2")
    stream = PipedText(out)
    assert stream.read(1.0).text == ["time,n,u"]
    os.close(into)
    assert stream.read(1.0).text == ["0,1,2"]
    assert stream.read(1.0) is None
    os.close(out)


def test_rows_become_channels_as_an_import_makes_them_and_the_session_is_imported(tmp_path):
    campaign = write_campaign(tmp_path / "small", more=IMPORT)
    n, u = trial(30)
    rows = [f"{100 * k},{w / RPM:.6f},{0.5 - v:.6f},junk" for k, (w, v) in enumerate(zip(n, u, strict=True))]
    text = "\n".join(["stamp,prop,speed,other", *rows]) + "\n"
    (tmp_path / "small" / "log_1.csv").write_text(text)
    log = tmp_path / "live.csv"
    log.write_text(text + "3000,1,2\n3000,1000,oops,\n1e9999999,1000,0,\n9e20,1000,0,\nstamp,prop,speed,other\n")
    session = Session(campaign, str(log))
    session.kept = Kept(campaign, ".received.csv", ("n", "u"))
    stream = open_source(str(log), session.channels.tables)
    looks = session.take(stream.read(0.0))
    stream.close()
    assert [round(look.time, 6) for look in looks] == [0.0, 1.0, 2.0, 3.0]
    assert len(session.notes.take()) == 3
    # All of it is with the system before the session ends: a kill loses nothing that was taken.
    assert len(session.kept.path.read_text().splitlines()) == 1 + 31
    assert (session.kept.folder / f"{session.kept.run}.received.csv").read_bytes() == log.read_bytes()
    session.kept.close()
    (record,) = import_trials(campaign).fit
    path = campaign.path
    path.write_text(path.read_text().replace(IMPORT, ""))
    path.write_text(with_session(load_campaign(path.parent), session.kept.run))
    (again,) = import_trials(load_campaign(path.parent)).fit
    np.testing.assert_allclose(again.time[:30], record.time, atol=1e-9)
    np.testing.assert_allclose(again.channel("u")[:30], record.channel("u"), rtol=1e-12)
    np.testing.assert_allclose(again.channel("n")[:30], record.channel("n"), rtol=1e-12)


@pytest.mark.proof
def test_a_control_measured_while_it_changed_follows_a_straight_line_where_the_map_says_so(tmp_path):
    """Held from each sample to the next, such a control is half a sample late, and what the innovations repeat widens the ±."""
    fine, n = 0.005, (1000 + 300 * np.sin(2 * np.pi * np.arange(12000) * 0.005 / 3)) * RPM
    u, motion, sd = 1.3, np.zeros(12000), {}
    for k in range(12000):
        motion[k] = u
        force = TRUTH["X_uabsu"] * u * abs(u) + (1 - DEDUCTION) * TRUTH["T_nabsn"] * n[k] ** 2
        u += fine * force / (30.48 + 0.93)
    every, noise = slice(None, None, 20), 0.002 * np.random.default_rng(2).normal(size=600)
    for between in ("held", "line"):
        more = IMPORT.replace('unit = "rpm" }', f'unit = "rpm", between = "{between}" }}')
        campaign = write_campaign(tmp_path / between, more=more)
        session = Session(
            replace(campaign, sensors={"u": campaign.sensors["u"].model_copy(update={"noise": 0.002})}), "simulated"
        )
        found = feed(session, n[every], motion[every] + noise)[-1].coefficients
        assert all(abs(one.mean - TRUTH[one.name]) < 3 * one.sd for one in found)
        sd[between] = np.array([one.sd for one in found])
        assert (
            'between = "line"' in import_lines(campaign.imports, campaign.model(campaign.full), campaign.channels, "1")
        ) == (between == "line")
    assert (sd["line"] < 0.2 * sd["held"]).all(), sd


def test_a_stream_without_what_is_needed_is_refused_at_once(campaign, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,u\n")
    with pytest.raises(InputError, match="no n among time, u"):
        Session(campaign, str(path)).take(open_source(str(path), []).read(0.0))
    with pytest.raises(InputError, match="a `table`"):
        Session(campaign, "udp").channels.check_messages()
    with pytest.raises(InputError, match="no such file"):
        open_source(str(tmp_path / "none.csv"), [])
    with pytest.raises(InputError, match="udp:HOST:PORT"):
        open_source("udp:14550", [])
    with pytest.raises(InputError, match="no rclpy"):
        open_source("ros2", [])


def test_mavlink_over_udp_from_a_real_sender(tmp_path):
    mavutil = pytest.importorskip("pymavlink.mavutil")
    tables = IMPORT.split("[[import.files]]")[0] + "".join(
        f'[[import.files]]\npath = "{{run}}.tlog"\ntable = "{table}"\nchannels.{name} = {{ column = "{column}", unit = "{unit}" }}\n'
        for table, name, column, unit in (("RPM", "n", "rpm1", "rpm"), ("VFR_HUD", "u", "groundspeed", "m/s"))
    )
    campaign = write_campaign(tmp_path / "small", more=tables)
    session = Session(campaign, "udp")
    session.channels.check_messages()
    session.kept = Kept(campaign, ".tlog", ("n", "u"))
    stream = MavlinkUdp("127.0.0.1", 0, {"RPM", "VFR_HUD"})
    port = stream.socket.getsockname()[1]
    os.environ["MAVLINK20"] = "1"
    sender = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", dialect="ardupilotmega", source_system=1)

    def send():
        for k in range(40):
            sender.mav.heartbeat_send(12, 3, 0, 0, 0)
            sender.mav.rpm_send(1000.0 + k, 0.0)
            sender.mav.vfr_hud_send(0.0, 1.25, 0, 0, 0.0, 0.0)
            time.sleep(0.002)

    thread = threading.Thread(target=send)
    thread.start()
    until = time.monotonic() + 20
    while session.samples < 80 and time.monotonic() < until:
        session.take(stream.read(0.1))
    thread.join()
    session.kept.close()
    stream.close()
    sender.close()
    assert session.channels.of(Piece(messages=[("RPM", "1/1", {"rpm1": 1.0, "log_time": np.nan})])) == []
    assert session.samples == 80  # the sender's RPM comes first, and is a sample of its own
    assert session.control["n"] == pytest.approx(1039 * RPM)
    times = [float(row.split(",")[0]) for row in session.kept.path.read_text().splitlines()[1:]]
    assert len(times) == 80
    assert np.all(np.diff(times) > 0)
    packets = (session.kept.folder / f"{session.kept.run}.tlog").read_bytes()
    assert packets.count(b"\xfd") >= 120
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match="cannot be opened"):
            MavlinkUdp("127.0.0.1", port, ())


def test_the_next_segment_is_the_one_that_meets_the_goal_soonest(campaign):
    library = make_library(campaign, campaign.model(campaign.full))
    values, wanted = np.array(list(TRUTH.values())), np.array([0.05, np.inf])
    known = np.diag([1.0, 1e7])
    choice = library.choose(values, known, 0.5, wanted)
    soonest = np.inf
    for control in library.controls:
        more, runs = 0.5 * np.asarray(library.plan.information(values, control)), 0
        while np.sqrt(np.linalg.inv(known + runs * more)[0, 0]) > 0.05:
            runs += 1
        soonest = min(soonest, runs * 30.0)
    assert choice.seconds == soonest
    assert "doublet" in choice.words
    assert library.choose(values, known, 0.5, np.array([1e-6, np.inf])).seconds == np.inf
    assert 1.5 < library.sizes["u"] < 15.0
    session = Session(campaign, "simulated", library=library)
    session.add(Arrival(Decimal(0), 0, {"n": 100.0, "u": 1500.0}))
    assert "the priors allow" in session.notes.take()[0]


def test_topics_of_ros_where_rclpy_is(monkeypatch):
    class Fields(SimpleNamespace):
        def get_fields_and_field_types(self):
            return vars(self)

    message = Fields(
        header=Fields(stamp=SimpleNamespace(sec=2, nanosec=5)),
        speed=1.5,
        axes=[Fields(value=0.5)],
        name="text",
        on=True,
    )
    kept = []
    node = SimpleNamespace(
        get_topic_names_and_types=lambda: [("/state", ["pkg/msg/State"])],
        create_subscription=lambda kind, topic, keep, depth: kept.append(keep),
        destroy_node=lambda: None,
    )
    rclpy = SimpleNamespace(
        init=lambda: None,
        shutdown=lambda: None,
        create_node=lambda name: node,
        spin_once=lambda node, timeout_sec: None,
    )
    monkeypatch.setitem(sys.modules, "rclpy", rclpy)
    monkeypatch.setitem(sys.modules, "rosidl_runtime_py.utilities", SimpleNamespace(get_message=lambda name: name))
    monkeypatch.setitem(sys.modules, "rosidl_runtime_py", SimpleNamespace())
    stream = open_source("ros2", ["/state"])
    kept[0](message)
    ((topic, _, columns),) = stream.read(0.0).messages
    assert topic == "/state"
    columns.pop("log_time")
    assert columns == {"header.stamp": 2_000_000_005.0, "speed": 1.5, "axes[0].value": 0.5, "on": 1.0}
    stream.close()


def test_the_command_follows_a_log_and_puts_it_into_the_campaign(tmp_path):
    folder = tmp_path / "small"
    write_campaign(folder)
    n, u = trial(450)
    rows = np.column_stack([np.arange(450) * STEP, n, u])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,n,u", comments="")
    options = ["--idle", "0.1", "--no-library", "--json", "--import", "--quiet"]
    result = CliRunner().invoke(app, ["live", str(folder), str(tmp_path / "log.csv"), *options])
    assert result.exit_code == 0, result.output
    last = json.loads([line for line in result.output.splitlines() if line.startswith("{")][-1])
    assert last["samples"] == 450
    assert {one["name"] for one in last["coefficients"]} == set(TRUTH)
    assert [record.time.size for record in import_trials(load_campaign(folder)).fit] == [450]
