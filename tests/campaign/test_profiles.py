"""Profile likelihoods on disk: open ends and points where the model diverges survive, and nothing is computed twice."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.profile import profile_all
from seatrial.campaign.store.stored_result import StoredResult
from seatrial.core.errors import InputError
from seatrial.core.reporter import SilentReporter
from seatrial.estimation.posterior.profile_result import Profiles
from tests.campaign.small import NO_X_U, write_small
from tests.report.test_profile_picture import profile


def test_open_ends_survive_the_disk(tmp_path):
    def through(one):
        kept = StoredResult(tmp_path / "M-0.json", "key", Profiles)
        kept.write(Profiles("M-0", (), (one,)))
        return kept.read().profiles[0]

    for kind in ("closed", "open above", "flat"):
        one = profile(kind)
        back = through(one)
        assert (back.kind, back.line, back.bounds) == (one.kind, one.line, one.bounds)
        np.testing.assert_array_equal(back.values, one.values)
    steep = replace(profile("closed"), drop=np.append(profile("closed").drop[:-1], np.inf))
    np.testing.assert_array_equal(through(steep).drop, steep.drop)


class Bars(SilentReporter):
    """Remembers what was begun."""

    def __init__(self):
        self.begun = []

    def progress(self, title):
        self.begun.append(title)
        return super().progress(title)


def test_what_is_there_is_read_and_what_is_missing_is_added(tmp_path):
    campaign = load_campaign(write_small(tmp_path, *NO_X_U))
    trials, bars = get_trials(campaign), Bars()
    one = profile_all(campaign, trials, ["X_uabsu"], bars)
    both = profile_all(campaign, trials, ["X_uabsu", "T_nabsn"], bars)
    again = profile_all(campaign, trials, ["T_nabsn"], bars)
    assert [title.split(": ")[1] for title in bars.begun] == ["X_uabsu", "T_nabsn"]
    np.testing.assert_array_equal(one.profiles[0].values, both.profiles[0].values)
    heading, _, thrust = both.lines()
    assert heading == "structure M-0, with every term: X_uabsu T_nabsn"
    assert again.lines() == [heading, thrust]
    assert again.open == []
    with pytest.raises(InputError, match='did you mean "X_uabsu"'):
        profile_all(campaign, trials, ["X_uabs"], bars)
