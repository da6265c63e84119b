"""A campaign's values moved by hand, and a start for its search of the mode."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.load import check_text, load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference import modes
from seatrial.campaign.inference.modes import kept_modes, structure_modes
from seatrial.core.errors import InputError, NumericalError
from seatrial.dashboard.tweak_queries import movable, start_text, tweaked
from seatrial.dashboard.view_models import Tweaking
from seatrial.estimation.posterior.mode import Mode
from tests.campaign.small import LOGGED, NO_X_U, write_small
from tests.campaign.test_configurations import DIFFERING
from tests.campaign.test_heave import write_heave
from tests.cases import U0
from tests.estimation_cases import naive_doublets, naive_speed


@pytest.fixture(scope="module")
def boat(tmp_path_factory):
    """A campaign of one logged run with its mode, of which nothing else was estimated."""
    place = tmp_path_factory.mktemp("moved") / "boat"
    folder = write_small(place, *NO_X_U, (LOGGED[0].replace("X_u = -1.21\n", ""), LOGGED[1]), ("0e-4", "0e-3"))
    time, random = np.arange(400) * 0.1, np.random.default_rng(3)
    rev_per_s = naive_doublets(time, 200, 10, active=30)
    speed = naive_speed(rev_per_s, np.full(400, 0.1), U0) + 0.02 * random.normal(size=400)
    rows = (f"{t:.1f},{u:.4f},{60 * n:.1f}" for t, u, n in zip(time, speed, rev_per_s, strict=True))
    (folder / "log_1.csv").write_text("t,speed,rpm\n" + "\n".join(rows) + "\n")
    campaign = load_campaign(folder)
    trials = get_trials(campaign)
    with pytest.raises(InputError, match="best values that are missing"):
        tweaked(str(folder), ("before",), Tweaking(), None)
    structure_modes(Study(campaign, trials.fit), trials)
    return campaign, trials


def test_values_are_moved_in_the_units_in_which_they_are_shown_and_nothing_is_written(boat):
    campaign, _ = boat
    folder, before = str(campaign.folder), {p: p.stat().st_mtime_ns for p in campaign.folder.rglob("*") if p.is_file()}
    form = tweaked(folder, (), Tweaking(), None)
    best = {one.name: one.best for one in form.numbers}
    assert list(best) == ["X_uabsu", "T_nabsn", "mass"]
    assert all(one.lower < one.value == one.best < one.upper for one in form.numbers)
    assert form.numbers[-1].sd == pytest.approx(0.05 * campaign.hull.mass)
    moved = (("X_uabsu", 1.1 * best["X_uabsu"]),)
    asked = Tweaking(form.structures[0], form.records[0], moved, follow=True)
    answer = tweaked(folder, (), asked, (0.0, 39.9, 50))
    values = {one.name: one.value for one in answer.numbers}
    assert values["X_uabsu"] == pytest.approx(1.1 * best["X_uabsu"])
    assert values["T_nabsn"] > best["T_nabsn"]  # more thrust for more drag
    assert set(answer.curves) == {"u", "u best", "u measured", "u residual"}
    assert answer.distance == pytest.approx(abs(0.1 * best["X_uabsu"]) / form.numbers[0].sd)
    assert min(answer.below) > 0.0
    assert answer.span == pytest.approx((0.0, 39.9))
    with pytest.raises(InputError, match=r"X_uabsu(.|\n)*outside its prior(.|\n)*from -8.8 to 0 "):
        start_text(folder, (), asked, campaign.text, (*values.items(), ("X_uabsu", -9.0)))
    lines, text = start_text(folder, (), asked, campaign.text, tuple(values.items()))
    assert lines.startswith("[estimation.start_values]\n")
    assert "mass" not in lines
    assert text.startswith(campaign.text[:200])
    assert {p: p.stat().st_mtime_ns for p in campaign.folder.rglob("*") if p.is_file()} == before
    (campaign.folder / "campaign.toml").write_text(text)
    try:
        again = load_campaign(campaign.folder)
        assert again.estimation.start_values["X_uabsu"] == pytest.approx(values["X_uabsu"], rel=1e-5)
        assert kept_modes(again, get_trials(again)) is None  # the search has another start: it is made again
        wrong = text.replace("[estimation.start_values]\n", "[estimation.start_values]\nX_v = 1.0\n")
        with pytest.raises(InputError, match="X_v"):
            check_text(campaign.folder, wrong)
    finally:
        (campaign.folder / "campaign.toml").write_text(campaign.text)


def test_a_stated_start_is_climbed_from_and_the_highest_mode_is_kept(boat, monkeypatch):
    campaign, trials = boat
    kept = kept_modes(campaign, trials)
    assert kept is not None
    (known,) = kept.of(campaign.structures[0])
    asked = []

    def find_mode(posterior, *, key, near=None, **more):
        asked.append((near, more))
        if more:
            return known._replace(log_density=known.log_density + 3.0)
        raise NumericalError("lost")

    monkeypatch.setattr(modes, "find_mode", find_mode)
    started = replace(campaign, estimation=campaign.estimation.model_copy(update={"start_values": {"X_uabsu": -2.0}}))
    item = modes._Known(campaign.structures[0], (), ())
    result = modes._find(Study(started, trials.fit), item, lambda *_: None)
    assert isinstance(result, Mode)
    assert result.log_density == known.log_density + 3.0
    assert asked == [(None, {}), ({"X_uabsu": -2.0}, {"starts": 1})]
    assert isinstance(modes._find(Study(campaign, trials.fit), item, lambda *_: None), NumericalError)


def test_coefficients_of_the_configuration_of_a_record_are_among_those_that_are_moved(tmp_path):
    campaign = write_heave(tmp_path, DIFFERING)
    trials = get_trials(campaign)
    structure_modes(Study(campaign, trials.fit), trials)
    folder, label = str(campaign.folder), campaign.full.label
    for configuration in ("empty", "loaded"):
        names = [one.name for one in movable(folder, (), label, configuration)]
        assert [one for one in names if "@" in one] == [f"{one}@{configuration}" for one in ("Z_wabsw", "net_weight")]
    loaded = {one.name: one.best for one in movable(folder, (), label, "loaded")}
    asked = Tweaking(label, "b", (("net_weight@loaded", loaded["net_weight@loaded"] + 1.0),))
    answer = tweaked(folder, (), asked, None)
    assert answer.below[0] == pytest.approx(answer.below[1])  # no other record is of that configuration
    assert answer.below[0] > 0.1
