"""Sway and yaw by a campaign: screened, estimated and refused where only surge is known."""

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.selection.screening import screening_of
from seatrial.campaign.workflow.loop import run_loop
from seatrial.core.errors import InputError
from tests.campaign.yaw_campaign import write_yaw


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return load_campaign(write_yaw(tmp_path_factory.mktemp("yaw")))


def test_two_axes_are_screened_together(campaign):
    found, _ = screening_of(campaign, get_trials(campaign))
    inclusion = dict(zip(found.data["term"].values.tolist(), found.data["inclusion"].values.tolist(), strict=True))
    assert inclusion["N_uv"] > 0.99
    assert inclusion["N_rabsr"] < 0.1


def test_a_trial_is_designed_about_the_trim_of_every_control(campaign):
    with pytest.raises(InputError, match=r"(?s)vehicle\.trim\.u.*while a trial moves another control"):
        run_loop(campaign)


def test_a_mass_on_other_axes_is_refused(tmp_path):
    path = write_yaw(tmp_path) / "campaign.toml"
    path.write_text(path.read_text().replace('mass = "unknown"', 'mass = "30 kg"'))
    with pytest.raises(InputError, match=r"(?s)which has no part in the motion.*an unknown mass"):
        load_campaign(tmp_path)
