"""Screening of a vehicle whose axes are coupled: 128 structures on three axes, against modes of their own by simulation."""

import pytest

from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.selection.screening import screening_of, with_shortlist
from seatrial.compiled.random_keys import random_key
from seatrial.estimation.posterior.mode import find_mode
from seatrial.messages.structures import screening_lines
from seatrial.selection.structures import Structure
from tests.campaign.test_thrusters import CAMPAIGN, campaign, log  # noqa: F401

OPTIONAL = ("Y_v", "X_uabsu", "Y_vabsv", "N_rabsr", "Y_r", "N_v", "N_uv")
TRUE = {"X_u", "Y_v", "N_r"}


def priors():
    return "\n".join(
        f'[prior.{name}]\ndistribution = "normal"\nmean = 0.0\nsd = {8.0 if name[0] == "N" else 30.0}\n'
        for name in OPTIONAL
        if name != "Y_v"
    )


@pytest.mark.proof
def test_terms_of_three_axes_are_screened_about_the_mode_of_all(tmp_path, log):  # noqa: F811
    found = campaign(
        tmp_path,
        log,
        ('always = ["X_u", "Y_v", "N_r"]', f'always = ["X_u", "N_r"]\noptional = {list(OPTIONAL)}'.replace("'", '"')),
        ("[prior.gain_f_2]", f"{priors()}\n[prior.gain_f_2]"),
    )
    trials = get_trials(found)
    assert found.is_large
    screened, cautions = screening_of(found, trials)
    assert cautions == []
    inclusion = dict(
        zip(screened.data["term"].values.tolist(), screened.data["inclusion"].values.tolist(), strict=True)
    )
    assert inclusion["Y_v"] > 0.99
    assert max(inclusion[name] for name in OPTIONAL if name != "Y_v") < 0.5
    assert set(screened.terms(0)) == TRUE
    said = "\n".join(screening_lines(screened))
    assert "axis Y: needed: Y_v" in said
    assert "axis X: " in said and "axis N: " in said  # noqa: PT018
    best, second = (screened.terms(rank) for rank in (0, 1))
    assert [set(one.terms) for one in with_shortlist(found, trials).structures][-1] == TRUE
    expected = float(screened.data["log_evidence"].values[0] - screened.data["log_evidence"].values[1])
    alone = [
        find_mode(build_posterior(found, one, trials.fit), key=random_key(1, "mode")).log_evidence
        for one in (Structure("a", best), Structure("b", second))
    ]
    assert alone[0] - alone[1] == pytest.approx(expected, abs=0.1)
