"""Modes that a search from the prior finds, and what begins from them."""

import jax
import numpy as np
import pytest

import seatrial as st
from seatrial.campaign.inference.modes import KnownModes
from seatrial.core.serialise import from_plain, to_plain
from seatrial.estimation.posterior.mode import maximise_from
from seatrial.estimation.posterior.sample_posterior import spread_starts
from seatrial.selection.further_modes import MAX_SEARCH_DIM, search_modes
from seatrial.selection.importance import importance_evidence
from tests.selection.targets import correlated, far_peaks, linear, one_peak, spike_on_slab

KEY = jax.random.key(3)


def test_a_search_finds_the_peak_that_a_climb_does_not():
    """Half of the evidence in each of two peaks, and the chains are dealt to both."""
    target, _ = far_peaks()
    one = maximise_from(target, np.array([-1.0, 0.0]))
    modes = search_modes(target, [one], KEY)
    assert len(modes) == 2
    assert [mode.log_density for mode in modes] == sorted((mode.log_density for mode in modes), reverse=True)
    starts = spread_starts(target, modes[0], 8, KEY, modes[1:])
    nearest = np.argmin([np.linalg.norm(starts - mode.z, axis=1) for mode in modes], axis=0)
    assert nearest.tolist() == [0, 1] * 4


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(3))
def test_a_search_meets_a_spike_that_holds_the_evidence(seed):
    """In ten parameters, and importance sampling about both modes weighs it: the evidence is known."""
    target, exact = spike_on_slab()
    find, search, weigh = jax.random.split(jax.random.key(seed), 3)
    first, *further = search_modes(target, [st.find_mode(target, key=find)], search)
    evidence = importance_evidence(target, weigh, first, further=further)
    assert len(further) == 1
    assert abs(evidence.log_value - exact) < 4 * evidence.std_error < 0.1


def test_no_chain_starts_where_there_is_no_evidence():
    target, _ = one_peak()
    mode = st.find_mode(target, key=KEY)
    lower = mode._replace(z=mode.z + 5.0, log_evidence=mode.log_evidence - 20.0)
    starts = spread_starts(target, mode, 8, KEY, [lower])
    np.testing.assert_array_equal(starts, spread_starts(target, mode, 8, KEY))


def test_one_peak_has_one_mode_and_many_parameters_are_not_searched():
    target, _ = one_peak()
    mode = st.find_mode(target, key=KEY)
    assert search_modes(target, [mode], KEY) == (mode,)
    many, _ = linear(MAX_SEARCH_DIM + 1)
    mode = st.find_mode(many, key=KEY)
    assert search_modes(many, [mode, mode], KEY) == (mode, mode)


def test_modes_are_kept_to_the_last_bit():
    target, _ = correlated(3)
    mode = st.find_mode(target, key=KEY)
    kept = KnownModes({"M-0": (mode, mode)}, {"M-1": "no maximum"})
    again = from_plain(KnownModes, to_plain(kept))
    for one, other in zip(again.modes["M-0"][1], mode, strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.failures == kept.failures
