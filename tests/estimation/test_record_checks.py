"""What a record's own motion says about its channel map: signs, units, clocks, spikes, and what it can tell."""

import numpy as np
import pytest

from seatrial.estimation.diagnostics.excitation_checks import check_excitation, check_signs
from seatrial.estimation.diagnostics.motion_checks import (
    _correlation,
    best_lag,
    check_motion,
    check_sum,
    check_turn,
    says_direction,
)
from seatrial.estimation.diagnostics.record_checks import (
    _scatter,
    _standing_out,
    check_angle,
    check_limits,
    check_samples,
    check_trim,
    unit_errors,
)
from seatrial.manoeuvres.manoeuvre import Limits

STEP = 0.1
TIME = np.arange(600) * STEP
EXPECTED = np.sin(0.5 * TIME) + 0.3 * np.sin(1.7 * TIME)
ALIKE = EXPECTED[None]
"""Vehicles drawn from priors that say exactly what is expected."""
NOISE = 0.02 * np.random.default_rng(1).normal(size=TIME.size)


def levels(findings):
    return {finding.code: finding.level for finding in findings}


def errors_of(findings):
    """Unit errors that the size of a motion suggests."""
    return [error for one in findings if one.code == "size-unlike" for error, _ in one.values["errors"]]


def test_a_record_as_expected_passes():
    assert levels(check_motion("u", TIME, 1.3 * EXPECTED + NOISE, EXPECTED, ALIKE)) == {
        "direction-reversed": "pass",
        "size-unlike": "pass",
    }


def test_a_channel_of_the_wrong_sign():
    (finding,) = check_motion("r", TIME, -EXPECTED + NOISE, EXPECTED, ALIKE)
    assert (finding.code, finding.level, finding.remedies) == ("direction-reversed", "alarm", ("reverse-sign",))


@pytest.mark.parametrize(("factor", "error"), [(60.0, "rpm for rev/s"), (30 / np.pi, "rpm")])
def test_nobody_counts_a_propeller_in_degrees(factor, error):
    assert unit_errors(("n",), factor)["errors"] == ((error, ("n",)),)
    assert unit_errors(("n_2",), 1 / factor)["errors"] == ((error, ("n_2",)),)


def test_the_order_of_thrusters_is_named_before_the_sign_of_what_they_turn():
    (found,) = check_motion("r", TIME, NOISE - EXPECTED, EXPECTED, ALIKE, mirrored=("f_1", "f_2"))
    assert found.values["mirrored"] == ("f_1", "f_2")


@pytest.mark.parametrize(
    ("factor", "errors"),
    [
        (180 / np.pi, (("degrees", ("r", "delta_r")),)),
        (np.pi / 180, (("degrees", ("r", "delta_r")),)),
        (11.0, (("rpm", ("r",)), ("kgf", ("tau_X",)))),
        (1000.0, ()),
    ],
)
def test_the_unit_of_a_control_explains_a_size_as_well(factor, errors):
    found = check_motion("r", TIME, factor * EXPECTED, EXPECTED, ALIKE, controls=("delta_r", "tau_X"))
    (size,) = [finding for finding in found if finding.code == "size-unlike"]
    assert (size.values["signals"], size.values["errors"]) == (("r", "delta_r", "tau_X"), errors)


@pytest.mark.parametrize(("widest", "level"), [(8.0, "pass"), (1.5, "caution")])
def test_a_size_that_wide_priors_allow_is_no_doubt_of_a_unit(widest, level):
    """4.4 is the ratio of a pound-force to a newton, and within what vehicles of the wide priors show."""
    wide = np.geomspace(1 / widest, widest, 21)[:, None] * EXPECTED
    found = check_motion("u", TIME, 4.4 * EXPECTED, EXPECTED, wide, controls=("tau_X",))
    (size,) = [finding for finding in found if finding.code == "size-unlike"]
    assert size.level == level
    assert "lbf" in errors_of(found)
    assert size.remedies == (("check-unit",) if level == "caution" else ())


