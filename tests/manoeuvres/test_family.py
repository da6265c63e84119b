"""Every shape as one would say it, in naive loops; its limits, its edges, its batches."""

import jax
import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits, check_limits
from seatrial.manoeuvres.shapes import SHAPES

TRIM, AMPLITUDE = 80.0, 20.0
EVERY = pytest.mark.parametrize("kind", SHAPES)


def family(**settings):
    return Family(**{"control": "n", "trim": TRIM, "duration": 60.0, "active": 40.0, "sample_time": 0.01, **settings})


def control(period, **settings):
    member = family(**settings)
    return member.time(), np.asarray(member.signal(AMPLITUDE, period, member.time()))


def naive_levels(time, levels, hold, start):
    """Levels one after another, written as one would say them."""
    held = np.full(time.shape, TRIM)
    for i, level in enumerate(levels):
        since = time - start - i * hold
        held[(since >= -1e-9) & (since < hold - 1e-9)] = TRIM + AMPLITUDE * level
    return held


def a_period(kind):
    return 2.0 if SHAPES[kind].longest(40.0) < 10.0 or kind in ("telegraph", "prbs", "random-steps") else 10.0


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
    time, held = control(period, start=start, active=active)
    assert np.array_equal(held, naive_levels(time, [1.0, -1.0] * count, period / 2, start))


@pytest.mark.parametrize(
    ("kind", "period", "hold", "levels"),
    [
        ("step", 12.0, 12.0, [1]),
        ("turning-circle", 39.0, 39.0, [1]),
        ("free-decay", 12.0, 12.0, [-1]),
        ("doublet", 12.0, 6.0, [1, -1]),
        ("multistep-3211", 14.0, 2.0, [1, 1, 1, -1, -1, 1, -1] * 2),
        ("spiral", 2.0, 2.0, [1, 0.6, 0.3, 0.1, 0, -0.1, -0.3, -0.6, -1, -0.6, -0.3, -0.1, 0, 0.1, 0.3, 0.6, 1]),
    ],
)
def test_levels_one_after_another(kind, period, hold, levels):
    time, held = control(period, kind=kind)
    assert np.allclose(held, naive_levels(time, levels, hold, 1.0), atol=1e-12)


@EVERY
def test_every_shape_keeps_to_its_amplitude_and_comes_home(kind):
    time, held = control(a_period(kind), kind=kind)
    assert np.abs(held - TRIM).max() <= AMPLITUDE * (1 + 1e-12)
    assert np.ptp(held) >= 0.8 * AMPLITUDE
    assert np.allclose(held[(time < 1.0 - 1e-6) | (time > 41.0 + 1e-6)], TRIM, rtol=1e-13)


@pytest.mark.proof
@EVERY
def test_every_shape_is_the_same_in_batches(kind):
    member, amplitudes, periods = family(kind=kind), np.array([5.0, 20.0]), np.array([2.0, 2.3])
    time = member.time()
    together = np.asarray(member.signal(amplitudes[:, None], periods[:, None], time))
    mapped = jax.vmap(lambda a, p: member.signal(a, p, time))(amplitudes, periods)
    one_by_one = [member.manoeuvre(a, p).sample(0.01)[1] for a, p in zip(amplitudes, periods, strict=True)]
    assert np.allclose(together, one_by_one, atol=1e-12)
    assert np.allclose(mapped, one_by_one, atol=1e-12)


@pytest.mark.parametrize("kind", [kind for kind in SHAPES if kind not in ("multisine", "chirp")])
def test_ramps_keep_the_rate(kind):
    ramp = 0.4
    member = family(kind=kind, ramp=ramp)
    fastest = 2 * AMPLITUDE / ramp
    check_limits(member.manoeuvre(AMPLITUDE, 5.0 if kind == "multistep-3211" else 2.0), Limits(rate=fastest), 0.01)
    edges = np.abs(np.diff(member.signal(AMPLITUDE, 2.0, member.time()))).max() / 0.01
    assert edges >= 0.49 * fastest * (1 - 1e-6)


@pytest.mark.parametrize(("period", "ramp"), [(10.0, 0.5), (10.0, 5.0), (7.0, 2.0)])
def test_ramped_edges_of_doublets(period, ramp):
    count = int(40 / period)
    levels = [0.0, *[1.0, -1.0] * count, 0.0]
    edges = 1.0 + 0.5 * period * np.arange(2 * count + 1)
    knots = np.column_stack([edges, edges + ramp]).ravel()
    heights = np.column_stack([levels[:-1], levels[1:]]).ravel()
    time, held = control(period, ramp=ramp)
    assert np.allclose(held, TRIM + AMPLITUDE * np.interp(time, knots, heights), atol=1e-6)


