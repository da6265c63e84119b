"""Tables IV and V: Listing 1, evidences measured elsewhere, and the odds over trials."""

import jax
import numpy as np
import pytest

from seatrial.selection.importance import importance_evidence
from seatrial.selection.verdict import Evidence
from studies.remus100 import evidence
from studies.remus100.evidence import probability
from studies.remus100.tests.studies import TINY, A, study
from studies.remus100.trial import around, paper_posterior, paper_trial, wide
from tests.estimation_cases import GOLDEN_LOG_EVIDENCE

pytestmark = pytest.mark.proof

GOLDEN = np.array([GOLDEN_LOG_EVIDENCE["M-0 narrow"], GOLDEN_LOG_EVIDENCE["M-1"]])
"""Log evidences of M-0 and M-1 at the smaller true coefficient."""


def test_probability_and_its_error():
    """Odds of 1 : 3; dp = p (1 - p) d log Z."""
    p, error = probability(np.array([0.0, np.log(3.0)]), np.array([0.03, 0.04]))
    assert (p, error) == pytest.approx((0.25, 0.25 * 0.75 * 0.05))
    far, _ = probability(np.array([-700.0, 0.0]), np.array([0.1, 0.1]))
    assert far == pytest.approx(0.0, abs=1e-300)


def test_values_of_the_tables():
    assert [evidence.doubted_value(A, table) for table in (4, 5)] == [0.1, 1.0]


@pytest.fixture(scope="module")
def listing(tmp_path_factory):
    return study(tmp_path_factory.mktemp("listing")).part("listing-4")


def test_listing_1_rests_on_one_draw(listing):
    """2 000 prior draws, of which about one counts: log Z falls short by tens of nats, so the larger one wins outright."""
    assert listing["probability"].shape == (3, 2)
    assert listing["ess"].values.min() == pytest.approx(1.0, abs=0.5)
    assert np.median(listing["ess"]) < 3
    assert (listing["log_values"] < GOLDEN - 5).all()
    assert "no verdict" in listing.attrs["status"]


def test_listing_1_normalises_its_evidences(listing):
    odds = listing["log_values"].values
    expected = 1 / (1 + np.exp(odds[:, 1] - odds[:, 0]))
    np.testing.assert_allclose(listing["probability"][:, 0], expected, rtol=1e-9)
    np.testing.assert_allclose(listing["probability"].sum("model"), 1.0, rtol=1e-12)
    np.testing.assert_allclose(listing["shared_probability"].sum("model"), 1.0, rtol=1e-12)


@pytest.mark.proof
def test_golden_evidences_of_table_4(tmp_path, monkeypatch):
    """Importance sampling within .01 and bridge sampling within .05, as asked, or four of their errors.

    Tempered SMC and nested sampling, a minute more, have golden tests of their own.
    """

    def given_smc(model, key, settings):
        return Evidence(float(settings.smc.particles), 0.4, "given")

    monkeypatch.setattr(evidence, "smc_evidence", given_smc)
    monkeypatch.setattr(evidence, "nested_evidence", lambda model, key, live: Evidence(float(live), 0.4, "given"))
    data = study(tmp_path).part("evidence-4")
    for method, tolerance in (("importance sampling", 0.01), ("bridge sampling", 0.05)):
        one = data.sel({"method": method})
        assert (np.abs(one["log_value"] - GOLDEN) < np.maximum(tolerance, 4 * one["error"])).all()
        assert (one["error"] < 0.01).all()
    assert data.sel({"method": "tempered SMC"})["log_value"].values.tolist() == [TINY.smc_particles] * 2
    assert data.sel({"method": "nested sampling"})["log_value"].values.tolist() == [TINY.nested_live] * 2
    golden = GOLDEN_LOG_EVIDENCE["M-0 wide"]
    assert float(data["wide_log_value"]) == pytest.approx(golden, abs=max(0.01, 4 * float(data["wide_error"])))


@pytest.mark.proof
@pytest.mark.parametrize(
    ("prior", "golden"), [(around(1.0), 6951.290), (None, 6951.396), (wide(A), 6950.354)], ids=["M-0", "M-1", "wide"]
)
def test_golden_evidences_of_table_5(prior, golden):
    found = importance_evidence(paper_posterior(A, [paper_trial(A, 1.0)], prior), jax.random.key(0))
    assert found.log_value == pytest.approx(golden, abs=max(0.01, 4 * found.std_error))
    assert found.std_error < 0.01


@pytest.mark.proof
def test_odds_grow_with_the_true_term(tmp_path):
    """Measured elsewhere over 10 trials: .498 +- .002, .491 +- .018, then .87 on average and .999; one trial here."""
    data = study(tmp_path).part("odds")
    assert data["value"].values.tolist() == [0.1, 1.0, -20.0, -60.0]
    p = data["probability"].values
    assert p[0] == pytest.approx(0.498, abs=0.01)
    assert p[1] == pytest.approx(0.491, abs=4 * 0.018)
    assert p[2].min() > 0.5
    assert p[3].min() > 0.99
    assert (data["error"] < 0.01).all()