def test_a_fin_beyond_a_quarter_turn_is_in_degrees():
    (found,) = check_angle("delta_r", 14.3 * EXPECTED / np.abs(EXPECTED).max())
    assert (found.subject, found.code, found.level) == (("delta_r",), "angle-too-large", "caution")
    assert found.values["reached"] == pytest.approx(14.3)
    assert found.values["errors"] == (("degrees", ("delta_r",)),)
    assert check_angle("delta_r", np.array([-1.5, 1.5])) == []
    assert check_angle("n", np.array([0.0, 100.0])) == []


def test_a_control_that_stays_within_a_thirtieth_of_its_limits():
    limits = Limits(-0.35, 0.35)
    (found,) = check_limits("delta_r", 0.25 * np.pi / 180 * np.sign(EXPECTED), limits)
    assert (found.code, found.values["bound"]) == ("limits-hardly-used", 0.35)
    assert found.values["reached"] == pytest.approx(np.radians(0.25))
    assert found.values["errors"] == (("degrees", ("delta_r",)),)
    assert check_limits("delta_r", 0.02 * np.sign(EXPECTED), limits) == []
    assert check_limits("delta_r", 0.0 * EXPECTED, limits) == []


def test_a_delay_that_a_slower_vehicle_of_the_priors_explains_is_not_told():
    slower = np.vstack([EXPECTED, np.roll(EXPECTED, 5)])
    assert "clock-shift" not in levels(check_motion("u", TIME, np.roll(EXPECTED, 5) + NOISE, EXPECTED, slower))


def test_a_motion_that_is_not_that_of_the_commands():
    measured = np.random.default_rng(2).normal(size=TIME.size)
    assert levels(check_motion("u", TIME, measured, EXPECTED, ALIKE)) == {"motion-unrelated": "caution"}


def test_gaps_do_not_matter():
    gappy = np.where(np.arange(TIME.size) % 5 == 0, EXPECTED, np.nan)
    assert levels(check_motion("u", TIME, gappy, EXPECTED, ALIKE)) == {
        "direction-reversed": "pass",
        "size-unlike": "pass",
    }


def test_spikes_are_told_and_steep_quiet_signals_are_not():
    steep = 5.0 * EXPECTED + 1e-4 * NOISE
    assert check_samples("u", steep, 0.02, "u")[0].level == "pass"
    spiky = steep.copy()
    spiky[::100] += 3.0
    (finding,) = check_samples("u", spiky, 0.02, "u")
    assert (finding.level, finding.remedies) == ("caution", ("heavy-residuals",))


@pytest.mark.parametrize("together", [1, 2, 3])
@pytest.mark.parametrize(("share", "most"), [(0.004, 1.0), (0.15, 2.0)], ids=["few", "many, some next to one another"])
def test_spikes_alone_and_together_are_counted(together, share, most):
    rng = np.random.default_rng(4)
    time = np.arange(4000) * STEP
    clean = np.sin(0.5 * time) + 0.02 * rng.normal(size=time.size)
    first = rng.random(time.size) < share / together
    spiked = np.any([np.roll(first, steps) for steps in range(together)], axis=0)
    (finding,) = check_samples("u", clean + 2.0 * spiked, 0.02, "u")
    assert finding.level == "caution"
    assert 0.75 * spiked.mean() < finding.values["share"] < (most + 0.05) * spiked.mean()


@pytest.mark.parametrize(
    "motion",
    [
        np.where(TIME < 40, 0.0, np.sin(0.8 * (TIME - 40))),
        np.abs(TIME % 12 - 6),
        np.where(TIME % 20 < 10, 0.0, 1.0),
        np.cumsum(np.where(TIME % 14 < 7, 0.1, -0.1) * np.exp(-(TIME % 7))),
        TIME % 12,
        -TIME % 12,
    ],
    ids=[
        "a turn after quiet",
        "kinks",
        "steps",
        "rates that jump and fade",
        "ramps that end in a step",
        "steps that begin a ramp",
    ],
)
def test_motion_that_turns_is_no_outlier(motion):
    quiet = 1e-4 * np.random.default_rng(5).normal(size=TIME.size)
    assert check_samples("r", motion + quiet, 1e-4, "r")[0].values["share"] == 0.0


