import jax
import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.manoeuvres.manoeuvre import Limits, check_limits
from seatrial.manoeuvres.signals import random_steps, repeated_doublet, repeated_doublet_signal

TRIM, AMPLITUDE = 80.0, 20.0


def doublet(**settings):
    defaults = {"trim": TRIM, "amplitude": AMPLITUDE, "period": 10.0, "duration": 60.0, "active": 40.0}
    return repeated_doublet("n", **{**defaults, **settings})


def naive_doublet(time, period, start, active):
    """Step doublets, written as one would say them."""
    control = np.full(time.shape, TRIM)
    begin = start
    while begin + period <= start + active + 1e-9:
        for i, t in enumerate(time):
            if begin - 1e-9 <= t < begin + period / 2 - 1e-9:
                control[i] = TRIM + AMPLITUDE
            elif begin + period / 2 - 1e-9 <= t < begin + period - 1e-9:
                control[i] = TRIM - AMPLITUDE
        begin += period
    return control


@pytest.mark.parametrize(
    ("period", "start", "active", "count"),
    [
        (10.0, 1.0, 40.0, 4),
        (10.0, 0.0, 39.9, 3),
        (13.3, 1.0, 40.0, 3),
        (20.0, 1.0, 40.0, 2),
        (40.0, 5.5, 40.0, 1),
        (0.7, 1.0, 2.1, 3),
        (0.1, 0.3, 0.3, 3),
    ],
)
def test_whole_doublets_then_trim(period, start, active, count):
    time, control = doublet(period=period, start=start, active=active).sample(0.01)
    assert np.array_equal(control, naive_doublet(time, period, start, active))
    assert (np.diff(control) == 2 * AMPLITUDE).sum() == count - 1
    assert (np.diff(control) == -2 * AMPLITUDE).sum() == count
    assert control[-1] == TRIM


@pytest.mark.parametrize(("period", "ramp"), [(10.0, 0.5), (10.0, 5.0), (7.0, 2.0)])
def test_ramped_edges(period, ramp):
    count = int(40 / period)
    levels = [0.0, *[1.0, -1.0] * count, 0.0]
    edges = 1.0 + 0.5 * period * np.arange(2 * count + 1)
    knots = np.column_stack([edges, edges + ramp]).ravel()
    heights = np.column_stack([levels[:-1], levels[1:]]).ravel()
    time, control = doublet(period=period, ramp=ramp).sample(0.01)
    assert np.allclose(control, TRIM + AMPLITUDE * np.interp(time, knots, heights), atol=1e-6)


@pytest.mark.parametrize("ramp", [0.5, 2.0, 5.0])
def test_ramp_keeps_the_rate_limit(ramp):
    fastest = 2 * AMPLITUDE / ramp
    check_limits(doublet(ramp=ramp), Limits(rate=fastest * (1 + 1e-6)), 0.01)
    with pytest.raises(InputError, match="rate limit"):
        check_limits(doublet(ramp=ramp), Limits(rate=0.99 * fastest), 0.01)


def test_settings_broadcast_and_batch():
    time, periods = np.arange(0, 60, 0.05), np.array([5.0, 8.0, 13.0, 50.0])
    settings = {"start": 1.0, "active": 40.0}
    batch = jax.vmap(lambda period: repeated_doublet_signal(time, TRIM, AMPLITUDE, period, **settings))(periods)
    assert np.array_equal(batch, repeated_doublet_signal(time, TRIM, AMPLITUDE, periods[:, None], **settings))
    assert np.array_equal(batch[2], naive_doublet(time, 13.0, 1.0, 40.0))
    assert (np.asarray(batch[3]) == TRIM).all()


def test_manoeuvre_says_what_it_is():
    manoeuvre = doublet()
    assert (manoeuvre.control, manoeuvre.duration) == ("n", 60.0)
    assert manoeuvre.parameters == {
        "trim": TRIM,
        "amplitude": AMPLITUDE,
        "period": 10.0,
        "start": 1.0,
        "active": 40.0,
        "ramp": 0.0,
    }


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"period": 41.0}, "at most the active time, 40 s"),
        ({"period": 0.0}, "more than 0"),
        ({"period": -1.0}, "more than 0"),
        ({"period": float("nan")}, "more than 0"),
        ({"start": -1.0}, "an end within the duration"),
        ({"start": 20.5}, "an end within the duration"),
        ({"ramp": 5.1}, "at most half a period"),
        ({"ramp": -0.1}, "at most half a period"),
    ],
)
def test_impossible_doublet(settings, message):
    with pytest.raises(InputError, match=message):
        doublet(**settings)


def steps(**settings):
    defaults = {"trim": TRIM, "amplitude": AMPLITUDE, "hold": 2.0, "duration": 15.0, "seed": 7}
    return random_steps("n", **{**defaults, **settings})


def test_random_steps_hold_their_level():
    time, control = steps(start=1.0).sample(0.01)
    assert (control[time < 1.0 - 1e-9] == TRIM).all()
    levels = control[100:].reshape(7, 200)
    assert (levels == levels[:, :1]).all()
    assert np.unique(levels[:, 0]).size == 7
    assert (np.abs(levels - TRIM) <= AMPLITUDE).all()


def test_random_steps_are_uniform():
    """Mean and variance of 2000 uniform levels, to four standard errors."""
    _, control = steps(duration=2000.0, hold=1.0).sample(1.0)
    unit = (control - TRIM) / AMPLITUDE
    assert abs(unit.mean()) < 4 * np.sqrt(1 / 3 / 2000)
    assert abs((unit**2).mean() - 1 / 3) < 4 * np.sqrt(4 / 45 / 2000)


def test_random_steps_follow_their_seed():
    assert np.array_equal(steps().sample(0.1)[1], steps().sample(0.1)[1])
    assert not np.array_equal(steps().sample(0.1)[1], steps(seed=8).sample(0.1)[1])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"hold": 0.0}, "hold"),
        ({"hold": 16.0}, "hold"),
        ({"hold": float("nan")}, "hold"),
        ({"start": 20.0}, "start"),
    ],
)
def test_impossible_random_steps(settings, message):
    with pytest.raises(InputError, match=message):
        steps(**settings)
