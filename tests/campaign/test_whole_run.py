"""One bar for a whole run: it goes by the seconds that steps took before and by their own bars, and what it has learnt is a file."""

import json
import threading

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.workflow import whole_run
from seatrial.campaign.workflow.steps import Workflow
from seatrial.campaign.workflow.whole_run import TITLE, WholeRun, expected_seconds, learn, learnt, timed
from seatrial.core.reporter import remaining
from tests.campaign.small import write_small


class Told:
    """Keeps what a reporter is told."""

    def say(self, text):
        pass

    def __init__(self):
        self.shown, self.seconds = {}, []

    def progress(self, title):
        def told(done, total, seconds=None):
            self.shown.setdefault(title, []).append((done, total))
            self.seconds += [] if seconds is None else [seconds]

        return told


def begun(**seconds):
    """A run of steps that took these seconds before, in its first step."""
    for step, taken in seconds.items():
        learn(step, taken)
    told = Told()
    run = WholeRun(told, list(seconds))
    run.begin(next(iter(seconds)))
    return told, run


@pytest.fixture
def clock(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    now = [0.0]
    monkeypatch.setattr(whole_run.time, "monotonic", lambda: now[0])
    return now


def test_steps_that_took_no_time_before_end_in_no_error(clock):
    """As `first` and `promised` of a campaign that designs nothing."""
    told, run = begun(first=0.0, promised=0.0)
    clock[0] = 2.0
    run.end()
    run.begin("promised")
    run.end()
    assert told.shown[TITLE][-1] == (1000, 1000)


def test_the_bar_follows_what_steps_took_before(clock):
    for _ in range(2):
        learn("estimates", 30.0)
        learn("selection", 10.0)
    told = Told()
    run = WholeRun(told, ["estimates", "selection"])
    run.begin("trials")  # is current
    run.end()
    run.begin("estimates")
    clock[0] = 15.0
    step = run.progress("estimate M-0")
    step(1, 2)
    clock[0] = 100.0
    step(2, 2)
    run.end()
    run.begin("selection")
    run.end()
    shown = [done for done, _ in told.shown[TITLE]]
    assert 375 in shown  # 15 s of 40 s, by what it took and by its bar
    assert shown[-2:] == [
        round(1000 * 100 / (100 / 0.95 + 10)),
        1000,
    ]  # it stays there although 10 s take 2.75 times as long
    assert told.shown["estimate M-0"] == [(1, 2), (2, 2)]
    assert learnt() == {"estimates": 65.0, "selection": 5.0}


def test_a_step_is_as_slow_as_those_before_it(clock, tmp_path):
    """30 s took 120 s, or none, and weigh three times what is not known: a second takes 3.25, or 0.25.

    What lasts longer and reports nothing takes a quarter more, 0.2 + 1 / 0.95.
    """
    (tmp_path / "seatrial").mkdir()
    for seconds, share in ((120.0, round(1000 * 128 / 152.5)), (0.0, round(1000 / (0.2 + 1 / 0.95)))):
        (tmp_path / "seatrial" / "seconds.json").write_text('{"estimates": 30.0, "selection": 10.0}')
        told = Told()
        run = WholeRun(told, ["estimates", "selection"])
        run.begin("estimates")
        clock[0] += seconds
        run.end()
        run.begin("selection")
        clock[0] += 8.0
        run.show()
        assert told.shown[TITLE][-1] == (share, 1000)


def test_a_step_that_is_far_longer_than_it_was_says_so(clock):
    """10 s were expected; after 100 s its four bars are a quarter full: 300 s remain, of which what was expected takes away a little."""
    told, run = begun(selection=10.0, next=10.0)
    bars = [run.progress(f"evidence M-{i}") for i in range(4)]
    clock[0] = 100.0
    bars[0](1, 1)
    done = told.shown[TITLE][-1][0] / 1000
    assert 190 < 100 * (1 - done) / done < 310


def test_the_bar_waits_for_a_piece_that_came_late(clock):
    """Two pieces are over after 5 s; a third, of which nobody knew, moves from 1 % at 10 s to 5 % at 50 s: the bar waits."""
    told, run = begun(selection=10.0, next=10.0)
    bars = [run.progress(f"evidence M-{i}") for i in range(2)]
    clock[0] = 5.0
    for bar in bars:
        bar(1, 1)
    late = run.progress("nested sampling")
    for seconds, done in ((10.0, 1), (50.0, 5), (900.0, 95)):
        clock[0] = seconds
        late(done, 100)
    run.end()
    shown = [done for done, _ in told.shown[TITLE]]
    assert shown == sorted(shown)
    assert shown[-4] == shown[-3] < shown[-2] < 1000


def test_a_damaged_file_knows_nothing(clock, tmp_path):
    place = tmp_path / "seatrial" / "seconds.json"
    place.parent.mkdir()
    for text in ("{", "[1]", json.dumps({"estimates": "long"})):
        place.write_text(text)
        assert learnt() == {}
    learn("next", 2.0)
    assert learnt() == {"next": 2.0}
    told = Told()
    WholeRun(told, ["next"])
    assert told.shown == {}  # of one step its own bars say it


def test_a_whole_run_takes_no_less_than_its_running_part(clock):
    """Of 156 s the chains were to take 30: they are at 10 % after 126 s. The line of the part says 1 134 s, and no other is shorter."""
    for step, seconds in (("trials", 30.0), ("estimates", 30.0), ("selection", 10.0)):
        learn(step, seconds)
    told = Told()
    run = WholeRun(told, ["trials", "estimates", "selection"])
    run.begin("trials")
    clock[0] = 30.0
    run.end()
    run.begin("estimates")
    chains = run.progress("estimate M-0")
    chains(0, 100)
    for seconds, done in ((90.0, 1), (100.0, 2), (156.0, 10), (400.0, 30), (900.0, 60)):
        clock[0] = seconds
        chains(done, 100)
        of_part = remaining(seconds - 30.0, 0, done, 100)
        assert told.seconds[-1] >= (of_part or 0.0)
    assert of_part == pytest.approx(870.0 * 40 / 60)
    assert told.seconds[-1] < 1.5 * of_part


def test_the_remaining_time_never_stands_still(clock):
    """A step of 5 s that reports nothing takes 60 s: every second the time is another one, and it is more than the 10 s that follow."""
    told, run = begun(filter=5.0, next=10.0)
    for second in range(1, 61):
        clock[0] = float(second)
        run.show()
    assert np.all(np.diff(told.seconds[-60:]) != 0)
    assert min(told.seconds) >= 10.0
    assert told.seconds[-1] == pytest.approx(60.0 * (0.2 + 1 / 0.95 - 1.0) + 10.0)


def test_a_part_that_reports_nothing_counts_down_and_never_ends(clock):
    """Of 100 s half is done after 50 s; 20 s later 30 s remain, and 80 s later, when nothing was heard, a quarter of the 80 s."""
    assert [remaining(50.0, 0, 50, 100, silent) for silent in (0.0, 20.0, 80.0)] == [50.0, 30.0, 20.0]
    told = Told()
    run = WholeRun(told, ["estimates", "next"])
    run.begin("estimates")
    part = run.progress("estimate M-0")
    part(0, 100)
    clock[0] = 50.0
    part(50, 100)
    for seconds in (70.0, 130.0, 400.0):
        clock[0] = seconds
        run.show()
        assert told.seconds[-1] >= remaining(50.0, 0, 50, 100, seconds - 50.0)


def test_a_run_is_watched_while_nothing_is_reported(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(whole_run, "EVERY", 0.005)
    told, seen = Told(), threading.Event()
    run = WholeRun(told, ["filter", "next"])
    monkeypatch.setattr(run, "show", seen.set)
    with run:
        assert seen.wait(10.0)


def test_a_larger_likelihood_takes_longer(clock):
    """Of 30 and 10 s for a likelihood of size 1 the chains take 40 times as long for one of size 40, and what is learnt is of size 1."""
    learn("estimates", 30.0)
    learn("next", 10.0)
    assert expected_seconds(["estimates", "next"], 40.0) == {"estimates": 1200.0, "next": 10.0}
    told = Told()
    run = WholeRun(told, ["estimates", "next"])
    run.resize(40.0)
    run.begin("estimates")
    run.show()
    assert told.seconds[-1] == pytest.approx(1210.0)
    clock[0] = 1600.0
    run.end()
    assert learnt()["estimates"] == pytest.approx(0.5 * (30.0 + 40.0))


@pytest.mark.parametrize(("state", "said"), [("missing", [40, 30]), ("current", [])])
def test_work_says_how_long_it_took_before(clock, tmp_path, monkeypatch, state, said):
    flow, lines = Workflow(load_campaign(write_small(tmp_path / "small"))), []
    told = Told()
    told.say = lines.append
    for seconds in (40.0, 20.0, 1.0):
        with timed(flow, told, "estimates"):
            clock[0] += seconds
        monkeypatch.setattr(Workflow, "state", lambda *_: state)
    assert lines == [f"about {seconds} s, by its earlier time in this campaign" for seconds in said]
