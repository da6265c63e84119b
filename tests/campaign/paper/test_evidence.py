import numpy as np
import pytest

from seatrial.campaign.paper.evidence import (
    METHODS,
    around,
    bayes_factor_table,
    compare,
    paper_posterior,
    paper_trial,
    probability_of_full,
)
from seatrial.campaign.paper.reading import READINGS
from seatrial.selection.evidence import Evidence
from tests.estimation_cases import GOLDEN_LOG_EVIDENCE, golden_motion, golden_noise

A = READINGS["A"]


def test_trial_is_the_golden_one():
    """The golden motion is a plain midpoint loop: the two integrators differ by 1e-6 m/s at most."""
    _, rev_per_s, speed = golden_motion()
    record = paper_trial(A, 0.1)
    np.testing.assert_allclose(record.channel("n"), 2 * np.pi * rev_per_s, rtol=1e-12)
    np.testing.assert_allclose(record.channel("u"), speed + golden_noise(), atol=1e-6)


def test_priors_are_about_half_the_truth():
    assert around(-1.21).bounds == pytest.approx((-3.025, 1.815))
    posterior = paper_posterior(A, paper_trial(A, 0.1), around(0.1))
    assert posterior.names == ("X_u", "X_uabsu", "T_nabsn", "X_du3", "sigma_u")


def test_probability_and_its_error():
    p, error = probability_of_full((Evidence(0.0, 0.03, ""), Evidence(np.log(3.0), 0.04, "")))
    assert (p, error) == pytest.approx((0.25, 0.25 * 0.75 * 0.05))


@pytest.mark.thorough
def test_table_4():
    """Two estimators agree with the evidences measured elsewhere; Listing 1 does not agree with itself."""
    comparison = compare(A, 0.1, methods=METHODS[:2], repeats=6, draws=20_000)
    full, reduced = comparison.methods["importance sampling"]
    assert full.log_value == pytest.approx(GOLDEN_LOG_EVIDENCE["M-0 narrow"], abs=0.02)
    assert reduced.log_value == pytest.approx(GOLDEN_LOG_EVIDENCE["M-1"], abs=0.02)
    for pair in comparison.methods.values():
        p, error = probability_of_full(pair)
        assert abs(p - probability_of_full((full, reduced))[0]) < 4 * error + 0.005
    item = bayes_factor_table(A, "table-4", comparison)
    assert item.verdict == "cannot hold"
    assert "is noise" in item.because
