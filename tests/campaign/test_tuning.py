"""The check of a campaign's filter: that a tuned one passes, and that a wrong P, Q or R in the file is named."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.filter_tuning import check_filter
from seatrial.core.errors import InputError
from tests.campaign.small import write_small

DRIFT = "\n[filter]\nprocess_noise = { u = "


@pytest.fixture
def small(tmp_path, finished):
    """A folder of its own, and the estimate of the full structure of the small campaign, of which the filter takes the delay."""
    return tmp_path, finished[1].estimates[0]


def check(small, *replacements):
    folder, estimate = small
    campaign = load_campaign(write_small(folder, *replacements))
    return check_filter(campaign, estimate, get_trials(campaign))


def test_a_tuned_filter_needs_no_other_p_q_or_r(small):
    """Twenty seconds of doublets are too short for the drag coefficients to settle, which is all that is found.

    From priors this wide the filter is a little too sure of itself: its errors squared are five times what it states.
    """
    (one,) = check(small)
    assert {finding.code for finding in one.report.findings} == {"not-settled"}
    assert one.tuned
    assert one.constants == ("X_uabsu", "T_nabsn", "X_u")
    sd, error, _ = one.noise["u"]
    assert abs(sd - 0.05) < 3 * error
    assert 0.1 < one.report.nees < 10.0
    assert one.lines()[-1].endswith("Run the trial longer")


def test_too_large_a_process_noise_is_named(small):
    (one,) = check(small, ("[estimation]", f'{DRIFT}"1 m/s" }}\n[estimation]'))
    assert [finding.values["what"] for finding in one.report.findings] == ["Q"]
    assert "Lower Q of u" in one.lines()[-1]
    assert not one.tuned


def test_process_noise_is_what_is_gained_in_one_second(small):
    """The same number as a float of SI and as a quantity, for a state and for a coefficient; of a smaller structure, its own."""
    campaign = load_campaign(write_small(small[0], ("[estimation]", f'{DRIFT}"3 cm/s", X_u = 0.2 }}\n[estimation]')))
    full, smaller = (campaign.model(campaign.structures[at]) for at in (0, -1))
    assert campaign.process_sds(full) == pytest.approx([0.03, 0.0, 0.0, 0.2])
    assert campaign.process_sds(smaller).size == len(smaller.states) + len(smaller.coefficients) == 3


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ('{ X_uu = "1 kg/s" }', ["filter.process_noise.X_uu", "X_uabsu"]),
        ('{ u = "1 kg" }', ["filter.process_noise.u", "m/s"]),
        ("{ u = -1.0 }", ["filter.process_noise.u", "0 or more"]),
        ("{ u = nan }", ["filter.process_noise.u", "a finite number"]),
        ("{ u = true }", ["filter.process_noise.u"]),
    ],
)
def test_process_noise_that_cannot_be_used(tmp_path, written, words):
    folder = write_small(tmp_path, ("[estimation]", f"[filter]\nprocess_noise = {written}\n[estimation]"))
    with pytest.raises(InputError) as refused:
        load_campaign(folder)
    assert all(word in str(refused.value) for word in words)


def test_noise_that_the_record_cannot_show_is_not_guessed(small):
    """One measurement a second leaves 30 of them, fewer than the differences need."""
    (one,) = check(small, ('noise = "0.05 m/s"', 'noise = "0.05 m/s"\nrate = "1.5 Hz"'))
    assert "differences" in str(one.noise["u"])
    assert "state the noise" in "\n".join(one.lines())
    assert np.isfinite(one.report.nis)
