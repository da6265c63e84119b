"""Runs left out, as a stored command: what is said first, which error model is recommended, and campaigns that cannot have it."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from seatrial.campaign.store.cross_validation import (
    OWN,
    Candidate,
    ChannelScores,
    CrossValidation,
    decode_cross_validation,
)


def candidate(label, elpd, evidence, crps, error=OWN, lines=()):
    """One structure of three runs."""
    scores = ChannelScores("u", tuple(crps), 0.9, 0.5, 0.88, "pass", "88% of u lies inside the 90 % band")
    counted = {"errors": (0.1,) * 3, "k_hat": (0.2, 0.3, 0.1), "refitted": (False,) * 3}
    named = Candidate(label, ("X_u", label), error, "words", tuple(lines))
    return replace(named, elpd=tuple(elpd), log_evidence=evidence, channels=(scores,), **counted)


LIKELY = candidate("M-0", (10.0, 11.0, 12.0), -100.0, (0.020, 0.021, 0.022))
BETTER = candidate("M-1", (20.0, 22.0, 23.0), -104.0, (0.020, 0.021, 0.021))


def found(*candidates):
    return CrossValidation(("a", "b", "c"), candidates, ())


def test_disagreement_is_said_first():
    both = found(LIKELY, BETTER)
    first = both.lines()[0]
    assert first == both.alarms[0]
    assert "evidence and held-back score disagree: M-0 (X_u M-0) has probability 0.982" in first
    assert "M-1 predicts runs left out better by 32.0 ± 1.0 nats" in first


def test_disagreement_by_crps_alone():
    closer = candidate("M-1", (10.0, 11.0, 12.5), -104.0, (0.010, 0.012, 0.011))
    said = found(LIKELY, closer).disagreement()
    assert "simulates u of runs left out more closely" in said
    assert "nats" not in said


def test_within_two_standard_errors_nothing_is_claimed():
    """Ten nats that one run alone gives are ten standard errors of nothing."""
    lucky = candidate("M-1", (20.0, 11.0, 12.0), -104.0, (0.020, 0.021, 0.022))
    close = found(LIKELY, lucky)
    assert not close.alarms
    assert "which these 3 runs do not tell from chance" in close.lines()[0]


def test_recommendation():
    lines = ("[estimation]", 'residuals = "coloured"', "[prior.tau_u]", 'distribution = "log-uniform"', "lower = 0.05")
    slow = candidate("M-0", (40.0, 42.0, 41.0), -60.0, (0.02, 0.02, 0.02), "coloured", lines)
    said = "\n".join(found(LIKELY, slow).lines())
    assert found(LIKELY, slow).recommended is slow
    assert "    residuals" in said
    assert "not stated, so derived from the size of the data" in said
    assert found(LIKELY, replace(slow, elpd=(10.1, 11.2, 12.1))).recommended is None


def test_what_was_refused_is_told_and_not_scored():
    none = replace(Candidate("M-0", ("X_u",), "process noise", "words", ("[estimation]",)), refused="a lag")
    all_of = found(LIKELY, none)
    assert all_of.complaints() == ["M-0, process noise: a lag"]
    assert len(all_of.rows()) == 1


def test_as_json():
    both = found(LIKELY, BETTER)
    again = decode_cross_validation({**asdict(both)})
    assert again == both
    assert np.isclose(again.probability(LIKELY), 1 / (1 + np.exp(-4.0)))


@pytest.mark.parametrize(("level", "kind"), [("fail", "fail"), ("pass", "pass")])
def test_bands_are_judged(level, kind):
    judged = replace(LIKELY, channels=(replace(LIKELY.channels[0], level=level),))
    assert f"each run left out in turn: {kind};" in found(judged).lines()[1]
