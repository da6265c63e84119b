"""What several files of tests share: it is made once."""

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.workflow.loop import run_loop
from tests.campaign.small import write_small


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """The small campaign after its whole loop: folder and outcome; who changes a file copies the folder first."""
    folder = write_small(tmp_path_factory.mktemp("finished") / "small")
    return folder, run_loop(load_campaign(folder))
