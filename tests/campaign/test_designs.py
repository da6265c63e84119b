"""Designs of a campaign: several families over one grid, kept on disk, the best first."""

import numpy as np
import pytest

from seatrial.campaign.designs import design_first
from seatrial.campaign.load import load_campaign
from seatrial.campaign.store import Store
from seatrial.core.errors import InputError
from tests.campaign.small import SMALL


def campaign(folder, families):
    (folder / "campaign.toml").write_text(SMALL.replace("[design]\n", f"[design]\nfamilies = {families}\n"))
    return load_campaign(folder)


def test_families_share_a_grid_and_the_best_comes_first(tmp_path):
    """A spiral of seventeen levels only fits into 20 s at the shortest period of the grid, a chirp at any."""
    made = campaign(tmp_path, ["step", "repeated-doublet", "chirp", "spiral"])
    found = design_first(made)
    best = [float(np.nanmax(sweep.gain)) for sweep in found.sweeps]
    assert best == sorted(best, reverse=True)
    assert {sweep.family.kind for sweep in found.sweeps} == {"step", "repeated-doublet", "chirp"}
    assert list(found.refused) == ["spiral"]
    assert "to 1.176 s" in found.refused["spiral"]
    again = design_first(made)
    assert again.lines() == found.lines()
    assert found.lines()[0].startswith(found.best.family.words)
    schedule = Store(tmp_path).schedule(Store(tmp_path).design).read_text().splitlines()
    assert schedule[0] == "time_s,n_rpm"


@pytest.mark.parametrize(
    ("families", "message"),
    [
        (["doublets"], 'did you mean "doublet"'),
        (["step", "step"], "each family once"),
        (["spiral"], "to 1.176 s"),
    ],
)
def test_families_that_cannot_be_swept(tmp_path, families, message):
    with pytest.raises(InputError, match=message):
        design_first(campaign(tmp_path, families))


def with_goal(folder, goal):
    (folder / "campaign.toml").write_text(f"{SMALL}\n[goal]\n{goal}\n")
    return load_campaign(folder).goal


def test_a_goal_names_what_is_not_known_well_enough(tmp_path):
    goal = with_goal(tmp_path, 'sd = { X_u = "10 %", T_nabsn = 1e-5, X_uabsu = "0.5 kg/m" }')
    assert goal.unmet({"X_u": (-1.0, 0.2), "T_nabsn": (6e-4, 0.9e-5), "X_uabsu": (-3.0, 0.6)}) == pytest.approx(
        {"X_u": 2.0, "X_uabsu": 1.2}
    )
    assert goal.unmet({"T_nabsn": (6e-4, 2e-5)}) == pytest.approx({"T_nabsn": 2.0})


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ('sd = { X_v = "10 %" }', "goal.sd.X_v"),
        ('sd = { X_u = "ten %" }', 'a percentage such as "10 %"'),
        ('sd = { X_u = "-1 %" }', "a positive standard deviation"),
        ('sd = { X_u = "1 kg" }', "goal.sd.X_u"),
        ("trials = 0", "goal.trials"),
    ],
)
def test_goals_that_mean_nothing(tmp_path, goal, message):
    with pytest.raises(InputError, match=message):
        with_goal(tmp_path, goal)
