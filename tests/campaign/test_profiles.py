"""Profile likelihoods on disk: open ends and points where the model diverges survive, and nothing is computed twice."""

import json
from dataclasses import replace

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.profile import _as_json, _from_json, profile_all
from seatrial.core.errors import InputError
from seatrial.core.progress import SilentReporter
from tests.campaign.small import NO_X_U, write_small
from tests.report.test_profile_picture import profile


def test_open_ends_survive_the_disk():
    for kind in ("closed", "open above", "flat"):
        one = profile(kind)
        back = _from_json(json.loads(json.dumps(_as_json(one), allow_nan=False)))
        assert (back.kind, back.line, back.bounds) == (one.kind, one.line, one.bounds)
        np.testing.assert_array_equal(back.values, one.values)
    steep = replace(profile("closed"), drop=np.append(profile("closed").drop[:-1], np.inf))
    assert _from_json(json.loads(json.dumps(_as_json(steep), allow_nan=False))).values.size == steep.values.size - 1


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
    assert again.lines() == both.lines()[1:]
    assert again.open == []
    with pytest.raises(InputError, match='did you mean "X_uabsu"'):
        profile_all(campaign, trials, ["X_uabs"], bars)
