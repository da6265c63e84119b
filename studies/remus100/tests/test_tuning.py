"""The remarks on P, Q and R: one filter, four tunings, the same trials."""

import json

import numpy as np
import pytest

from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from studies.remus100.filters import filter_space, in_printed_units, make_trials, run_over_seeds
from studies.remus100.tests.studies import TINY, A, study
from studies.remus100.tuning import CHANGES

PRINTED = np.array([-1.21, -2.93, 6.28])


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return study(tmp_path_factory.mktemp("tuning")).part("tuning")


@pytest.mark.parametrize(("change", "factors"), CHANGES.items())
def test_rows_are_those_of_the_traces(data, change, factors):
    trials = make_trials(A, TINY.tuning_seeds)
    trace = run_over_seeds(SquareRootUnscentedKalmanFilter(), filter_space(A, **factors), trials)
    row, means = data.sel(change=change), in_printed_units(A, trace.means[..., 1:])
    np.testing.assert_allclose(row["error"], means[:, -1] - PRINTED, atol=1e-9)
    np.testing.assert_allclose(row["error_at_3_s"], means[:, 299] - PRINTED, atol=1e-9)
    np.testing.assert_allclose(row["sd"], in_printed_units(A, trace.sds[:, -1, 1:]), rtol=1e-9)
    steps = means[:, 1:] - means[:, :-1]
    np.testing.assert_allclose(row["travelled"], np.sqrt(steps**2).sum(1), rtol=1e-9)
    distance = np.asarray(trace.means)[..., 0] - trials.measured[..., 0]
    np.testing.assert_allclose(row["residual"], np.linalg.norm(distance, axis=1) / np.sqrt(1500), rtol=1e-9)


def test_too_large_a_q_follows_the_noise(data):
    residual = data["residual"].mean("seed")
    assert float(residual.sel(change="Q x 1e4")) < float(residual.sel(change="as printed"))


def test_too_large_an_r_states_some_ten_times_the_sd(data):
    """sds grow as the root of R where Q and P weigh little and the estimates, about which it is linearised, are right."""
    ratio = data["sd"].sel(change="R x 100") / data["sd"].sel(change="as printed")
    assert 5 < float(ratio.median()) < 20


def test_noise_by_high_pass(data):
    """sd of the noise is 0.1 on both channels; four of the stated errors, which are a few per cent."""
    assert (np.abs(data["noise"] - 0.1) < 4 * data["noise_error"]).all()
    assert (data["noise_error"] < 0.01).all()


def test_what_the_check_says(data):
    said = json.loads(data.attrs["findings"])
    assert set(said) == set(CHANGES)
    assert all(said[change] for change in CHANGES if change != "as printed")
