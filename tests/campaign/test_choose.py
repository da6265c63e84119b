"""The route of `seatrial select` where the evidence of its structures is known."""

from pathlib import Path

import numpy as np
import pytest

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.selection.evidence import agreement_words, select_structure
from tests.campaign.small import write_small
from tests.selection.targets import far_peaks, one_peak, spike_on_slab


def selection_of(folder: Path, monkeypatch, full, without):
    """Selection of a campaign whose two structures have these posteriors."""
    campaign = load_campaign(write_small(folder))
    trials = get_trials(campaign)
    monkeypatch.setattr(Study, "posterior", lambda _, structure: full if "X_u" in structure.terms else without)
    return select_structure(campaign, trials)


def test_a_second_peak_is_weighed_and_the_methods_agree(tmp_path, monkeypatch):
    (full, exact), (without, other) = far_peaks(), one_peak()
    found = selection_of(tmp_path, monkeypatch, full, without)
    assert [evidence.log_value for evidence in found.evidences] == pytest.approx([exact, other], abs=0.02)
    assert "with which tempered SMC" in agreement_words(found.evidences[0])
    assert (found.alarms, found.evidences[0].diagnostics["modes"]) == ((), 2)


@pytest.mark.proof
def test_a_spike_on_a_slab_is_weighed_and_no_verdict_is_claimed(tmp_path, monkeypatch):
    """By the slab alone, a hundredth of its evidence, the full structure would lose to one of evidence between the two."""
    (full, exact), slab = spike_on_slab(), spike_on_slab(weight=np.exp(3.0), spike=0.1, away=0.0)
    found = selection_of(tmp_path, monkeypatch, full, slab[0])
    assert [evidence.log_value for evidence in found.evidences] == pytest.approx([exact, slab[1]], abs=0.05)
    assert "not reliable: adaptive tempered SMC finds -4." in found.alarms[0]
    assert found.verdicts[0].startswith("it cannot be said whether the data support X_u: its probability of 0.8")