def test_whether_priors_say_a_direction():
    gains = np.random.default_rng(6).normal(size=32)
    still, lost = np.zeros((32, TIME.size)), np.full((4, TIME.size), np.nan)
    one_way = np.abs(gains)[:, None] * EXPECTED
    assert says_direction(EXPECTED, one_way, 0.01)
    assert says_direction(EXPECTED, np.vstack([one_way[:-4], lost]), 0.01)
    assert not says_direction(EXPECTED, np.vstack([one_way[:4], *[lost] * 4]), 0.01)
    assert not says_direction(EXPECTED, gains[:, None] * EXPECTED, 0.01)
    assert not says_direction(0.0 * EXPECTED, one_way, 0.01)
    assert says_direction(0.0 * EXPECTED, still, 0.01)


@pytest.mark.parametrize(
    ("names", "u", "pairs"),
    [
        (("X_uu", "X_uabsu", "T_nabsn"), [0.3, 1.0, 2.0], [("X_uu", "X_uabsu")]),
        (("X_uu", "X_uabsu"), [-0.3, -1.0, np.nan], [("X_uu", "X_uabsu")]),
        (("X_uu", "X_uabsu"), [-0.05, 0.1, 2.0], [("X_uu", "X_uabsu")]),  # at rest, as far as the noise shows
        (("X_uu", "X_uabsu"), [-0.3, 1.0, 2.0], []),
        (("X_u", "X_uabsu"), [0.3, 1.0, 2.0], []),
        (("Y_vv", "Y_vabsv"), [0.3, 1.0, 2.0], []),  # not measured: nothing is said
    ],
)
def test_terms_that_are_one_until_a_signal_changes_its_sign(names, u, pairs):
    found = check_signs(names, {"u": np.array(u), "n": np.ones(3)}, {"u": 0.05})
    assert [one.subject for one in found] == pairs
    assert all(one.values["signals"] == ("u",) for one in found)


def test_scatter_of_white_noise_is_its_standard_deviation():
    """Within 5 %, by 20 000 samples; three spiked bends among 51 raise their quartile by 5 % more."""
    noise = 0.3 * np.random.default_rng(1).normal(size=20_000)
    spiked = noise + np.where(np.arange(noise.size) % 400 == 7, 50.0, 0.0)
    assert np.median(_scatter(noise)) == pytest.approx(0.3, rel=0.05)
    assert np.median(_scatter(spiked)) == pytest.approx(0.3, rel=0.08)


@pytest.mark.parametrize(
    ("name", "factor", "level", "error"),
    [
        ("r", 2.9, "pass", ""),
        ("r", 1 / 2.9, "pass", ""),
        ("r", 3.2, "caution", "revolutions"),
        ("r", 1 / 3.2, "caution", "revolutions"),
        ("r", 1.05 * 2 * np.pi, "caution", "revolutions"),
        ("r", 0.9 * 30 / np.pi, "caution", "rpm"),
        ("r", np.pi / 30, "caution", "rpm"),
        ("r", 2.3 * 30 / np.pi, "caution", "rpm"),
        ("r", 0.45 * 180 / np.pi, "caution", "degrees"),
        ("r", 0.55 * 180 / np.pi, "alarm", "degrees"),
        ("r", 2.9 * 180 / np.pi, "alarm", "degrees"),
        ("r", 3.1 * 180 / np.pi, "alarm", None),
        ("u", 3.28, "caution", "feet"),
        ("u", 15.0, "caution", None),
        ("u", 29.0, "caution", None),
        ("u", 31.0, "alarm", None),
        ("u", 2.9 * 100, "alarm", "centimetres"),
        ("u", 0.4 * 1000, "alarm", "millimetres"),
        ("u", 2.9 * 1000, "alarm", "millimetres"),
        ("u", 3.1 * 1000, "alarm", None),
        ("u", 1 / 650, "alarm", "millimetres"),
    ],
)
def test_a_unit_is_named_within_a_factor_of_three_of_it(name, factor, level, error):
    """The nearest confusion of the quantity, or its inverse; three times the motion expected is none yet, thirty times is wrong."""
    found = check_motion(name, TIME, factor * EXPECTED, EXPECTED, ALIKE)
    size = next(one for one in found if one.code == "size-unlike")
    assert size.level == level
    assert level == "pass" or errors_of(found)[:1] == ([error] if error else [])
    assert size.values["ratio"] == pytest.approx(factor, rel=0.01)


