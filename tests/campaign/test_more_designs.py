"""What a design may be asked for beside the best of the grid: other utilities and filters, batches, sensors, a global search."""

import numpy as np
import pytest

from seatrial.campaign.batch_trial import plan_together
from seatrial.campaign.designs import design_first
from seatrial.campaign.global_trial import search_design
from seatrial.campaign.load import load_campaign
from seatrial.campaign.sensor_table import sensor_table
from seatrial.core.errors import InputError
from tests.campaign.test_designs import NARROW

PREDICTION = '\n[design.prediction]\nof = "distance"\ncontrol = "0 rpm"\nafter = "15 s"\n'


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


def test_a_utility_that_lacks_what_it_needs(tmp_path):
    with pytest.raises(InputError, match=r"without \[design.prediction\]"):
        design_first(asked(tmp_path, 'utility = "fisher-c"'))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("distance", "theta"), "design.prediction"),
        (("15 s", "0 s"), "a positive time"),
        (('"0 rpm"', '"0 m"'), "design.prediction.control"),
    ],
)
def test_predictions_that_cannot_be_made(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        design_first(asked(tmp_path, more=PREDICTION.replace(*change)))


def test_structures_are_told_apart_by_the_design_that_moves_most(tmp_path):
    """X_uabsu against none: the evidence of its absence grows with the excursion of the speed."""
    found = design_first(asked(tmp_path, 'utility = "discrimination"')).best
    assert np.nanmin(found.worth) > 0
    assert found.best[0] == found.amplitude.size - 1


def test_a_trial_is_ended_when_that_pays(tmp_path):
    """Without a way back it ends soon after the input has taught; half an hour of it lets the trial run on."""
    lengths = []
    for turnaround in ("0 s", "1800 s"):
        folder = tmp_path / turnaround.split()[0]
        folder.mkdir()
        found = design_first(asked(folder, f'utility = "fisher-d"\nper = "second"\nturnaround = "{turnaround}"'))
        assert "nat/s" in found.lines()[0]
        assert "ended after" in found.lines()[0]
        lengths.append(found.best.length[found.best.best])
        assert found.best.best_manoeuvre().duration == lengths[-1]
    assert lengths[0] < 0.7 * lengths[1]


@pytest.mark.parametrize("name", ["extended", "unscented"])
def test_other_filters_agree_where_the_belief_is_narrow(tmp_path, name):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    usual = design_first(asked(tmp_path / "a")).best.gain
    other = design_first(asked(tmp_path / "b", f'filter = "{name}"')).best.gain
    np.testing.assert_allclose(other, usual, atol=0.1)
    assert (other != usual).any()


def test_trials_of_one_day_sensors_and_a_search_between_the_points(tmp_path):
    campaign = asked(tmp_path, 'utility = "fisher-d"')
    batch = plan_together(campaign, 2)
    assert batch.found.utility[1] >= batch.found.repeated - 1e-9
    assert all(path.is_file() for path in batch.schedules)
    best = design_first(campaign).best
    table = sensor_table(campaign)
    assert table.rows[0][1].utility == pytest.approx(np.nanmax(best.worth), rel=1e-6)
    by_rate = [worth.utility for words, worth in table.rows if " Hz" in words]
    assert by_rate == sorted(by_rate)
    found, _, schedule = search_design(campaign, 160)
    assert found.utility > found.beside - 0.05  # the search chose on other draws
    assert schedule.is_file()
    assert search_design(campaign, 160)[0] == found
