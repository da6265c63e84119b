"""Calibration of a campaign: ranks kept and resumed to the same bits, a posterior that is too narrow caught."""

import jax
import numpy as np
import pytest

from seatrial.campaign import calibrate as module
from seatrial.campaign.calibrate import calibrate
from seatrial.campaign.load import load_campaign
from seatrial.campaign.store import Store
from seatrial.campaign.trials import get_trials
from seatrial.core.errors import InputError
from seatrial.estimation.calibration import DRAWS
from seatrial.report.calibration_picture import write_calibration_picture
from tests.campaign.small import write_small

METHOD = "adaptive-metropolis"


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    campaign = load_campaign(write_small(tmp_path_factory.mktemp("calibrate") / "small"))
    return campaign, get_trials(campaign)


@pytest.fixture(scope="module")
def found(small):
    return calibrate(*small, 24, METHOD)


def test_ranks_of_every_parameter(found, small):
    assert found.calibration.names == ("X_uabsu", "T_nabsn", "X_u", "sigma_u", "log-likelihood")
    assert found.calibration.ranks.shape == (24, 5)
    assert found.calibration.outside() == ()
    assert found.lines()[-1].startswith("calibrated: the ranks of all 5 quantities")
    assert write_calibration_picture(small[0], found).read_text().lstrip().startswith("<?xml")


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
    assert np.array_equal(again.calibration.ranks, found.calibration.ranks)


def test_a_posterior_that_is_too_narrow_is_caught(small, monkeypatch):
    campaign, trials = small
    draw = module.find_method(METHOD)

    def narrow(posterior, key):
        drawn = draw(posterior, key)
        return drawn.mean(0) + 0.3 * (drawn - drawn.mean(0))

    Store(campaign.folder).calibration(METHOD).unlink(missing_ok=True)
    monkeypatch.setattr(module, "find_method", lambda name: narrow)
    spoilt = calibrate(campaign, trials, 32, METHOD)
    Store(campaign.folder).calibration(METHOD).unlink()
    assert {"X_uabsu", "T_nabsn", "X_u"} <= set(spoilt.calibration.outside())
    assert "too small" in " ".join(spoilt.lines())


def test_unknown_method(small):
    with pytest.raises(InputError, match="adaptive-metropolis"):
        calibrate(*small, 24, "adaptive-metropolus")


def test_truths_that_cannot_be_simulated_are_drawn_again(small):
    campaign, trials = small
    posterior = module.Study(campaign, trials.fit).posterior(campaign.structures[0])
    ranks, tried = module._replicate(posterior, module.find_method(METHOD), jax.random.key(5))
    assert tried >= 1
    assert ranks.min() >= 0
    assert ranks.max() <= DRAWS
