"""The bar of what is at work: one share for the whole run, elapsed and remaining time; and parts that follow changes."""

import asyncio
import os

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

from seatrial.cli.campaign_lock import Occupant
from seatrial.dashboard import app_context
from seatrial.dashboard.jobs import Job
from seatrial.dashboard.run_bar import standing_of
from tests.campaign.small import write_small


def job(*work, alive=True):
    pieces = tuple({"title": t, "done": d, "total": n, "begun_at": 0, "elapsed": s} for t, d, n, s in work)
    return Job(Occupant(alive, 1, "here", ("seatrial", "run", "boat"), 1000.0, pieces), "", "")


def test_the_whole_run_is_one_share():
    found = standing_of(job(("whole run", 250, 1000, 20.0), ("estimate M-0", 9, 10, 5.0)), 1040.0)
    assert found == ("seatrial run, 25%, 40 s elapsed, about 60 s remaining; estimate M-0, 90%", 0.25)
    assert standing_of(job(("whole run", 250, 1000, 20.0), ("estimate M-0", 9, 9, 5.0)), 1040.0).words.endswith(
        "remaining"
    )


def test_the_remaining_time_of_a_whole_run_is_what_it_says():
    """At its pace 90 % after 156 s would leave 17 s, where the chains that are at work take 1 100 s more."""
    running = job(("whole run", 900, 1000, 156.0), ("estimate M-0", 10, 100, 126.0))
    running.occupant.work[0]["seconds"] = 1150.0
    assert "about 19 min remaining" in standing_of(running, 1160.0).words


def test_a_piece_that_takes_longer_than_was_expected_of_the_whole_run_is_told():
    """A third method for an evidence is not foreseen: the share of the whole run then stands still, and the bar says what is computed."""
    pieces = (
        ("whole run", 750, 1000, 60.0),
        ("evidence M-1", 9, 10, 9.0),
        ("evidence M-0: nested sampling", 200, 1000, 40.0),
    )
    found = standing_of(job(*pieces), 1060.0)
    assert found.words == "seatrial run, 75%, 60 s elapsed, about 3 min remaining; evidence M-0: nested sampling, 20%"


def test_what_was_compiled_says_nothing_about_the_remaining_time():
    found = standing_of(job(("evidence M-0: nested sampling", 1, 1000, 13.0)), 1013.0)
    assert found.words == "seatrial run, evidence M-0: nested sampling, 0%, 13 s elapsed"


def test_of_several_trials_the_last_is_told():
    found = standing_of(job(("whole run", 1000, 1000, 60.0), ("whole run", 500, 1000, 50.0)), 1110.0)
    assert found == ("seatrial run, round 2, 50%, 2 min elapsed, about 50 s remaining in this round", 0.5)


def test_a_command_of_one_step_tells_that_step():
    found = standing_of(job(("rehearsal", 1, 4, 10.0)), 1012.0)
    assert found == ("seatrial run, rehearsal, 25%, 12 s elapsed, about 30 s remaining in this step", 0.25)
    assert standing_of(job(), 1001.0) == ("seatrial run, 1 s elapsed", None)
    assert standing_of(job(("x", 1, 2, 1.0), alive=False), 1001.0).share is None


def test_what_any_process_writes_is_a_change(tmp_path):
    folder = write_small(tmp_path)
    (folder / "results" / "posterior").mkdir(parents=True)
    seen = app_context.change_of(folder)
    assert app_context.change_of(folder) == seen
    for name in ("results/posterior/M-0.nc", "results/summary.json", "log.csv"):
        (folder / name).write_text("x")
        assert app_context.change_of(folder) != seen, name
        seen = app_context.change_of(folder)
    os.utime(folder / "campaign.toml", (1, 1))
    assert app_context.change_of(folder) != seen


class Part:
    """An element that is never shown."""

    is_deleted, cleared = False, 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def clear(self):
        self.cleared += 1


def test_a_part_is_built_again_once_a_change_has_settled(monkeypatch):
    looks, built, part, value = [], [], Part(), [0]
    monkeypatch.setattr(app_context.ui, "timer", lambda seconds, look: looks.append(look))
    monkeypatch.setattr(app_context.ui, "element", lambda tag: part)

    async def build():
        built.append(value[0])

    async def follow():
        await app_context.keep_current(lambda: value[0], build)
        (look,) = looks
        for new in (0, 1, 2, 2, 2):
            value[0] = new
            await look()

    asyncio.run(follow())
    assert built == [0, 2]
    assert part.cleared == 1
