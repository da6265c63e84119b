"""How many programs are compiled on the way to an answer: ceilings, and what they must not depend on.

Lengths are ones that no other test has, so that nothing here was compiled before.
"""

from dataclasses import replace

import jax
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.check import check_records, likely_causes
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.simulate import simulated_records
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.inference.estimate import estimate_all
from seatrial.campaign.inference.identifiability import known_before
from seatrial.campaign.inference.quick_estimates import posterior_modes
from seatrial.campaign.prior.predictive import predict_from_prior
from seatrial.campaign.selection.evidence import select_structure
from tests.campaign.small import write_small

TWO_MORE = (
    ('optional = ["X_u"]', 'optional = ["X_u", "X_du3"]'),
    ("[prior.X_u]", '[prior.X_du3]\ndistribution = "normal"\nmean = 0.0\nsd = 1.0\n\n[prior.X_u]'),
    ("[truth]", "[truth]\nX_du3 = 0.0"),
)


def lasting(seconds):
    return ('duration = "30 s"', f'duration = "{seconds} s"')


def design(campaign):
    known_before(campaign, design_first(campaign).best)


def test_every_command_needs_few_programs(tmp_path, programs):
    campaign = load_campaign(write_small(tmp_path, lasting(33.1)))
    jax.clear_caches()
    assert programs(design, campaign) <= 3
    assert programs(simulated_records, campaign) <= 2
    assert programs(lambda: check_records(campaign, get_trials(campaign))) <= 3
    assert programs(predict_from_prior, campaign) <= 5  # One repeats draws that diverge, with shorter steps
    assert programs(posterior_modes, campaign, get_trials(campaign)) <= 10


def test_records_of_any_length_are_judged_by_the_same_programs(tmp_path, programs):
    campaign = load_campaign(write_small(tmp_path, lasting(35.1)))
    (record,) = get_trials(campaign).fit
    part = replace(record, time=record.time[:150], control=record.control[:150], measurement=record.measurement[:150])
    likely_causes(campaign, [record])
    assert programs(likely_causes, campaign, [part, record]) == 0


def test_logs_and_campaigns_of_other_names_need_no_program(tmp_path, programs):
    starts = ("chains = 16", 'initial = "estimated"\nchains = 16')
    first = load_campaign(write_small(tmp_path / "first", lasting(47.1), starts))
    second = load_campaign(
        write_small(tmp_path / "second", lasting(47.1), starts, ('name = "small"', 'name = "other"'))
    )
    trials = get_trials(first)
    renamed = replace(trials, fit=tuple(replace(record, label="another") for record in trials.fit))
    assert programs(posterior_modes, first, trials) > 0
    assert programs(posterior_modes, second, renamed) == 0


@pytest.mark.proof
def test_a_design_needs_no_more_programs_for_more_structures(tmp_path, programs):
    campaign = load_campaign(write_small(tmp_path, lasting(37.1), *TWO_MORE))
    assert len(campaign.structures) == 4
    jax.clear_caches()
    assert programs(design, campaign) <= 3


@pytest.mark.proof
def test_a_design_of_another_length_in_the_bucket_needs_no_program(tmp_path, programs):
    first, second = (load_campaign(write_small(tmp_path / str(s), lasting(s))) for s in (41.1, 41.5))
    design(first)
    assert programs(design, second) == 0


@pytest.mark.proof
def test_all_structures_share_what_is_compiled(tmp_path, programs):
    """The widest structure and another are done first; two more then need nothing more."""
    campaign = load_campaign(write_small(tmp_path, lasting(43.1), *TWO_MORE))
    trials = get_trials(campaign)
    pair = replace(campaign, shortlist=campaign.structures[:2])
    for work, most in ((estimate_all, 14), (select_structure, 2)):
        assert 0 < programs(work, pair, trials) <= most
        assert programs(work, campaign, trials) == 0
