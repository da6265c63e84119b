"""Commands that act late, before a regression: the delay is found, and records are shifted as the simulator does it."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.regression.row_fit import delayed, likely_delay
from seatrial.estimation.simulation.delayed_control import delay_control
from tests.estimation.row_cases import SURGE, surge_record


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.23, 0.4, 1.0])
def test_even_steps_are_the_simulators(delay):
    record = surge_record(1)
    expected = delay_control(jnp.asarray(record.control[:, 0]), jnp.asarray(delay / record.step[0]))
    np.testing.assert_allclose(delayed(record, delay).control[:, 0], expected, rtol=1e-9, atol=1e-9)


def test_uneven_steps_by_a_fine_sum():
    record = surge_record(1)
    time = record.time + 0.03 * np.sin(7.0 * record.time)
    uneven = replace(record, time=time)
    held = lambda at: uneven.control[np.clip(np.searchsorted(time, at, side="right") - 1, 0, None), 0]  # noqa: E731
    found = delayed(uneven, 0.17).control[:, 0]
    for i in (0, 5, 77, 300):
        fine = time[i] + uneven.step[i] * (np.arange(20000) + 0.5) / 20000
        assert found[i] == pytest.approx(held(fine - 0.17).mean(), rel=2e-4)


def test_a_delay_is_found_again():
    """The speed of a vehicle that was driven 0.37 s before its record says it was commanded."""
    record = surge_record(1)
    early = replace(record, time=record.time + 0.0, control=_ahead(record.control, record.time, 0.37))
    found = likely_delay([early], SURGE, 2.0, 0.0, 1.0)
    assert found == pytest.approx(0.37, abs=0.08)


def _ahead(control, time, by):
    return np.column_stack([np.interp(time + by, time, column) for column in control.T])


@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_a_delay_at_an_end_of_the_range_is_found(delay):
    record = surge_record(1)
    early = replace(record, control=_ahead(record.control, record.time, delay))
    assert likely_delay([early], SURGE, 2.0, 0.0, 1.0) == pytest.approx(delay, abs=0.08)


@pytest.mark.parametrize(("lower", "upper"), [(0.0, 16.0), (-12.0, 4.0)])
def test_far_delays_do_not_mislead(lower, upper):
    """Commands that come again later are likely later, too: only about the best of those tried is searched on."""
    record = surge_record(1)
    early = replace(record, control=_ahead(record.control, record.time, 1.0))
    assert likely_delay([early], SURGE, 2.0, lower, upper) == pytest.approx(1.0, abs=0.1)
