"""A commanded trial is found in a log by whoever ran it late, in part or in noise, and what is no such trial is refused."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.logs.schedule_match import match_schedule

STEP, N, LOGGED = 0.1, 400, 0.05
TIME = STEP * np.arange(N)
COMMANDED = 125.0 + 25.0 * np.sign(np.sin(2 * np.pi * (TIME - 2) / 9)) * ((TIME > 2) & (TIME < 29))


def record(columns, time):
    channels = [Channel(name, "rad/s" if name == "n" else "rad", "control") for name in columns]
    channels.append(Channel("u", "m/s", "measurement"))
    columns = {**columns, "u": np.sin(time)}
    return make_record(time, columns, tuple(channels), Provenance("log", ""), "dive")


def logged(start, length=80.0, lag=0.0, noise=0.0, gain=1.0):
    """A log at 20 Hz in which the trial begins at a time of its own; the propeller follows with a lag of first order."""
    time = np.arange(round(length / LOGGED)) * LOGGED
    x = COMMANDED[np.clip(((time - start) / STEP + 1e-9).astype(int), 0, N - 1)]
    x = np.where((time >= start) & (time < start + N * STEP), x, 125.0)
    if lag:
        for i in range(1, x.size):
            x[i] = x[i - 1] + (x[i] - x[i - 1]) * LOGGED / lag
    x = gain * x + noise * np.random.default_rng(1).standard_normal(x.size)
    return record({"n": x}, time)


@pytest.mark.parametrize("start", [0.0, 12.35, 33.0, -6.0, 60.0])
def test_a_trial_is_found_where_it_was_run(start):
    found = match_schedule(logged(start, noise=1.0), TIME, {"n": COMMANDED}, "mine.csv")
    assert found.start == pytest.approx(start, abs=0.06)
    assert found.controls[0].gain == pytest.approx(1.0, abs=0.02)
    assert found.cautions == []
    assert found.ends["start"] == pytest.approx(max(start, 0.0), abs=0.06)
    assert found.ends["end"] == pytest.approx(min(start + 40.0, 79.95), abs=0.06)
    missing = {-6.0: "its first 6 s are not in the log", 60.0: "its last 20.1 s are not in the log"}
    assert missing.get(start, "begun") in found.words


def test_the_start_is_that_of_the_largest_correlation_and_its_numbers_those_of_numpy():
    one = logged(17.0, lag=0.4, noise=2.0)
    found = match_schedule(one, TIME, {"n": COMMANDED}, "mine.csv")
    x, every = one.channel("n"), np.arange(int(40.0 / LOGGED) * 1)
    best = max(every, key=lambda i: np.corrcoef(x[i : i + 2 * N : 2], COMMANDED)[0, 1] if i + 2 * N <= x.size else -1)
    assert found.start == pytest.approx(best * LOGGED, abs=STEP)
    held = (x[best : best + 2 * N : 2] + x[best + 1 : best + 2 * N : 2]) / 2
    assert found.controls[0].correlation == pytest.approx(np.corrcoef(held, COMMANDED)[0, 1], abs=0.02)
    assert found.controls[0].rms == pytest.approx(np.sqrt(np.mean((held - COMMANDED) ** 2)), rel=0.1)


def test_two_controls_agree_on_one_start():
    time = np.arange(1600) * LOGGED
    rudder = 0.1 * np.sign(np.sin(2 * np.pi * TIME / 5))
    place = np.clip(((time - 20.0) / STEP + 1e-9).astype(int), 0, N - 1)
    inside = (time >= 20.0) & (time < 60.0)
    columns = {"n": np.where(inside, COMMANDED[place], 125.0), "delta_r": np.where(inside, rudder[place], 0.0)}
    found = match_schedule(record(columns, time), TIME, {"n": COMMANDED, "delta_r": rudder}, "mine.csv")
    assert found.start == pytest.approx(20.0, abs=0.06)
    assert [one.name for one in found.controls] == ["n", "delta_r"]


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: logged(12.0, gain=60 / (2 * np.pi)), "rpm read as rad/s"),
        (lambda: logged(12.0, gain=-1.0), "the opposite of the commands of mine.csv"),
        (lambda: logged(500.0, noise=1.0), "no stretch in which n moves as in mine.csv"),
        (lambda: record({"delta_r": np.zeros(1600)}, np.arange(1600) * LOGGED), "one that mine.csv moves: n"),
    ],
)
def test_what_is_no_log_of_the_trial_is_refused(made, said):
    with pytest.raises(InputError, match=said):
        match_schedule(made(), TIME, {"n": COMMANDED}, "mine.csv")


def test_a_control_that_hardly_follows_is_told():
    found = match_schedule(logged(12.0, lag=4.0), TIME, {"n": COMMANDED}, "mine.csv")
    assert "did not follow the command well" in found.cautions[0]
