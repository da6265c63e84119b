"""Calibration of a campaign: ranks kept and resumed to the same bits, a posterior that is too narrow caught."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference import calibration as module
from seatrial.campaign.inference.calibration import calibrate
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from seatrial.estimation.diagnostics.calibration import DRAWS, Calibration
from seatrial.messages.predictions import calibration_report, mixing_words
from seatrial.report.figure_files import write_calibration_picture
from tests.campaign.small import write_small

METHOD = "adaptive-metropolis"


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    campaign = load_campaign(write_small(tmp_path_factory.mktemp("calibrate") / "small"))
    return campaign, get_trials(campaign)


@pytest.fixture(scope="module")
def found(small):
    return calibrate(*small, 24, METHOD)


@pytest.mark.proof
def test_ranks_of_every_parameter(found, small):
    assert found.names == ("X_uabsu", "T_nabsn", "X_u", "sigma_u", "log-likelihood")
    assert found.ranks.shape == (24, 5)
    assert found.outside() == ()
    assert calibration_report(found)[-1].startswith(
        "calibrated: the ranks lie inside the band that contains all 5 quantities with 99 % probability"
    )
    assert found.health.shape == (24, 4)
    assert np.isnan(found.health).all(0).tolist() == [False, False, False, True]
    assert "the draws mixed well in all 24 replicates (R-hat up to 1.0" in calibration_report(found)[-2]
    assert write_calibration_picture(small[0].folder, small[0].name, found).read_text().lstrip().startswith("<?xml")


@pytest.mark.proof
def test_resumes_to_the_same_bits(found, small, monkeypatch):
    """Killed at its twelfth replicate, then run again, and with more replicates asked for than before."""
    campaign, trials = small
    Store(campaign.folder).calibration(METHOD).unlink()
    real, numbers = module._numbered, []

    def dies(study, number, report):
        numbers.append(number)
        if len(numbers) == 12:
            raise KeyboardInterrupt
        return real(study, number, report)

    monkeypatch.setattr(module, "_numbered", dies)
    with pytest.raises(KeyboardInterrupt):
        calibrate(campaign, trials, 16, METHOD)
    again = calibrate(campaign, trials, 24, METHOD)
    assert set(numbers) == set(range(24))
    assert len(numbers) < 24 + 12
    assert np.array_equal(again.ranks, found.ranks)
    assert np.array_equal(again.health, found.health, equal_nan=True)


@pytest.mark.proof
def test_a_posterior_that_is_too_narrow_is_caught(small, monkeypatch):
    campaign, trials = small
    draw = module.find_method(METHOD)

    def narrow(posterior, key):
        drawn = draw(posterior, key)
        middle = drawn.z.mean((0, 1))
        return replace(drawn, z=middle + 0.3 * (drawn.z - middle))

    Store(campaign.folder).calibration(METHOD).unlink(missing_ok=True)
    monkeypatch.setattr(module, "find_method", lambda name: narrow)
    spoilt = calibrate(campaign, trials, 32, METHOD)
    Store(campaign.folder).calibration(METHOD).unlink()
    assert {"X_uabsu", "T_nabsn", "X_u"} <= set(spoilt.outside())
    said = " ".join(calibration_report(spoilt))
    assert "the posterior is overconfident" in said
    assert "so the sampling is not the cause of the uneven ranks" in said


def test_unknown_sampler_is_refused_with_the_nearest(small):
    with pytest.raises(InputError, match="adaptive-metropolis"):
        calibrate(*small, 24, "adaptive-metropolus")


@pytest.mark.proof
def test_truths_that_cannot_be_simulated_are_drawn_again(small):
    campaign, trials = small
    posterior = module.Study(campaign, trials.fit).posterior(campaign.structures[0])
    found = module._replicate(posterior, module.find_method(METHOD), jax.random.key(5))
    assert found.tries >= 1
    assert found.rank.min() >= 0
    assert found.rank.max() <= DRAWS


def spoken(health, ranks=None):
    """What is said of the sampling in a calibration of one quantity whose replicates have these diagnostics."""
    health = np.asarray(health, float)
    ranks = np.arange(len(health))[:, None] % (DRAWS + 1) if ranks is None else ranks
    return mixing_words(Calibration(("a",), ranks, "given", "M-0", 0.0, health))


GOOD = (1.01, 800.0, 0.0, np.nan)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (
            (1.4, 800.0, 0.0, np.nan),
            "R-hat up to 1.40, at least 800 effective draws, at most 0.00% of transitions diverged",
        ),
        ((1.01, 24.0, 0.0, np.nan), "at least 24 effective draws"),
        ((1.01, 800.0, 0.01, np.nan), "at most 1.00% of transitions diverged"),
        ((np.nan, np.nan, np.nan, 0.02), "at least 2% of the moves accepted"),
        ((np.nan, np.nan, np.nan, np.nan), "R-hat up to 1.01"),
    ],
)
def test_poor_mixing_is_told_from_a_wrong_posterior(bad, words):
    """Two poor replicates in a hundred may be why ranks are uneven; one may not."""
    said = spoken([GOOD] * 98 + [bad] * 2)
    assert said.startswith("the draws mixed poorly in 2 of 100 replicates")
    assert words in said
    assert said.endswith("this may be the cause of uneven ranks; try another method, or narrower priors")
    assert spoken([GOOD] * 99 + [bad]).endswith("too few to cause uneven ranks")


def test_good_mixing_is_not_blamed():
    assert spoken([GOOD] * 100).startswith(
        "the draws mixed well in all 100 replicates (R-hat up to 1.01, at least 800 effective"
    )
    assert spoken([GOOD] * 100, np.zeros((100, 1), int)).endswith(
        "so the sampling is not the cause of the uneven ranks"
    )
    assert "at least 30% of the moves accepted" in spoken([(np.nan, np.nan, np.nan, 0.3)] * 40)


@pytest.mark.proof
def test_diagnostics_of_each_kind_of_method(small):
    """Chains have R-hat, effective draws and divergences; a population has its moves."""
    posterior = module.Study(small[0], small[1].fit).posterior(small[0].structures[0])
    chains, population = (module.find_method(name)(posterior, jax.random.key(2)) for name in (METHOD, "tempered-smc"))
    assert 1.0 < chains.mixing().r_hat < 1.3
    assert DRAWS < chains.mixing().ess < chains.log_density.size
    assert (chains.mixing().diverged, np.isnan(chains.mixing().moved)) == (0.0, True)
    assert np.isnan(population.mixing()[:3]).all()
    assert 0.1 < population.mixing().moved < 0.5
