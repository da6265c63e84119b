"""Figures 3 and 4 and the self-oscillating test: entropies measured elsewhere, and motions by plain loops."""

import numpy as np
import pytest

from seatrial.numerics.integrate import rk4_step
from studies.remus100.design_verdicts import ridges
from studies.remus100.designs import ACTIVE, design_space, true_state
from studies.remus100.tests.studies import A, B, study
from tests.cases import N0, RPM, U0, naive_rk4, surge_rate
from tests.estimation_cases import naive_doublets, naive_speed

pytestmark = pytest.mark.proof


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return study(tmp_path_factory.mktemp("designs"))


def test_ridges_are_local_maxima_inside_the_grid():
    gain = np.array([1.0, 2.0, 3.0, 2.5, 2.0, 2.2, *np.linspace(2.3, 3.5, 14)])
    assert ridges(gain) == [3.0]


def test_golden_entropies(found):
    """40 s window: the smallest gain, that of (200 rpm, 10 s), and the largest, of (200 rpm, 20 s)."""
    sweep = found.part("sweep-medium")
    gain = sweep["gain"].values
    assert [gain.min(), gain[-1, 9], gain.max()] == pytest.approx([21.582, 25.078, 25.249], abs=1e-3)
    assert np.unravel_index(gain.argmax(), gain.shape) == (19, 19)
    assert sweep["amplitude"].values[[0, -1]] == pytest.approx([100 * RPM, 200 * RPM])
    assert (np.diff(gain, axis=0) > 0).all()


def test_extended_filter_gains_as_much(found):
    difference = np.abs(found.part("sweep-medium")["gain"] - found.part("sweep-ekf")["gain"])
    assert 0 < float(difference.max()) <= 0.05


@pytest.mark.parametrize(
    ("window", "expected"), [("short", [6, 10]), ("medium", [8, 10, 13]), ("long", [9, 11, 14, 19])]
)
def test_golden_ridges(found, window, expected):
    """At 200 rpm; and each lies where one whole doublet fewer fits."""
    at = ridges(found.part(f"sweep-{window}")["gain"].values[-1])
    assert at == expected
    assert all(np.floor(ACTIVE[window] / period) > np.floor(ACTIVE[window] / (period + 1)) for period in expected)


@pytest.mark.parametrize("reading", [A, B], ids=["A", "B"])
def test_belief_of_the_text(reading):
    """P = diag(1, 1e5, 1e5, 1e5), T in printed units: in the units of the filter, 10 under reading A, as the text has it."""
    belief = design_space(reading, rk4_step).initial
    variance = np.diag(np.asarray(belief.chol_cov)) ** 2
    np.testing.assert_allclose(variance, [1.0, 1e5, 1e5, 10.0 if reading is A else 1e5], rtol=1e-9)
    np.testing.assert_allclose(belief.mean[1:], 0.75 * true_state(reading)[1:], rtol=1e-12)


def test_chosen_doublet(found):
    """Motion by a plain loop; the noise's sd of 12 000 values has an error of 0.65 %; estimates end within 4 sds of the truth."""
    data = found.part("chosen-doublet")
    rev_per_s = naive_doublets(np.arange(6000) * 0.01, 200, 10)
    np.testing.assert_allclose(data["n"], 2 * np.pi * rev_per_s, rtol=1e-12)
    speed = naive_speed(rev_per_s, np.full(6000, 0.01))
    np.testing.assert_allclose(data["true"], np.column_stack([speed, surge_rate(speed, rev_per_s)]), atol=1e-9)
    assert float((data["measured"] - data["true"]).std()) == pytest.approx(0.1, rel=4 * 0.0065)
    last = data.isel(time=-1)
    assert (np.abs(last["mean"] - [-1.21, -2.93, 6.28]) < 4 * last["sd"]).all()
    gain = np.log(np.sqrt(1e5)) * 3 - np.log(last["sd"].values).sum()
    assert gain < found.part("sweep-medium")["gain"].values[-1, 9]


def test_best_self_oscillation(found):
    """Measured elsewhere: 25.27 nat, by reversals of 200 rpm each time the speed has gone 0.27 of its trim value."""
    data = found.part("relay")
    swings = data["switches"].values >= 2
    gain = data["gain"].values
    assert gain[swings].max() == pytest.approx(25.27, abs=0.01)
    assert 0 < swings.mean() < 1
    assert gain[~swings].max() < gain[swings].max() - 1
    assert data.attrs["best_amplitude"] == pytest.approx(200 * RPM)
    assert data.attrs["best_threshold"] / U0 == pytest.approx(0.27, abs=1e-9)


def test_best_self_oscillation_by_a_plain_loop(found):
    """From 1 s to 41 s, reversed as soon as the speed is beyond the threshold on the side it is driven to, then trim."""
    data = found.part("relay")
    amplitude, threshold = data.attrs["best_amplitude"], data.attrs["best_threshold"]
    u, side, control, speed = U0, 1.0, [], []
    for k in range(6000):
        running = 100 <= k < 4100
        if running and side * (u - U0) >= threshold:
            side = -side
        control.append(N0 + running * side * amplitude)
        speed.append(u)
        u = naive_rk4(lambda x, n=control[-1]: surge_rate(x, n / (2 * np.pi)), u, 0.01)
    np.testing.assert_allclose(data["n"], control, rtol=1e-12)
    np.testing.assert_allclose(data["u"], speed, atol=1e-9)
