"""What is kept of identifiability: numbers against the closed form of a linear problem, and the same after a round trip."""

import json
from dataclasses import replace

import numpy as np
import pytest

from seatrial.campaign.inference.identifiability import _known
from seatrial.core.display_units import shown_as_written
from seatrial.core.serialise import from_plain, to_plain
from seatrial.estimation.diagnostics.identifiability import identify
from seatrial.estimation.diagnostics.known import Known, KnownParameter
from seatrial.estimation.posterior.posterior import Parameter
from seatrial.estimation.priors import Normal
from seatrial.messages.known import BY_ITSELF, known_lines, parts_of, verdict_of
from seatrial.messages.render import sentence

AT = {"u": 1.5}
NAMES, UNITS = ("X_u", "X_uabsu", "T_nabsn"), ("kg/s", "kg/m", "kg m/rad^2")


def judged(design, values=(-3.0, -2.0, 6e-4), prior_sd=(30.0, 20.0, 6e-3)):
    """Posterior of y = design c + e, e standard normal, and what is kept of it."""
    parameters = [
        Parameter(name, unit, name, Normal(0.0, sd)) for name, unit, sd in zip(NAMES, UNITS, prior_sd, strict=True)
    ]
    information = design.T @ design
    cov = np.linalg.inv(np.nan_to_num(information) + np.diag(np.array(prior_sd) ** -2.0))
    found = identify(parameters, np.array(values), information, cov=cov, at=AT)
    return _known(found, information, "M-0"), information, cov


def regressors():
    """Drag at speeds in a narrow range: X_u and X_uabsu show almost the same."""
    u = np.linspace(1.4, 1.6, 400)
    n = 125.0 + 10.0 * np.cos(np.arange(400))
    return np.column_stack([20 * u, 20 * u * u, n * n])


def test_each_parameter_is_told_with_what_it_is_confused_with():
    known, _, cov = judged(regressors())
    sd = np.sqrt(np.diag(cov))
    for i, item in enumerate(known.parameters):
        assert item.sd == pytest.approx(sd[i])
        assert item.relative == pytest.approx(sd[i] / abs((-3.0, -2.0, 6e-4)[i]))
        assert item.left == pytest.approx(sd[i] / (30.0, 20.0, 6e-3)[i])
    first, second, _ = known.parameters
    assert (first.partner, second.partner) == ("X_uabsu", "X_u")
    assert first.correlation == pytest.approx(cov[0, 1] / sd[0] / sd[1])
    assert any("known much better in combination" in text and "X_u" in text for text in known.verdict)


def test_a_direction_is_a_change_of_one_standard_error():
    known, information, _ = judged(regressors())
    values = dict(zip(NAMES, (-3.0, -2.0, 6e-4), strict=True))
    assert len(known.directions) == 3
    assert [item.sd for item in known.directions] == sorted(item.sd for item in known.directions)
    for direction in known.directions:
        change = np.array([dict(direction.moves).get(name, 0.0) * values[name] for name in NAMES])
        # What is left unnamed is under a tenth of the largest change, and of the smallest direction that can be much.
        if len(direction.moves) == 3:
            assert change @ information @ change == pytest.approx(1.0)
    assert dict(known.directions[-1].moves).keys() >= {"X_u", "X_uabsu"}
    assert "%" in parts_of(known.directions[-1])[0][1]


def test_the_table_names_the_verdict_or_says_that_there_is_none():
    known, _, _ = judged(regressors())
    said = "\n".join(known_lines(known, shown_as_written({})))
    for word in (
        "known to",
        "strongest correlation",
        "with X_uabsu",
        "known much better in combination",
        "least-determined direction",
    ):
        assert word in said
    alone, _, _ = judged(np.kron(np.eye(3), np.ones((4, 1))) * np.array([10.0, 10.0, 1e5]))
    assert alone.verdict == ()
    assert known_lines(alone, shown_as_written({}))[-1].strip() == BY_ITSELF
    first, *others = alone.parameters
    sure = replace(alone, parameters=(replace(first, sd=0.4 * abs(first.value)), *others))
    assert verdict_of(sure) == (BY_ITSELF,)
    unsure = replace(alone, parameters=(replace(first, sd=0.9 * abs(first.value)), *others))
    assert verdict_of(unsure) == (f"{BY_ITSELF}, but the ± of X_u exceeds half of the value",)


def test_terms_that_only_the_speed_separates_are_named():
    """N_v and N_uv, as Y_r and Y_ur, but not X_u and X_uabsu: that pair has its own sums. One that is known needs no advice."""
    relative = {"N_v": 0.6, "N_uv": 0.3, "N_r": 0.1, "N_ur": 0.9, "X_u": 2.0, "X_uabsu": 2.0, "Y_0": 2.0, "Y_v": 2.0}
    parameters = tuple(KnownParameter(name, "1", 1.0, sd, sd, 0.1, "", 0.0) for name, sd in relative.items())
    (one,) = Known("after", "M-0", parameters, (), ()).speed_pairs
    assert sentence(one) == (
        "N_v and N_uv differ only by a factor u, and these runs do not separate them: the ± of N_v is 60% of its value. "
        "Keep N_uv, which scales with the speed, and leave N_v out, or fit runs at another speed too"
    )


def test_what_is_sharp_by_itself_is_not_called_known_only_in_combination():
    """Ten thousand times the data: the same correlation, and each parameter known a hundred times better than a per cent is."""
    known, _, cov = judged(100 * regressors())
    assert abs(cov[0, 1]) > 0.9 * np.sqrt(cov[0, 0] * cov[1, 1])
    assert max(item.relative for item in known.parameters) < 0.01
    assert known.verdict == ()


def test_identifiability_survives_json():
    without_derivatives = judged(np.full((9, 3), np.nan))[0]
    assert without_derivatives.directions == ()
    for known in (judged(regressors())[0], without_derivatives):
        assert from_plain(Known, json.loads(json.dumps(to_plain(known), allow_nan=False))) == known
