"""The free-form trial of a campaign: better than the families, inside its limits, kept, and refused without bounds."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.searches import design_free_trial
from seatrial.core.reporter import SilentReporter
from tests.campaign.test_designs import NARROW

pytestmark = pytest.mark.proof


class Said(SilentReporter):
    def __init__(self):
        self.texts = []

    def say(self, text):
        self.texts.append(text)


def campaign(folder, old="", new=""):
    (folder / "campaign.toml").write_text(NARROW.replace(old, new))
    return load_campaign(folder)


def test_levels_closer_than_the_ramp_are_joined_by_straight_lines_and_it_is_said(tmp_path):
    made = campaign(tmp_path, 'sample_time = "0.1 s"', 'sample_time = "0.1 s"\nramp = "4 s"')
    reporter = Said()
    found, schedule = design_free_trial(made, 8, reporter)
    (said,) = [text for text in reporter.texts if "design.ramp" in text]
    assert said.startswith("8 levels are 2.5 s apart, and design.ramp in ")
    assert said.endswith("5 levels or fewer keep the ramp")
    time, value = np.loadtxt(schedule, delimiter=",", skiprows=1).T
    joined = np.interp(time, 1.0 + 2.5 * np.arange(10), np.array([125.0, *found.levels, 125.0]) * 30 / np.pi)
    assert value == pytest.approx(joined, abs=0.05 * np.ptp(value))
