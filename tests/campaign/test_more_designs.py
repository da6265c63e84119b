"""What a design may be asked for beside the best of the grid: other utilities and filters, batches, sensors, a global search."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.plan import stated_share
from seatrial.campaign.design.problem import prior_draws
from seatrial.campaign.design.searches import (
    compare_measures,
    design_free_trial,
    plan_together,
    search_design,
    sensor_table,
)
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from seatrial.design.results import edge_words
from seatrial.design.safety import judge_safety
from seatrial.design.trial_plan import plan_trial
from seatrial.messages.designs import batch_lines, search_lines, sensor_lines
from tests.campaign.small import NO_X_U, write_small
from tests.campaign.test_designs import NARROW

PREDICTION = '\n[design.prediction]\nof = "distance"\ncontrol = "0 rpm"\nafter = "15 s"\n'
POWER = '\n[power]\nhotel = "20 W"\npropulsion = "40 W"\nat = "1500 rpm"\n'


def asked(folder, design="", more=""):
    (folder / "campaign.toml").write_text(NARROW.replace("[design]\n", f"[design]\n{design}\n") + more)
    return load_campaign(folder)


def test_a_stated_prediction_is_known_better_by_the_design_that_serves_it(tmp_path):
    for name in ("c", "d"):
        (tmp_path / name).mkdir()
    served = design_first(asked(tmp_path / "c", 'utility = "fisher-c"', PREDICTION))
    other = design_first(asked(tmp_path / "d", 'utility = "fisher-d"', PREDICTION))
    assert "distance 15 s after n is set to 0 rpm" in served.prediction[0]
    then = [float(found.prediction[0].split("±")[2].split()[0]) for found in (served, other)]
    assert then[0] <= then[1]
    assert served.best.worth.shape == other.best.worth.shape
    assert not np.allclose(served.best.worth, other.best.worth)


@pytest.mark.parametrize(
    ("design", "place"),
    [
        ('utility = "fisher-c"', r"design.utility[^$]*without \[design.prediction\]"),
        ('per = "second"\nturnaround = "-5 s"', "design.turnaround"),
        ('turnaround = "60 s"', r"design.turnaround[^$]*does not use it"),
        ('per = "second"\nover = "worst"', "design.over"),
    ],
)
def test_what_a_utility_needs_is_looked_for_when_the_file_is_read(tmp_path, design, place):
    with pytest.raises(InputError, match=place):
        asked(tmp_path, design)


def test_a_single_structure_has_nothing_to_be_told_apart(tmp_path):
    write_small(tmp_path, *NO_X_U, ("[design]\n", '[design]\nutility = "discrimination"\n'))
    with pytest.raises(InputError, match=r"design.utility[^$]*of a single structure"):
        load_campaign(tmp_path)


@pytest.mark.parametrize(
    ("per", "search", "work"),
    [
        ("second", "a free form", lambda campaign: design_free_trial(campaign, 6)),
        ("second", "a global search", lambda campaign: search_design(campaign, 60)),
        ("second", "trials planned together", lambda campaign: plan_together(campaign, 2)),
        ("second", "a comparison of measures", lambda campaign: compare_measures(campaign, 5)),
        ("joule", "a global search", lambda campaign: search_design(campaign, 60)),
    ],
)
def test_searches_that_know_whole_trials_only(tmp_path, per, search, work):
    campaign = asked(tmp_path, f'per = "{per}"', POWER)
    with pytest.raises(InputError, match=f"design.per[^$]*{search}"):
        work(campaign)
    assert not list(tmp_path.rglob("*.nc"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("distance", "theta"), "design.prediction.of"),
        (("15 s", "0 s"), "a positive time"),
        (('"0 rpm"', '"0 m"'), "design.prediction.control"),
    ],
)
def test_predictions_that_cannot_be_made(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        asked(tmp_path, more=PREDICTION.replace(*change))


def test_structures_are_told_apart_by_the_design_that_moves_most(tmp_path):
    """X_uabsu against none: the evidence of its absence grows with the excursion of the speed."""
    found = design_first(asked(tmp_path, 'utility = "discrimination"')).best
    assert np.nanmin(found.worth) > 0
    assert found.best[0] == found.amplitude.size - 1


def test_what_is_said_of_a_trial_that_is_ended_is_of_that_trial(tmp_path):
    """Gain, standard deviations, safety and what is known after it: by a plan of that many samples and no more."""
    limited = PREDICTION + "\n[limits.distance]\nupper = '43 m'\n"
    campaign = asked(tmp_path, 'utility = "fisher-d"\nper = "second"\nturnaround = "20 s"', limited)
    designs = design_first(campaign)
    best, model, draws = (
        designs.best,
        campaign.model(campaign.full),
        prior_draws(campaign, campaign.model(campaign.full)),
    )
    at, length = best.best, float(best.length[best.best])
    assert 5 < length < 28
    assert best.gain[at] / (20.0 + length) == pytest.approx(best.worth[at], rel=1e-9)
    controls, cov = best.best_controls(), np.cov(draws, rowvar=False)
    plan = plan_trial(model, campaign.state_trim(model), {"u": 0.05}, len(controls), 0.1)
    assert len(controls) == round(length / 0.1)
    information = np.stack([np.asarray(plan.information(values, controls)) for values in draws[:32]])
    left = np.linalg.inv(np.linalg.inv(cov) + information)
    assert best.gain[at] == pytest.approx(
        0.5 * np.mean(np.linalg.slogdet(cov)[1] - np.linalg.slogdet(left)[1]), rel=1e-6
    )
    after = np.sqrt(np.diagonal(left, axis1=1, axis2=2).mean(0))
    np.testing.assert_allclose(best.final_sd[at], after, rtol=1e-6)
    told = judge_safety(plan, controls[None], draws[len(draws) // 2 :], campaign.motion_limits, 0.95).words(0)
    assert designs.safety == told
    time, value = np.loadtxt(Store(tmp_path).schedule(Store(tmp_path).design), delimiter=",", skiprows=1).T
    assert time[-1] == pytest.approx(length, abs=0.11)
    assert value[-1] == pytest.approx(best.family.trim * 30 / np.pi)


@pytest.mark.parametrize("name", ["extended", pytest.param("unscented", marks=pytest.mark.proof)])
def test_other_filters_agree_where_the_belief_is_narrow(tmp_path, name):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    usual = design_first(asked(tmp_path / "a")).best.gain
    other = design_first(asked(tmp_path / "b", f'filter = "{name}"')).best.gain
    np.testing.assert_allclose(other, usual, atol=0.1)
    assert (other != usual).any()


def test_trials_of_one_day_sensors_and_a_search_between_the_points(tmp_path):
    campaign = asked(tmp_path, 'utility = "fisher-d"', "\n[goal]\nsd = { T_nabsn = 4.1e-5 }\n")
    batch = plan_together(campaign, 2)
    assert " nat so far" in batch_lines(batch)[1]
    assert batch.found.utility[1] >= batch.found.repeated - 1e-9
    assert all(path.is_file() for path in batch.schedules)
    best = design_first(campaign).best
    table = sensor_table(campaign)
    assert table.rows[0][1].utility == pytest.approx(np.nanmax(best.worth), rel=1e-6)
    assert table.rows[0][0] == "as they are: u at 10 Hz"
    assert {"u at 5 Hz", "u of noise 0.025 m/s"} <= {words for words, _ in table.rows}
    at = table.names.index("T_nabsn")
    stated = stated_share(campaign, campaign.model(campaign.full), "T_nabsn") * table.mean[at]
    assert table.meets == tuple(bool(np.hypot(worth.sd[at], stated) < 4.1e-5) for _, worth in table.rows)
    assert any(table.meets)
    assert not all(table.meets)
    assert sum("meets the goal" in line for line in sensor_lines(table)) == sum(table.meets)
    by_rate = [worth.utility for words, worth in table.rows[1:] if " Hz" in words]
    assert by_rate == sorted(by_rate)
    found, family, schedule = search_design(campaign, 160)
    assert found.utility > found.beside - 0.05  # the search chose on other draws
    assert schedule.is_file()
    assert search_lines(search_design(campaign, 170)[0], family)[0].startswith(
        "global search over 160 designs (170 asked for: "
    )
    assert f"{found.utility:.3f} nat, the best of the grid" in search_lines(found, family)[0]
    assert search_design(campaign, 160)[0] == found


def test_a_trim_outside_the_limits_is_told_from_amplitudes_that_are_too_large(tmp_path):
    for families in ('["doublet"]', '["doublet", "step"]'):
        campaign = load_campaign(
            write_small(
                tmp_path / str(len(families)),
                ('upper = "1500 rpm"', 'upper = "600 rpm"'),
                ('control = "n"', f'control = "n"\nfamilies = {families}'),
            )
        )
        with pytest.raises(InputError) as caught:
            design_first(campaign)
        assert caught.value.remedy.startswith("the trim itself, ")
        assert "amplitude" not in caught.value.remedy


def test_a_best_design_at_the_edge_of_the_grid_names_the_key_to_widen():
    assert edge_words(5, 4, (4, 1)) == (
        "the best amplitude lies on the edge of the grid: widen design.amplitude if the limits allow it"
    )
    assert "amplitude and period lie on" in edge_words(5, 4, (0, 3))
    assert edge_words(1, 4, (0, 2)) == ""
