"""What a record's own motion says about its channel map: signs, units, clocks, spikes, and what it can tell."""

import numpy as np
import pytest

from seatrial.estimation.record_checks import (
    _scatter,
    best_lag,
    check_excitation,
    check_motion,
    check_samples,
    says_direction,
)

STEP = 0.1
TIME = np.arange(600) * STEP
EXPECTED = np.sin(0.5 * TIME) + 0.3 * np.sin(1.7 * TIME)
NOISE = 0.02 * np.random.default_rng(1).normal(size=TIME.size)


def levels(findings):
    return {finding.check: finding.level for finding in findings}


def test_a_record_as_expected_passes():
    assert levels(check_motion("u", STEP, 1.3 * EXPECTED + NOISE, EXPECTED)) == {"direction": "pass", "size": "pass"}


def test_a_channel_of_the_wrong_sign():
    (finding,) = check_motion("r", STEP, -EXPECTED + NOISE, EXPECTED)
    assert (finding.check, finding.level) == ("direction", "fail")
    assert "scale = -1" in finding.remedy


@pytest.mark.parametrize(
    ("factor", "words"),
    [(180 / np.pi, "degrees"), (np.pi / 30, "rpm"), (1000.0, "millimetres"), (20.0, "check the units")],
)
def test_a_channel_in_another_unit(factor, words):
    found = check_motion("r", STEP, factor * (EXPECTED + NOISE), EXPECTED)
    assert levels(found)["size"] == "caution"
    assert words in next(finding.remedy for finding in found if finding.check == "size")


@pytest.mark.parametrize(("steps", "level"), [(5, "caution"), (-5, "caution"), (-15, "caution"), (0, None)])
def test_a_response_that_is_late_or_early(steps, level):
    found = check_motion("u", STEP, np.roll(EXPECTED, steps) + NOISE, EXPECTED)
    assert levels(found).get("delay") == level
    lag, correlation = best_lag(np.roll(EXPECTED, steps), EXPECTED, 20)
    assert lag == steps
    assert correlation > 0.99


def test_a_motion_that_is_not_that_of_the_commands():
    measured = np.random.default_rng(2).normal(size=TIME.size)
    assert levels(check_motion("u", STEP, measured, EXPECTED)) == {"direction": "caution"}


def test_gaps_do_not_matter():
    gappy = np.where(np.arange(TIME.size) % 5 == 0, EXPECTED, np.nan)
    assert levels(check_motion("u", STEP, gappy, EXPECTED)) == {"direction": "pass", "size": "pass"}


def test_spikes_are_told_and_steep_quiet_signals_are_not():
    steep = 5.0 * EXPECTED + 1e-4 * NOISE
    assert check_samples("u", steep, 0.02)[0].level == "pass"
    spiky = steep.copy()
    spiky[::100] += 3.0
    (finding,) = check_samples("u", spiky, 0.02)
    assert finding.level == "caution"
    assert 'residuals = "heavy"' in finding.remedy


@pytest.mark.parametrize("together", [1, 2, 3])
@pytest.mark.parametrize(("share", "most"), [(0.004, 1.0), (0.15, 2.0)], ids=["few", "many, some next to one another"])
def test_spikes_alone_and_together_are_counted(together, share, most):
    rng = np.random.default_rng(4)
    time = np.arange(4000) * STEP
    clean = np.sin(0.5 * time) + 0.02 * rng.normal(size=time.size)
    first = rng.random(time.size) < share / together
    spiked = np.any([np.roll(first, steps) for steps in range(together)], axis=0)
    (finding,) = check_samples("u", clean + 2.0 * spiked, 0.02)
    assert finding.level == "caution"
    assert 0.75 * spiked.mean() < float(finding.value.split("%")[0]) / 100 < (most + 0.05) * spiked.mean()


@pytest.mark.parametrize(
    "motion",
    [
        np.where(TIME < 40, 0.0, np.sin(0.8 * (TIME - 40))),
        np.abs(TIME % 12 - 6),
        np.where(TIME % 20 < 10, 0.0, 1.0),
        np.cumsum(np.where(TIME % 14 < 7, 0.1, -0.1) * np.exp(-(TIME % 7))),
    ],
    ids=["a turn after quiet", "kinks", "steps", "rates that jump and fade"],
)
def test_motion_that_turns_is_no_outlier(motion):
    quiet = 1e-4 * np.random.default_rng(5).normal(size=TIME.size)
    assert check_samples("r", motion + quiet, 1e-4)[0].value == "0.00% of the samples"


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


def test_coefficients_that_a_record_cannot_tell():
    found = check_excitation(["X_u", "X_uabsu"], np.array([1.0, 2.0]), np.array([0.1, 1.9]))
    assert [finding.level for finding in found] == ["pass", "caution"]
    assert "95% of the prior's sd" in found[1].line


def test_scatter_of_white_noise_is_its_standard_deviation():
    """Within 5 %, by 20 000 samples; three spiked bends among 51 raise their quartile by 5 % more."""
    noise = 0.3 * np.random.default_rng(1).normal(size=20_000)
    spiked = noise + np.where(np.arange(noise.size) % 400 == 7, 50.0, 0.0)
    assert np.median(_scatter(noise)) == pytest.approx(0.3, rel=0.05)
    assert np.median(_scatter(spiked)) == pytest.approx(0.3, rel=0.08)
