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


def test_a_free_form_teaches_more_than_the_families_inside_the_limits(tmp_path):
    made = campaign(tmp_path, 'lower = "0 rpm"\nupper = "1500 rpm"', 'lower = "994 rpm"\nupper = "1394 rpm"')
    found, schedule = design_free_trial(made, 6)
    assert found.utility > found.beside + 0.05
    rpm = np.array(found.levels) * 30 / np.pi
    assert (rpm >= 994 - 1e-6).all()
    assert (rpm <= 1394 + 1e-6).all()
    time, value = np.loadtxt(schedule, delimiter=",", skiprows=1).T
    assert np.interp(1.0 + 20.0 / 6 * (np.arange(6) + 0.5), time, value) == pytest.approx(rpm)
    trim = 125.0 * 30 / np.pi
    assert value[0] == pytest.approx(trim)
    assert np.interp([21.2, 29.0], time, value) == pytest.approx(trim)
    assert found.lines()[0].startswith("free-form design by the D criterion: ")
    again, _ = design_free_trial(made, 6)
    assert again == found
    assert any("the best repeated doublet" in line for line in found.lines())


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