def test_random_levels_have_the_moments_of_their_kind():
    """Of 2000 levels, to four standard errors: uniform levels have variance 1/3 and fourth moment 1/5."""
    whole = {"start": 0.0, "duration": 2000.0, "active": 2000.0, "sample_time": 1.0}
    uniform, signs = (
        (control(1.0, kind=kind, seed=7, **whole)[1] - TRIM) / AMPLITUDE for kind in ("random-steps", "telegraph")
    )
    assert abs(uniform.mean()) < 4 * np.sqrt(1 / 3 / 2000)
    assert abs((uniform**2).mean() - 1 / 3) < 4 * np.sqrt(4 / 45 / 2000)
    assert set(signs) == {-1.0, 1.0}
    assert abs(signs.mean()) < 4 / np.sqrt(2000)
    assert abs((signs[1:] * signs[:-1]).mean()) < 4 / np.sqrt(2000)


def test_maximal_sequence_is_white():
    """A period of 127: one more of one sign than of the other, and autocorrelation -1/127 at every lag."""
    whole = {"start": 0.0, "duration": 127.0, "active": 127.0, "sample_time": 1.0}
    levels = (control(1.0, kind="prbs", seed=3, **whole)[1] - TRIM) / AMPLITUDE
    assert abs(levels.sum()) == 1
    assert {round(float(levels @ np.roll(levels, lag))) for lag in range(1, 127)} == {-1}


def test_seeds_draw_other_levels():
    for kind in ("random-steps", "telegraph", "prbs"):
        held = [control(2.0, kind=kind, seed=seed)[1] for seed in (7, 7, 8)]
        assert np.array_equal(held[0], held[1])
        assert not np.array_equal(held[0], held[2])


def test_multisine_has_its_harmonics_and_low_peaks():
    """Ten equal lines and no other, and a crest factor below 2, of a sine 1.41, of ten in phase 4.5."""
    _, held = control(10.0, kind="multisine", start=0.0, active=10.0, duration=10.0)
    power = np.abs(np.fft.rfft(held - TRIM)) ** 2
    assert np.allclose(power[1:11], power[1], rtol=1e-6)
    assert power[11:].max() < 1e-9 * power[1]
    assert np.abs(held - TRIM).max() / (held - TRIM).std() < 2.0


def test_chirp_grows_exponentially_from_its_period():
    """Sixteen waves, of 16.8 that would fit; the k-th ends at 40 ln(1 + 7 k / 16) / ln 8."""
    time, held = control(8.0, kind="chirp", sample_time=0.001)
    rising = time[1:][(held[:-1] < TRIM) & (held[1:] >= TRIM) & (time[1:] < 40.9)]
    assert np.allclose(rising - 1.0, 40.0 * np.log(1 + 7 * np.arange(1, 16) / 16) / np.log(8), atol=0.0011)
    assert pytest.approx(7 * 40.0 / np.log(8) / 8.0, abs=0.05) == 16.8


@pytest.mark.parametrize(
    ("settings", "period", "message"),
    [
        ({}, 41.0, "to 40 s, so that it fits into 40 s"),
        ({}, 0.0, "a period from 0.02 s"),
        ({}, -1.0, "a period from"),
        ({}, float("nan"), "a period from"),
        ({"ramp": 5.1}, 10.0, "from 10.2 s"),
        ({"kind": "spiral"}, 3.0, "to 2.353 s"),
        ({"kind": "chirp"}, 0.1, "from 0.16 s"),
    ],
)
def test_periods_that_do_not_fit(settings, period, message):
    with pytest.raises(InputError, match=f"(?s){message}"):
        family(**settings).manoeuvre(AMPLITUDE, period)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"start": -1.0}, "start.*-1.0.*0 or more"),
        ({"start": 20.5}, "an end within the duration"),
        ({"active": float("nan")}, "active.*nan.*finite number, above 0"),
        ({"active": "40 s"}, "active.*'40 s'"),
        ({"duration": float("inf")}, "duration.*inf"),
        ({"sample_time": 0.0}, "sample_time.*above 0"),
        ({"sample_time": 7.0}, "a tenth of the duration at most"),
        ({"sample_time": 1e-9}, "at most 200000 samples"),
        ({"trim": float("nan")}, "trim.*nan"),
        ({"control": None}, "control.*None"),
        ({"seed": 1.5}, "seed.*whole number"),
        ({"seed": -1}, "seed.*0 or more"),
        ({"ramp": -0.1}, "ramp.*-0.1"),
        ({"kind": "doublets"}, 'did you mean "doublet"'),
    ],
)
def test_impossible_families(settings, message):
    with pytest.raises(InputError, match=f"(?s){message}"):
        family(**settings)


@pytest.mark.parametrize(
    ("arguments", "held", "message"),
    [
        ((float("nan"), 8.0), {}, "amplitude"),
        ((AMPLITUDE, "8 s"), {}, "a period from"),
        ((AMPLITUDE, 8.0), {"n": 1.0}, "this one is driven"),
        ((AMPLITUDE, 8.0), {"delta_r": float("nan")}, "schedule, delta_r"),
    ],
)
def test_impossible_members(arguments, held, message):
    with pytest.raises(InputError, match=message):
        family().schedule(*arguments, **held)
