"""What is said of held-back runs that are too few, too short, too much alike, too still, or in other units."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.judge_predictions import (
    _fitted,
    _predict,
    _setting,
    disowned,
    fit_complaints,
    held_back_alarms,
    held_back_cautions,
    predict_held_back,
)
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.filters.extended import extended_filter
from seatrial.vehicles.simulate import simulate
from tests.campaign.small import NO_X_U, write_small


class Known:
    """A posterior that is one point, the truth, but for a little."""

    def __init__(self, campaign):
        self.structure = campaign.structures[0]
        values = {"X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.05}
        self.names = tuple(values)
        spread = 1 + 1e-4 * np.random.default_rng(1).normal(size=(40, len(values)))
        self.values = np.array(list(values.values())) * spread

    def draws(self, names=None):
        return self.values[:, [self.names.index(name) for name in (self.names if names is None else names)]]


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    folder = tmp_path_factory.mktemp("held") / "small"
    campaign = load_campaign(write_small(folder, *NO_X_U))
    trials = get_trials(campaign)
    return campaign, trials, Known(campaign)


def run(known, label, control, seed, samples=300, thrust=1.0):
    """A record of the true vehicle under a control of its own, rad/s."""
    campaign, trials, drawn = known
    (first,) = trials.fit
    model, truth = campaign.model(drawn.structure), {"X_uabsu": -2.93, "T_nabsn": thrust * 6.28e-4}
    control = np.asarray(control, float)[:samples, None]
    step = jnp.full(samples, 0.1)
    motion = np.asarray(simulate(model, truth, jnp.asarray(control), step, jnp.array([1.54])))[:, 0]
    measured = (motion + 0.05 * np.random.default_rng(seed).normal(size=samples))[:, None]
    return replace(first, time=0.1 * np.arange(samples), control=control, measurement=measured, label=label)


WAVE = 104 + 15 * np.sign(np.sin(0.5 * np.arange(300) * 0.1))


def predicted(known, *records):
    campaign, trials, drawn = known
    held = replace(trials, predict=records)
    return predict_held_back(campaign, drawn, held), held_back_cautions(campaign.imports, held)


def test_a_right_model_passes_and_is_no_alarm(known):
    found, _ = predicted(known, run(known, "2", WAVE, 4), run(known, "3", WAVE[::-1], 2))
    assert [fit.level for fit in found.fits] == ["pass", "pass"]
    assert found.pooled[0].level == "pass"
    assert held_back_alarms(found.fits, found.pooled) == []


def test_a_slow_error_that_no_short_run_shows_alone_is_found_in_all_together(known):
    """White 0.05 with slow 0.012 m/s over 5 s in runs of 10 s: no finding of one alone, but of all; white runs have none."""
    campaign, _, drawn = known
    rng, white, both = np.random.default_rng(146), [], []
    for at in range(8):
        record, slow = run(known, str(at), WAVE, 20 + at, samples=100), [rng.normal()]
        for normal in rng.normal(size=99):
            slow.append(np.exp(-0.02) * slow[-1] + np.sqrt(1 - np.exp(-0.04)) * normal)
        white.append(record)
        both.append(replace(record, measurement=record.measurement + 0.012 * np.array(slow)[:, None]))

    def doubt(records):
        return disowned(
            _fitted(_setting(campaign), [_predict(campaign, drawn, record) for record in records], lambda *_: {})
        )

    assert doubt(white) == ""
    assert [doubt([one]) for one in both[1:4]] == [""] * 3
    said = doubt(both)
    assert "residuals of u are correlated: " in said
    assert "; likewise " in said
    assert 'Set estimation.residuals = "drifting"' in said


def test_process_noise_that_correlates_a_free_simulation_is_no_finding(known):
    """Under filter error the innovations are tested, not the residuals of a simulation without corrections."""
    campaign, _, drawn = known
    record = run(known, "2", WAVE, 3)
    slow = replace(record, measurement=record.measurement + 0.05 * np.sin(0.3 * record.time)[:, None])
    predicted = _predict(campaign, drawn, slow)
    assert predicted.score("u").white < 1e-6
    filtered = FilterError(predicted.likelihood.output, (0.05,), extended_filter(1))
    found = replace(predicted, likelihood=filtered).score("u")
    assert (found.white, found.sd_factor) == (1.0, 1.0)


def test_two_runs_of_the_same_input_are_told(known):
    _, trials, _ = known
    again = run(known, "2", trials.fit[0].control[:, 0], 7)
    found, said = predicted(known, again)
    assert found.fits[0].level == "pass"
    assert said == [
        f"held-back run 2 has the input of run {trials.fit[0].label}, so a good prediction shows only that the vehicle repeats "
        "itself. Hold back a run with another input"
    ]


def test_one_run_that_is_fitted_leaves_the_bands_unjudged(known):
    campaign, trials, _ = known
    for fit, remedy in ((("1",), "record another run, and name it in `predict`"), (("1", "2"), "move a run from fit")):
        imported = replace(campaign, imports=ImportTable.model_construct(fit=fit, files=()))
        (said,) = held_back_cautions(imported.imports, replace(trials, predict=()))
        assert "the bands are not tested on new runs" in said
        assert remedy in said
    assert held_back_cautions(campaign.imports, replace(trials, predict=())) == []


def test_a_run_beyond_the_fitted_range_is_named(known):
    found, _ = predicted(known, run(known, "2", 1.6 * WAVE, 5))
    assert found.fits[0].outside[0].startswith(("n up to ", "u up to "))
    assert " (fitted up to " in found.fits[0].reason
    assert str(fit_complaints(found.fits, found.pooled)[-1]).startswith("held-back run 2 leaves the fitted range: ")


def test_a_model_that_has_become_wrong_is_an_alarm_with_the_factor_that_would_mend_its_bands(known):
    """A fifth of the thrust lost in the held-back runs, as by another propeller: the motion is explained, its bands do not hold."""
    found, _ = predicted(known, *(run(known, label, WAVE, 1, thrust=0.8) for label in "23"))
    assert found.pooled[0].level == "fail"
    assert held_back_alarms(found.fits, found.pooled)[0].remedies[0] == "widen-bands"
    assert found.pooled[0].widen > 1.5


def test_what_the_campaign_has_is_not_said_to_be_missing(known):
    """With a delay and slow residuals there are left a term and a force disturbance."""
    campaign, _, _ = known
    assert _setting(campaign).lacks["u"][1] == "add-delay"
    has = replace(
        campaign,
        priors={**campaign.priors, "delay": campaign.priors["T_nabsn"]},
        estimation=campaign.estimation.model_copy(update={"residuals": "coloured"}),
    )
    assert _setting(has).lacks["u"] == ("add-term", "filter-error")


def test_a_model_that_leaves_its_course_is_reported_with_its_eigenvalue(known):
    """Drag that drives: the run is lost, and neither a sensor nor a unit is blamed."""
    campaign, trials, drawn = known
    away = Known(campaign)
    away.values = drawn.values * [-1.0, 1.0, 1.0]
    fits = predict_held_back(campaign, away, replace(trials, predict=(run(known, "2", WAVE, 4),))).fits
    assert fits[0].verdict.code == "course-left"
    assert "a small error grows by e in" in fits[0].reason
    assert "over 3 s" in fits[0].reason
    assert "sensor fault" not in fits[0].reason
