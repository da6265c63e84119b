"""Baselines of a campaign: fitted once, kept, and beaten or not on the run that was held back."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import Trials, get_trials
from seatrial.campaign.inference.baselines import (
    compare_with_baselines,
    comparison_alarms,
    comparison_cautions,
    comparison_lines,
    fit_all_baselines,
    stored_baselines,
)
from seatrial.campaign.store.results import Results
from seatrial.campaign.workflow.steps import Workflow
from seatrial.estimation.prediction.baselines import BASELINES
from seatrial.messages.predictions import comparison_text
from tests.campaign.small import write_small
from tests.campaign.yaw_campaign import write_yaw


@pytest.fixture(scope="module")
def yaw(tmp_path_factory):
    folder = write_yaw(tmp_path_factory.mktemp("baselines") / "yaw")
    file = folder / "campaign.toml"
    file.write_text(file.read_text().replace('fit = ["1", "2"]', 'fit = ["1"]\npredict = ["2"]'))
    campaign = load_campaign(folder)
    trials = get_trials(campaign)
    return campaign, trials, fit_all_baselines(campaign, trials)


def curves(trials, errors):
    """Predictions that are off by so much in every channel, and say so."""
    (record,) = trials.predict
    measured = np.column_stack([record.channel(name) for name in ("v", "r")])
    return [{"time": record.time, "measured": measured, "mean": measured + errors, "sd": np.full_like(measured, 0.01)}]


def test_they_are_fitted_to_the_fitted_run_alone_and_kept(yaw):
    campaign, trials, found = yaw
    assert [*found.names] == [*BASELINES, "accelerations"]
    assert (found.channels, found.records, found.refused) == (("v", "r"), ("2",), {})
    for name, mean in zip(found.names[:-1], found.mean, strict=False):
        alone = BASELINES[name].fit(trials.fit, campaign.channels, ("delta_r", "u"))
        columns = [campaign.channels.index(channel) for channel in alone.channels]
        np.testing.assert_allclose(mean[:, columns], alone.predict(trials.predict[0]), rtol=1e-6, atol=1e-9)
        assert found.parameters[name] == pytest.approx(dict(alone.parameters), rel=1e-6)
    assert np.isnan(found.noise_sd[found.names.index("nomoto"), 0])
    kept = stored_baselines(campaign, trials)
    assert kept.state() == "current"
    assert [*Results(campaign.folder).baselines().words.values()][2] == "a first-order lag of the controls"
    flow = Workflow(campaign)
    assert flow.state("baselines") == "current"


def test_the_own_equations_regressed_predict_best(yaw):
    """The logs are made by the campaign's own equations, so least squares of accelerations is near the truth."""
    _, trials, found = yaw
    compared = compare_with_baselines(found, curves(trials, 0.2))
    assert [one.channel for one in compared] == ["v", "r"]
    for one in compared:
        assert one.baselines[0].words == "least squares of accelerations"
        assert one.baselines[0].explained > 0.95
        assert one.level == "fail"
    assert comparison_alarms(compared) == [comparison_text(one) for one in compared]
    assert comparison_cautions(compared) == []
    lines = comparison_lines(found, compared)
    assert lines[0].startswith("held-back runs: least squares of accelerations predicts v better than the model")
    assert len(lines) == 2 + (1 + 4) + (1 + 7)


def test_a_model_that_predicts_well_raises_nothing(yaw):
    _, trials, found = yaw
    compared = compare_with_baselines(found, curves(trials, 1e-4))
    assert {one.level for one in compared} == {"pass"}
    assert comparison_alarms(compared) == comparison_cautions(compared) == []


def test_without_held_back_runs_nothing_is_claimed(tmp_path):
    campaign = load_campaign(write_small(tmp_path))
    assert fit_all_baselines(campaign, Trials((), (), "key")) is None
    assert compare_with_baselines(None, []) == ()
    (line,) = comparison_lines(None, ())
    assert "no run is held back" in line