@pytest.mark.parametrize(
    ("correlation", "level"), [(-0.45, "alarm"), (-0.35, "caution"), (0.45, "caution"), (0.55, "pass")]
)
def test_direction_by_the_correlation(correlation, level):
    """A channel goes the other way below -0.4, and size and timing are told from 0.5 on."""
    rng = np.random.default_rng(3)
    other = rng.normal(size=TIME.size)
    for _ in range(2):  # at every lag that is tried the other part says nothing
        other -= EXPECTED * (other @ EXPECTED) / (EXPECTED @ EXPECTED)
    mean = EXPECTED - EXPECTED.mean()
    other -= other.mean() + mean * (other @ mean) / (mean @ mean)
    mixed = correlation * mean / mean.std() + np.sqrt(1 - correlation**2) * other / other.std()
    found = check_motion("u", TIME, mixed, EXPECTED, ALIKE)
    assert found[0].level == level
    assert ("size-unlike" in levels(found)) == (level == "pass")


@pytest.mark.parametrize(
    ("steps", "has_delay", "level", "remedy"),
    [
        (5, False, "caution", "delay-prior"),
        (5, True, "note", "check-delay-prior"),
        (-5, True, "caution", "one-clock"),
    ],
)
def test_what_to_do_about_a_delay(steps, has_delay, level, remedy):
    found = check_motion("u", TIME, np.roll(EXPECTED, steps) + NOISE, EXPECTED, ALIKE, has_delay)
    (timing,) = [one for one in found if one.code == "clock-shift"]
    assert (timing.level, timing.remedies) == (level, (remedy,))


