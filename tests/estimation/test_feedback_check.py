"""Commands that a controller computes from a measured channel, told from commands that are set beforehand; by Euler steps."""

import numpy as np
import pytest

from seatrial.core.findings import Finding
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.diagnostics.feedback_check import find_feedback, not_judged_in_loop

STEP, COUNT, NOISE = 0.1, 1000, 0.02
TIME = STEP * np.arange(COUNT)


def motion(law, noise=NOISE, seed=0, push=0.0):
    """Commands and measured speed of a 30 kg vehicle; the law has all measurements so far, the last of them of this instant."""
    random, u, shown, commands = np.random.default_rng(seed), 0.5, [], []
    disturbance = push * np.cumsum(random.normal(size=COUNT))
    for k in range(COUNT):
        shown.append(u + noise * random.normal())
        commands.append(law(k, shown))
        for _ in range(10):
            u += 0.1 * STEP * (commands[-1] - 6.0 * u * abs(u) + disturbance[k]) / 30.0
    return np.array(commands), np.array(shown)


def find(commands, shown):
    channels = Channel("tau_X", "kg m/s^2", "control"), Channel("u", "m/s", "measurement")
    record = make_record(TIME, {"tau_X": commands, "u": shown}, channels, Provenance("simulated", ""))
    expected = motion(lambda k, _: commands[k], noise=0.0)[1]
    return find_feedback(record, {"u": NOISE}, {"u": expected})


def reference(k):
    return 0.5 + 0.3 * np.sign(np.sin(2 * np.pi * k / 200))


def proportional(k, shown):
    return 40.0 * (reference(k) - shown[-1])


def limited(k, shown):
    return float(np.clip(proportional(k, shown), -15.0, 15.0))


def delayed(k, shown):
    return 40.0 * (reference(k) - shown[max(k - 3, 0)])


def seldom(k, shown):
    """Five times less often than the speed is measured."""
    return 40.0 * (0.5 - shown[k - k % 5])


def integral(k, shown):
    return 40.0 * (0.5 - shown[-1]) + 2.0 * STEP * float(np.sum(0.5 - np.array(shown)))


@pytest.mark.parametrize("law", [proportional, limited, delayed, seldom, integral])
@pytest.mark.parametrize("push", [0.0, 0.6])
def test_a_command_that_is_computed_from_the_speed(law, push):
    assert find(*motion(law, push=push)) == {"tau_X": ("u",)}


RANDOM = np.random.default_rng(5)
SET = {
    "sine": 10.0 * np.sin(TIME),
    "chirp": 10.0 * np.sin(TIME * (1 + TIME / 50)),
    "multisine": sum(3.0 * np.sin(w * TIME + w**2) for w in (0.3, 0.7, 1.1, 1.9, 2.9)),
    "random": 10.0 * RANDOM.normal(size=COUNT),
    "random steps": 10.0 * np.sign(RANDOM.normal(size=COUNT)),
    "random walk": np.cumsum(RANDOM.normal(size=COUNT)),
}


@pytest.mark.parametrize("name", SET)
@pytest.mark.parametrize("noise", [NOISE, 0.1 * NOISE])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_command_that_is_set_beforehand(name, noise, sign):
    """A reversed channel stays one whose sign is wrong, also where the sensor has less noise than is stated."""
    commands, shown = motion(lambda k, _: SET[name][k], noise)
    assert find(commands, sign * shown) == {}


@pytest.mark.parametrize("early", [1, 3])
@pytest.mark.parametrize("name", SET)
def test_a_response_that_is_stamped_too_early_is_no_feedback(name, early):
    commands, shown = motion(lambda k, _: SET[name][k], 0.1 * NOISE)
    assert find(commands, np.roll(shown, -early)) == {}


def test_findings_that_compare_motion_and_commands_are_not_judged_in_a_loop():
    codes = ("direction-reversed", "clock-shift", "axes-wrong", "thruster-reversed", "size-unlike", "outliers")
    findings = [Finding(code, "alarm", ("u",), {}, ("reverse-sign",)) for code in codes]
    assert not_judged_in_loop(findings, {}) == findings
    levels = [one.level for one in not_judged_in_loop(findings, {"tau_X": ("u",)})]
    assert levels == ["note", "note", "note", "note", "alarm", "alarm"]
