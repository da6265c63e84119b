"""Section V's iteration and the two readings side by side."""

import numpy as np
import pytest

from studies.remus100.tests.studies import study
from studies.remus100.tests.test_fisher import information, sds
from tests.estimation_cases import naive_doublets

TIME = np.arange(6000) * 0.01


@pytest.mark.proof
def test_second_trial_tells_the_doubted_term(tmp_path):
    """Standard deviations of X_du3, predicted and fitted: 5.6 after one trial, 4 after the same again, .5 after the best other.

    Fits see one draw of the noise, which moves the curvature at their mode by a few per cent.
    """
    data = study(tmp_path).part("iteration").sel(coefficient="X_du3")
    assert float(data["first_sd"]) == pytest.approx(5.61, abs=0.005)
    assert float(data["alone"].sel(design="doublets of 29 s")) == pytest.approx(1.416, abs=0.005)
    words = str(data["design"].values[data["both"].values.argmin()]).split()
    assert words[:2] == ["doublets", "of"]
    first, second = naive_doublets(TIME, 200, 10), naive_doublets(TIME, 200, float(words[2]), 58)
    both = sds(information(first, second, doubted=0.1).sum(0))[3]
    assert float(data["both"].min()) == pytest.approx(both, rel=1e-6)
    np.testing.assert_allclose(data["second"], 2 * np.pi * second, rtol=1e-12)
    one, again, redesigned = data["full_sd"].values
    assert one == pytest.approx(5.84, rel=0.03)
    assert again == pytest.approx(one / np.sqrt(2), rel=0.05)
    assert redesigned == pytest.approx(both, rel=0.05)
    assert redesigned < 0.1 * one
    assert (data["probability"].diff("fit") < 0).all()


@pytest.mark.proof
def test_both_readings(tmp_path):
    """Measured elsewhere under B: sds some 1.6 times larger, P(M-0) .499 and .498, log Z of M-1 6952.186."""
    data = study(tmp_path).part("readings")
    a, b = (data.sel(reading=name) for name in "AB")
    np.testing.assert_allclose(a["fit_sd"], [0.103, 0.068, 0.044], rtol=0.03)
    np.testing.assert_allclose(b["fit_sd"] / a["fit_sd"], 1.6, rtol=0.1)
    assert b["probability"].values == pytest.approx([0.499, 0.498], abs=0.02)
    assert float(b["log_value"][0, 1]) == pytest.approx(6952.186, abs=0.02)
    assert float(a["log_value"][0, 1]) == pytest.approx(6951.178, abs=0.02)
    assert [float(a["gain_10_s"]), float(a["gain_20_s"])] == pytest.approx([25.078, 25.249], abs=1e-3)
    assert float(b["gain_20_s"]) < float(a["gain_20_s"])