@pytest.mark.parametrize("size", [25, 40, 300])
def test_scatter_around_a_sample_by_a_naive_twin(size):
    """Quartile of the bends of up to 25 samples on either side, or of half the record; the ends are mirrored."""
    x = np.cumsum(np.random.default_rng(7).normal(size=size) * np.linspace(1, 5, size))
    bends = [abs(x[i - 1] - 2 * x[i] + x[i + 1]) / np.sqrt(6) for i in range(1, size - 1)]
    around = min(25, len(bends) // 2)

    def bend(i):
        """Of the sample i, mirrored at the first and last that bend."""
        at = i - 1
        at = -at if at < 0 else at
        return bends[2 * (len(bends) - 1) - at if at >= len(bends) else at]

    naive = [np.quantile([bend(j) for j in range(i - around, i + around + 1)], 0.25) / 0.3186 for i in range(size)]
    np.testing.assert_allclose(_scatter(x), naive, rtol=1e-12)


@pytest.mark.parametrize(("samples", "judged"), [(24, 0), (25, 1)])
def test_records_of_a_few_samples_are_not_searched_for_outliers(samples, judged):
    assert len(check_samples("u", NOISE[:samples], 0.02, "u")) == judged
    gappy = np.where(np.arange(600) < samples, NOISE, np.nan)
    assert len(check_samples("u", gappy, 0.02, "u")) == judged


@pytest.mark.parametrize(("spikes", "level"), [(1, "pass"), (2, "caution")])
@pytest.mark.parametrize(("size", "counts"), [(7.0, False), (10.0, True), (-10.0, True)])
def test_samples_stand_out_from_eight_deviations_on(spikes, level, size, counts):
    """Two in a thousand are told; a quiet signal's deviation is that of its sensor at least."""
    x = np.zeros(1000)
    x[np.arange(spikes) * 300 + 200] = size * 0.02
    (finding,) = check_samples("u", x, 0.02, "u")
    assert finding.level == (level if counts else "pass")
    assert finding.values["share"] == pytest.approx(counts * spikes / 1000)


@pytest.mark.parametrize(("left", "level"), [(0.69, "pass"), (0.71, "caution")])
def test_excitation_from_thirty_percent_on(left, level):
    (finding,) = check_excitation(["X_u"], np.array([2.0]), np.array([2.0 * left]), "fit")
    assert finding.level == level
    assert (finding.code, finding.values["about"]) == ("not-excited", "fit")
    assert finding.values["remaining"] == pytest.approx(left)


def test_lag_by_a_naive_twin():
    """Of all shifts up to a quarter of the record the one of largest correlation of either sign; pairs with a gap do not count."""
    rng = np.random.default_rng(9)
    measured, expected = rng.normal(size=(2, 60))
    measured[rng.random(60) < 0.2] = np.nan

    def correlation(lag):
        pairs = [(measured[i], expected[i - lag]) for i in range(60) if 0 <= i - lag < 60 and np.isfinite(measured[i])]
        return np.corrcoef(np.array(pairs).T)[0, 1]

    best = max(range(-15, 16), key=lambda lag: abs(correlation(lag)))
    assert best_lag(measured, expected, 40) == (best, pytest.approx(correlation(best)))
    assert best_lag(np.ones(60), expected, 5) == (0, 0.0)


def test_how_far_samples_stand_out_by_a_naive_twin():
    """Beyond both sides and where the lines through two samples of each lead, of spikes of up to three; the ends are held."""
    x = np.cumsum(np.random.default_rng(10).normal(size=40))

    def at(i):
        return x[min(max(i, 0), 39)]

    def beyond(i, before, after):
        sides = [(i - before, i - before - 1), (i + after, i + after + 1)]
        lines = [np.polyfit(places, [at(place) for place in places], 1) for places in sides]
        led = [*(np.polyval(line, i) for line in lines), *(at(near) for near, _ in sides)]
        return max(x[i] - max(led), min(led) - x[i])

    ways = [(1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (3, 1)]
    naive = [max(0.0, *(beyond(i, *way) for way in ways)) for i in range(40)]
    assert np.count_nonzero(naive) > 10
    np.testing.assert_allclose(_standing_out(x), naive, atol=1e-9)


@pytest.mark.parametrize("steps", [5, -12])
def test_a_shift_is_reported_in_seconds(steps):
    found = check_motion("u", TIME, np.roll(EXPECTED, steps) + NOISE, EXPECTED, ALIKE)
    (timing,) = [finding for finding in found if finding.code == "clock-shift"]
    assert timing.values["late"] == pytest.approx(steps * STEP, abs=0.06)
    assert 0 < timing.values["error"] < 1
    assert {finding.subject for finding in found} == {("u",)}


@pytest.mark.parametrize(("steps", "found"), [(15, True), (-15, True), (16, False), (-16, False)])
def test_shifts_are_sought_up_to_a_quarter_of_the_record(steps, found):
    expected = np.random.default_rng(11).normal(size=60)
    lag, correlation = best_lag(np.roll(expected, steps), expected, 40)
    assert (lag == steps) == found
    assert (correlation > 0.99) == found


def test_outliers_are_told_of_their_channel():
    spiky = np.where(np.arange(600) % 100 == 50, 1.0, NOISE)
    for values, level in ((NOISE, "pass"), (spiky, "caution")):
        (finding,) = check_samples("r", values, 0.02, "r")
        assert (finding.subject, finding.code, finding.level) == (("r",), "outliers", level)
    (finding,) = check_samples("q_w", spiky, 0.02, "attitude")
    assert finding.values["sensor"] == "attitude"


@pytest.mark.parametrize(("against", "lost", "says"), [(8, 0, True), (9, 0, False), (0, 24, True), (0, 25, False)])
def test_three_quarters_of_the_vehicles_left_say_a_direction_and_a_quarter_must_be_left(against, lost, says):
    way = np.where(np.arange(32) < against, -1.0, 1.0)
    way[32 - lost :] = np.nan
    assert says_direction(EXPECTED, way[:, None] * EXPECTED, 0.01) == says


@pytest.mark.parametrize(("moved", "lost", "says"), [(0.9, 0, True), (1.1, 0, False), (0.9, 1, False)])
def test_vehicles_that_move_by_less_than_the_noise_say_that_a_channel_stays_still(moved, lost, says):
    """Half go either way; one that runs away does not stay still."""
    drawn = 0.01 * moved / np.ptp(EXPECTED) * np.where(np.arange(32) % 2, 1.0, -1.0)[:, None] * EXPECTED
    drawn[:lost] = np.nan
    assert says_direction(EXPECTED, drawn, 0.01) == says


def test_a_correlation_takes_ten_pairs():
    assert _correlation(EXPECTED[:10], EXPECTED[:10]) == pytest.approx(1.0)
    assert _correlation(EXPECTED[:9], EXPECTED[:9]) == 0.0


@pytest.mark.parametrize(
    ("names", "signs", "is_enu"), [("uvw", (1, -1, -1), True), ("vw", (-1, -1), True), ("uvw", (-1, -1, 1), False)]
)
def test_forward_left_up_is_named(names, signs, is_enu):
    motion = np.random.default_rng(3).normal(size=(200, len(names)))
    (finding,) = check_turn(tuple(names), motion * signs, motion)
    assert finding.level == "alarm"
    assert ("enu-axes" in finding.remedies) == is_enu


def test_a_sum_of_errors_is_judged_where_vehicles_of_the_priors_are_alike_and_none_explains_it():
    drift = np.linspace(-5.0, 5.0, 8)[:, None] * np.linspace(0.0, 1.0, EXPECTED.size)
    assert check_sum("z", TIME, -EXPECTED + NOISE, EXPECTED, EXPECTED + drift * EXPECTED.std(), 0.01) is None
    assert levels(check_sum("z", TIME, -EXPECTED + NOISE, EXPECTED, ALIKE, 0.01)) == {"direction-reversed": "alarm"}
    assert check_sum("z", TIME, EXPECTED + NOISE, EXPECTED, ALIKE, 0.01) is None
    (size,) = check_sum("z", TIME, 100.0 * EXPECTED, EXPECTED, ALIKE, 0.01)
    assert (size.code, size.level) == ("size-unlike", "alarm")
    assert check_sum("z", TIME, EXPECTED, EXPECTED, np.full((3, EXPECTED.size), np.inf), 0.01) is None


TRIM = {"u": 1.5, "n": 100.0}


def doublet(settles, start=1.5, low=80.0):
    """Control to both sides of its trim, and the speed of a vehicle of square drag that settles in so many seconds, by Euler's rule."""
    n, u = np.where(np.sin(2 * np.pi * TIME / 16.0) < 0, low, 120.0), [start]
    for w in n[:-1]:
        u.append(u[-1] + STEP * ((1.5 * w / 100.0) ** 2 - u[-1] * abs(u[-1])) / (3.0 * settles))
    return n, np.array(u) + NOISE


@pytest.mark.parametrize("settles", [0.5, 3.0, 10.0])
@pytest.mark.parametrize(("factor", "told"), [(1.0, None), (1.94384, "knots"), (3.28084, "feet")])
def test_a_speed_is_held_against_its_trim_between_the_values_of_a_doublet(settles, factor, told):
    n, u = doublet(settles)
    found = check_trim(TRIM, {"n": n}, {"u": factor * u})
    assert [one.subject for one in found] == [("u",)] * bool(told)
    assert all(told in [error for error, _ in one.values["errors"]] for one in found)


def test_no_speed_is_held_against_its_trim_on_the_way_there_or_on_one_side_of_it():
    n, u = doublet(200.0, start=0.0)
    assert check_trim(TRIM, {"n": n}, {"u": u}) == []
    n, u = doublet(3.0, low=115.0)
    assert check_trim(TRIM, {"n": n}, {"u": 3.0 * u}) == []
