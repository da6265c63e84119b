"""Several controls at once: orthogonal over whole periods, of low peaks, inside the active time, and each by its own amplitude."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.design.sweep import inside_limits
from seatrial.manoeuvres.family import Beside, Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import schedule_of
from seatrial.manoeuvres.shapes import SHAPES, low_peak_phases

NAMES = ("n", "delta_r", "delta_s", "tau_X")


def family(kind, count, **settings):
    beside = tuple(Beside(name, 0.0, 0.5 + k) for k, name in enumerate(NAMES[1:count]))
    settings = {"duration": 100.0, "active": 90.0, "sample_time": 0.01, "start": 2.0, "seed": 3, **settings}
    return Family("n", 10.0, kind=kind, beside=beside, **settings)


def shares(made, period):
    """What each control runs, its trim and amplitude taken away."""
    found = made.signals(4.0, period, made.time())
    ratios = {made.control: 4.0, **{one.control: 4.0 * one.ratio for one in made.beside}}
    trims = {made.control: made.trim, **{one.control: one.trim for one in made.beside}}
    return np.array([(np.asarray(found[name]) - trims[name]) / ratios[name] for name in found])


def correlations(made, period):
    found = shares(made, period)
    norm = np.sqrt((found**2).sum(1))
    return (found @ found.T / np.outer(norm, norm))[np.triu_indices(len(found), 1)]


@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize(("kind", "most"), [("multisine", 1e-6), ("telegraph", 0.5), ("prbs", 0.35), ("step", 1e-9)])
def test_controls_that_move_together_can_be_told_apart(kind, most, count):
    period = {"telegraph": 1.0, "prbs": 0.7, "multisine": 40.0, "step": 20.0}[kind]
    assert np.abs(correlations(family(kind, count), period)).max() < most


@pytest.mark.parametrize("count", [2, 3, 4])
def test_doublets_are_orthogonal_but_for_the_ends_at_which_one_of_them_is_still(count):
    """Over whole periods exactly; with n of them in the trial the ends leave one part in 4 n at most."""
    made = family("repeated-doublet", count, active=88.0)
    assert np.abs(correlations(made, 8.0)).max() < 1 / 40
    inside = (made.time() >= 10.0) & (made.time() < 82.0 - 1e-9)
    within = shares(made, 8.0)[:, inside]
    np.testing.assert_allclose(within @ within.T / inside.sum(), np.eye(count), atol=2e-3)


@pytest.mark.parametrize(("kind", "most"), [("repeated-doublet", 1 / 16), ("multisine", 1e-6)])
@pytest.mark.parametrize("longer", [2.0, 0.5])
def test_a_control_may_have_a_period_of_its_own(kind, most, longer):
    """Both end whole: one wave at the frequencies of its own period, and still none that the other one has."""
    made = replace(family(kind, 1, active=88.0), beside=(Beside("delta_r", 0.0, 0.5, longer),))
    assert np.abs(correlations(made, 8.0)).max() < most
    one, two = shares(made, 8.0)
    inside = (made.time() >= 10.0) & (made.time() < 74.0 - 1e-9)
    power = np.abs(np.fft.rfft(two[inside])) ** 2
    waves = np.fft.rfftfreq(inside.sum(), 0.01)[power > 1e-3 * power.max()] * 8.0 * longer
    np.testing.assert_allclose(waves, np.round(waves), atol=1e-6)
    assert waves.min() == pytest.approx(1.0)
    assert 0 < np.abs(one[inside]).max() <= 1 + 1e-4
    assert not made.fits(np.array([88.0 / longer + 1.0, 89.0])).any()


def test_a_3211_beside_another_is_barkers_code_three_levels_later():
    one = shares(family("multistep-3211", 2, active=10.0, sample_time=0.001), 7.0)
    code = np.array([1, 1, 1, -1, -1, 1, -1])
    levels = one[:, 2500:12500:1000]
    np.testing.assert_allclose(levels, [np.r_[code, 0, 0, 0], np.r_[0, 0, 0, code]], atol=1e-9)
    assert abs(levels[0] @ levels[1]) <= 1


@pytest.mark.parametrize("kind", SHAPES)
def test_all_controls_fit_into_the_active_time_and_begin_and_end_at_trim(kind):
    made = family(kind, 3)
    periods = np.linspace(0.5, 60.0, 40)
    for period in periods[made.fits(periods)]:
        found = shares(made, period)
        away = made.time()[(np.abs(found) > 1e-9).any(0)]
        assert away[0] >= 2.0 - 1e-9
        assert away[-1] <= 92.0 + 1e-9
        assert np.abs(found).max() <= 1 + 1e-4
    alone = replace(made, beside=())
    assert made.fits(periods).sum() <= alone.fits(periods).sum()
    assert made.fits(periods).any()


@pytest.mark.parametrize("harmonics", [tuple(range(1, 11)), (1, 3, 5, 7, 9), (2, 5, 8)])
def test_phases_of_a_low_peak(harmonics):
    """On a grid of its own, four times as fine: lower than Schroeder's, and than the best of 400 random ones but for a fiftieth."""
    angle = np.linspace(0, 2 * np.pi, 4 * 64 * max(harmonics) + 1)

    def crest(phases):
        wave = np.cos(np.outer(angle, harmonics) + phases).sum(1)
        return np.abs(wave).max() / np.sqrt(len(harmonics) / 2)

    n = len(harmonics)
    schroeder = crest([-np.pi * i * (i + 1) / n for i in range(n)])
    assert crest(low_peak_phases(harmonics)) <= schroeder * 1.001
    random = np.random.default_rng(4).uniform(-np.pi, np.pi, (400, n))
    assert crest(low_peak_phases(harmonics)) <= 1.02 * min(map(crest, random))


def test_a_schedule_has_every_control_at_its_amplitude():
    made = family("repeated-doublet", 2, sample_time=0.1)
    found = schedule_of(made.manoeuvre(4.0, 8.0), 0.1).controls
    assert list(found) == ["n", "delta_r"]
    assert (np.ptp(found["n"]), np.ptp(found["delta_r"])) == (8.0, 4.0)
    held = made.schedule(4.0, 8.0, delta_s=0.1)
    np.testing.assert_array_equal(held.controls["delta_r"], found["delta_r"])
    with pytest.raises(InputError, match="this one is driven"):
        made.schedule(4.0, 8.0, delta_r=0.1)
    with pytest.raises(InputError, match="each control once"):
        replace(made, beside=(Beside("n", 0.0, 1.0),))


def test_each_control_keeps_its_own_limits():
    made = family("repeated-doublet", 2, sample_time=0.1)
    controls = np.stack([np.column_stack(list(made.signals(a, 8.0, made.time()).values())) for a in (2.0, 4.0)])
    trim = (("n", 10.0), ("delta_r", 0.0))
    assert inside_limits(made, controls, trim, {"delta_r": Limits(-1.5, 1.5)}).tolist() == [True, False]
    assert inside_limits(made, controls, trim, {"n": Limits(upper=13.0)}).tolist() == [True, False]
    assert inside_limits(made, controls, trim, {"delta_s": Limits(upper=0.0)}).tolist() == [True, True]
