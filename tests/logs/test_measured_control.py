"""A measured control changes smoothly or by its noise; a held command jumps and stays, however it is rounded."""

import numpy as np
import pytest

from seatrial.logs.measured_control import looks_measured

_TIME = 0.1 * np.arange(600)
_JUMPS = np.where(np.sin(0.4 * _TIME) > 0, 125.0, 100.0)
_RNG = np.random.default_rng(3)
_LAG = np.convolve(_JUMPS, 0.2 * 0.8 ** np.arange(60))[: _TIME.size]


@pytest.mark.parametrize(
    "values",
    [
        np.interp(_TIME, [0, 15, 30, 45, 60], [100, 125, 100, 125, 100]),
        112.5 + 12.5 * np.sin(0.4 * _TIME),
        np.round(112.5 + 12.5 * np.sin(0.4 * _TIME), 1),
        112.5 + 12.5 * np.sin(0.4 * _TIME) + 0.05 * _RNG.normal(size=_TIME.size),
        _LAG + 0.01 * _RNG.normal(size=_TIME.size),
        _JUMPS + _RNG.normal(size=_TIME.size),
        np.round(_JUMPS + _RNG.normal(size=_TIME.size)),
        _RNG.normal(size=_TIME.size),
    ],
    ids=[
        "ramps",
        "sine",
        "rounded sine",
        "noisy sine",
        "lagged jumps",
        "noisy jumps",
        "noisy jumps, rounded to the noise",
        "noise",
    ],
)
def test_what_is_measured_changes_at_nearly_every_sample(values: np.ndarray):
    assert looks_measured(_TIME, values)
    assert looks_measured(_TIME[:200] + 1e9, -values[:200])


@pytest.mark.parametrize(
    "values",
    [
        np.full(_TIME.size, 100.0),
        _JUMPS,
        _JUMPS + np.where(_JUMPS > 110, _RNG.normal(size=_TIME.size), 0.0),
        np.round(np.interp(_TIME, [0, 30, 60], [100, 150, 100])),
        np.round(112.5 + 12.5 * np.sin(0.1 * _TIME)),
        np.repeat(_RNG.normal(size=120), 5),
        np.repeat(112.5 + 12.5 * np.sin(0.4 * _TIME[::5]), 5),
        np.interp(_TIME, [0, 20, 21, 40, 41, 60], [100, 100, 125, 125, 100, 100]),
        np.cumprod(np.where(np.random.default_rng(0).random(_TIME.size) < 0.8, -1.0, 1.0)),
        np.random.default_rng(1).integers(0, 5, _TIME.size).astype(float),
    ],
    ids=[
        "constant",
        "jumps",
        "jumps that are noisy on one side only",
        "slow ramps, rounded",
        "slow sine, rounded",
        "held steps",
        "held sine",
        "command with short ramps",
        "random telegraph",
        "random levels",
    ],
)
def test_what_is_held_is_not(values: np.ndarray):
    assert not looks_measured(_TIME, values)


def test_holes_uneven_times_and_few_samples():
    ramp = np.interp(_TIME, [0, 30, 60], [100.0, 125.0, 100.0])
    some = np.sort(_RNG.choice(_TIME.size, 400, replace=False))
    assert looks_measured(_TIME[some], ramp[some])
    holes = ramp.copy()
    holes[::3] = np.nan
    assert looks_measured(_TIME, holes)
    broken = np.where(_TIME < 30, _TIME, _TIME + 100)
    assert looks_measured(broken, np.where(_TIME < 30, _TIME, _TIME + 1000))  # a jump over a gap is none
    assert not looks_measured(_TIME[:40], ramp[:40])
