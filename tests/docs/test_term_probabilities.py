"""A vehicle of the study of term probabilities by which a failure was found."""

import sys
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.estimation.diagnostics.error_evidence import log_evidence_gains

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import term_probabilities


@pytest.mark.proof
def test_sources_that_lead_to_another_motion_are_followed_by_smaller_steps():
    """With whole steps the motion became unstable in the ninth round, and a vehicle without a term was given all four."""
    about = term_probabilities.ARMS["F"]
    present, records = term_probabilities.vehicle(about, "F", 113)
    assert not any(present)
    _, posteriors = about.family.posteriors(records)
    rivals = [posteriors[0], posteriors[-1]]
    modes = [st.find_mode(one, key=1) for one in rivals]
    gains = log_evidence_gains(rivals, modes)
    assert modes[0].log_evidence - modes[1].log_evidence > 15.0
    assert abs(np.subtract(*gains)) < 3.0
