"""What an estimate keeps for figures, against scipy; how long its chains are, and how they mix at the bound of a prior."""

import numpy as np
import pytest
from scipy import stats

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.estimate import estimate_all, prior_curves
from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Uniform, half_normal
from tests.campaign.small import write_small
from tests.estimation_cases import posterior

PRIORS = {
    "a": (Uniform(-3.0, 1.0), stats.uniform(-3.0, 4.0)),
    "b": (Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
    "c": (LogUniform(0.1, 10.0), stats.loguniform(0.1, 10.0)),
    "d": (LogNormal(-3.0, 1.5), None),
    "e": (half_normal(0.7, lower=0.0), stats.halfnorm(0.0, 0.7)),
}


def test_stored_prior_curves_match_scipy():
    target = posterior({name: prior for name, (prior, _) in PRIORS.items()}, lambda values, data: 0.0)
    curves = prior_curves(target)
    for name, (_, law) in PRIORS.items():
        value, density = curves[name]
        assert np.all(np.diff(value) >= 0)
        assert np.trapezoid(density, value) == pytest.approx(1.0, abs=0.02)
        if law is not None:
            inside = slice(20, -20)
            assert density[inside] == pytest.approx(law.pdf(value[inside]), rel=1e-4)


def estimate_at_a_bound(folder, chains, warmup, draws):
    """The posterior of three coefficients whose X_u is truly 0, where its prior ends: half a ridge."""
    write_small(
        folder,
        ('always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]', 'always = ["X_uabsu", "T_nabsn", "X_u"]'),
        ("upper = 1.2", "upper = 0.0"),
        ("X_u = -1.21", "X_u = 0.0"),
        ("chains = 16\nwarmup = 500\ndraws = 1000", f"chains = {chains}\nwarmup = {warmup}\ndraws = {draws}"),
    )
    campaign = load_campaign(folder)
    (estimate,) = estimate_all(campaign, get_trials(campaign))
    return estimate.data


@pytest.mark.proof
@pytest.mark.parametrize(("chains", "draws", "made"), [(4, 100, 400), (8, 200, 400)])
def test_chains_go_on_while_they_disagree_up_to_four_times_what_was_asked_for(tmp_path, chains, draws, made):
    data = estimate_at_a_bound(tmp_path, chains, 300, draws)
    assert data["draws"].values.shape[:2] == (chains, made)
    assert (data.attrs["alarms"] == "[]") == (chains == 8)


@pytest.mark.proof
def test_chains_mix_at_the_bound_of_a_prior(tmp_path):
    """Decision 0003: with a corner of 1/50 of the prior the smallest effective sizes were 2 616 and 985, with 1/200 10 120 and 8 673."""
    data = estimate_at_a_bound(tmp_path, 32, 500, 1500)
    assert data["r_hat"].values.max() < 1.006
    assert data["ess_bulk"].values.min() > 7000
    assert data["ess_tail"].values.min() > 6000
