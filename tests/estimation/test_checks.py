import re

import jax
import numpy as np
import pytest

from seatrial.estimation.diagnostics.identifiability import identifiability_of_fit
from seatrial.estimation.diagnostics.prior_checks import _gain_beyond, prior_excluding_data, prior_findings
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.priors import LogUniform, Normal, Uniform
from seatrial.messages.identifiability import identifiability_cautions
from tests.estimation_cases import normal_about

KEY = jax.random.key(0)


def problem(priors, centre, precision):
    target = normal_about(priors, centre, precision)
    return target, find_mode(target, key=KEY)


def checked(prior, centre, sd):
    return prior_excluding_data(*problem({"a": prior}, [centre], [[sd**-2]]))


@pytest.mark.parametrize(
    ("prior", "centre", "sd"),
    [
        (Uniform(-1.0, 1.0), 0.5, 0.01),
        (Uniform(-1.0, 1.0), 0.99, 0.05),
        (Uniform(-1.0, 1.0), 3.0, 1.0),
        (Uniform(0.0, 1.0), 1e-3, 1e-3),
        (Normal(0.0, 1.0), 50.0, 0.01),
    ],
    ids=["inside", "inside by little", "outside but vague", "near zero from above", "unbounded"],
)
def test_priors_that_hold_the_data(prior, centre, sd):
    assert checked(prior, centre, sd) is None


@pytest.mark.parametrize(
    ("prior", "centre", "bound"),
    [(Uniform(-1.0, 1.0), 3.0, 1.0), (Uniform(-1.0, 1.0), -4.0, -1.0), (Uniform(-4.0, 0.0), 2.0, 0.0)],
)
def test_data_beyond_a_bound(prior, centre, bound):
    """The gain is that of a step from the bound to a tenth of the width beyond it."""
    finding = checked(prior, centre, 0.1)
    lower, upper = prior.bounds
    beyond = upper + 0.1 * (upper - lower) if centre > upper else lower - 0.1 * (upper - lower)
    edge = min(max(centre, lower), upper)
    gain = ((edge - centre) ** 2 - (beyond - centre) ** 2) / 0.02
    assert (finding.subject, finding.values["value"]) == (("a",), bound)
    assert finding.values["gain"] == pytest.approx(gain, rel=0.05)
    assert finding.remedies == ("widen-or-check-record",)
    assert checked(prior, centre, 0.01).remedies == ("check-record-first",)  # a hundred times the nats


def test_scale_against_its_bound_is_judged_by_its_logarithm():
    """0.011 is near 0.01 on the scale of decades though 0.1 % of the range away; 0.03 is not."""
    prior = LogUniform(0.01, 1.0)
    assert checked(prior, 0.03, 0.001) is None
    assert checked(prior, 0.007, 0.0005).code == "prior-excludes-data"


def complaints(centre, precision, draws, priors=None):
    target, mode = problem(priors or WIDE, centre, precision)
    known = identifiability_of_fit(target, mode, np.asarray(draws))
    return [*identifiability_cautions(known), *prior_findings(target, mode, np.asarray(draws))]


WIDE = {"a": Uniform(-5.0, 5.0), "b": Uniform(-5.0, 5.0)}
UNIFORM = np.random.default_rng(0).uniform(-5, 5, 4000)
SHARP = 0.01 * np.random.default_rng(1).normal(size=4000)


def test_both_known():
    assert complaints([1, -2], 1e4 * np.eye(2), np.column_stack([1 + SHARP, -2 + SHARP[::-1]])) == []


def test_one_unknown():
    (said,) = complaints([1, 0], np.diag([1e4, 0]), np.column_stack([1 + SHARP, UNIFORM]))
    assert said.startswith("the trial contains no information on b: no measurement changes with it; fix it")
    assert said.endswith("the stated value is the prior's")


def test_one_hardly_informed():
    """A precision of a hundredth of the prior's leaves 99.5 % of its standard deviation."""
    draws = np.column_stack([1 + SHARP, UNIFORM])
    (said,) = complaints([1, 0], np.diag([1e4, 0.12 / 100]), draws)
    assert said.startswith("the data cannot determine b: its standard deviation is 1")


@pytest.mark.parametrize(
    ("prior", "shares"),
    [(Uniform(-5.0, 5.0), r"[\d.]+ % and b by [+-]"), (Normal(0.0, 3.0), r"1(\.0\d)? % and b by -1")],
)
def test_only_the_sum_is_seen(prior, shares):
    """a + b = 1 is known, so a - b is invisible whatever the prior says: the null direction is (1, -1) / sqrt 2."""
    half = UNIFORM / 2
    draws = np.column_stack([0.5 + half + SHARP, 0.5 - half])
    said = complaints([0.5, 0.5], 1e4 * np.ones((2, 2)), draws, {"a": prior, "b": prior})
    assert len(said) == 2
    assert "structural" in said[0]
    # Along a - b a normal prior makes the two equal; a uniform one leaves open where the mode is, and so what share of each that is.
    assert re.search(r"changing a by \+" + shares, said[0])
    assert "leaves every measurement as it is" in said[0]
    assert said[1].startswith("known only in combination: a + b to ")
    assert "correlation -1.000" in said[1]


@pytest.mark.parametrize(("correlation", "said"), [(0.85, 0), (0.97, 1), (-0.97, 1)])
def test_correlated_but_known(correlation, said):
    cov = 1e-4 * np.array([[1, correlation], [correlation, 1]])
    draws = np.random.default_rng(2).multivariate_normal([0, 0], cov, 4000)
    assert len(complaints([0, 0], np.linalg.inv(cov), draws)) == said


def test_gain_beyond_a_bound_is_along_the_ridge():
    """Of a normal likelihood the others follow to their conditional means, and the gain is that of the marginal of the one moved."""
    cov = np.array([[1.0, 0.9, -0.3], [0.9, 1.0, -0.2], [-0.3, -0.2, 1.0]])
    centre = np.array([3.0, 2.0, 1.0])
    priors = {name: Uniform(-1.0, 1.0) for name in "abc"}
    target = normal_about(priors, centre, np.linalg.inv(cov))
    values = centre + cov[:, 0] * (1.0 - centre[0])
    assert _gain_beyond(target, values, 0, 1.2) == pytest.approx((2.0**2 - 1.8**2) / 2, abs=1e-9)


@pytest.mark.parametrize("ratio", [1.0, 3.0, 0.6])
def test_beyond_a_bound_nothing_follows_along_what_the_data_do_not_say(ratio):
    """Of two others only one sum is known: the gain is that of the one that moves alone, whatever rounding leaves of curvature."""
    together = np.outer([5.0, 5.0 * ratio], [5.0, 5.0 * ratio])
    precision = np.block([[np.ones((1, 1)), np.zeros((1, 2))], [np.zeros((2, 1)), together]])
    priors = {name: Uniform(-1.0, 1.0) for name in "abc"}
    target = normal_about(priors, [3.0, 0.0, 0.0], precision)
    found = _gain_beyond(target, np.array([1.0, 0.0, 0.0]), 0, 1.2)
    assert found == pytest.approx((2.0**2 - 1.8**2) / 2, abs=1e-9)
