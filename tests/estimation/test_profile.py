"""Profile likelihood against the normal equations and a brute-force nested search."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.profile import (
    CROSSING,
    DROP,
    ROOT_TOLERANCE,
    Profile,
    Slope,
    _is_done,
    _newton,
    _next_start,
    _Path,
    _Point,
    bounded_slope,
    maximise_rows,
    profile_likelihood,
)
from seatrial.estimation.priors import Normal, Uniform
from tests.estimation_cases import golden_posterior, linear_gaussian, normal_about, posterior, short_posterior

KEY = jax.random.key(0)


def profiles(target, *names):
    return profile_likelihood(target, find_mode(target, key=KEY), names or None)


@pytest.mark.parametrize("d", [1, 3])
def test_linear_model(d):
    """The profile is a parabola about least squares, whatever the prior: c_i -+ sqrt(3.84) sd_i."""
    problem = linear_gaussian(d)
    best, *_ = np.linalg.lstsq(problem.design, problem.measured, rcond=None)
    sd = problem.sd * np.sqrt(np.diag(np.linalg.inv(problem.design.T @ problem.design)))
    for i, found in enumerate(profiles(problem.posterior)):
        assert found.kind == "closed"
        assert found.best == pytest.approx(best[i], abs=1e-6)
        assert (found.lower, found.upper) == pytest.approx(
            (best[i] - 1.96 * sd[i], best[i] + 1.96 * sd[i]), abs=2e-3 * sd[i]
        )
        assert found.drop == pytest.approx(0.5 * ((found.values - best[i]) / sd[i]) ** 2, abs=1e-5)
        assert (np.diff(found.values) > 0).all()
        assert found.values + found.values[::-1] == pytest.approx(2 * best[i], abs=1e-3 * sd[i])


def test_nested_search():
    """At each point the other parameter was put where a bounded scalar search puts it."""
    target = short_posterior("X_u", "X_uabsu")
    likelihood = jax.jit(lambda a, b: target.likelihood({"X_u": a, "X_uabsu": b}, target.data))
    (low, high) = target.parameters[0].prior.bounds
    (found,) = profiles(target, "X_uabsu")
    assert repr(found).startswith("X_uabsu: 95 % interval ")
    assert found._repr_html_() == f"<pre>{found.line}</pre>"

    def profile(at):
        return -minimize_scalar(
            lambda x: -float(likelihood(x, at)), bounds=(low, high), method="bounded", options={"xatol": 1e-7}
        ).fun

    heights = np.array([profile(at) for at in found.values])
    peak = -minimize_scalar(
        lambda at: -profile(at), bounds=(found.values[0], found.values[-1]), method="bounded", options={"xatol": 1e-6}
    ).fun
    assert found.drop == pytest.approx(peak - heights, rel=1e-4, abs=1e-3)
    for end in (found.lower, found.upper):
        assert peak - profile(end) == pytest.approx(DROP, abs=0.02)


def test_golden_intervals_are_nearly_normal():
    target = golden_posterior("M-1")
    mode = find_mode(target, key=KEY)
    for i, found in enumerate(profile_likelihood(target, mode)):
        half = 0.5 * (found.upper - found.lower)
        assert half == pytest.approx(1.96 * mode.sd[i], rel=0.02)
        assert found.others.shape == (found.values.size, 4)


def test_untouched_parameter_is_flat():
    priors = {"a": Uniform(-1.0, 1.0), "b": Uniform(-2.0, 3.0)}
    (known, unknown) = profiles(normal_about(priors, [0.0, 0.0], np.diag([1e4, 0.0])))
    assert known.kind == "closed"
    assert unknown.kind == "flat"
    assert unknown.values[[0, -1]] == pytest.approx([-2, 3], abs=1e-4)
    assert unknown.drop == pytest.approx(0, abs=1e-9)
    assert "excludes no value from -2 to 3" in unknown.line


def saturating(values, sign):
    return -0.5 * (jnp.exp(-sign * values["a"]) / 0.05) ** 2


@pytest.mark.parametrize(("sign", "kind"), [(1, "open above"), (-1, "open below")])
def test_saturating_effect_is_known_on_one_side(sign, kind):
    """The data show exp(-a) = 0 +- 0.05: a is at least -log(1.96 * 0.05), and may be anything above."""
    prior = Uniform(*sorted((0.1 * sign, 9.0 * sign)))
    (found,) = profiles(posterior({"a": prior}, saturating, jnp.asarray(float(sign))))
    assert found.kind == kind
    end = found.lower if sign > 0 else found.upper
    assert end == pytest.approx(-sign * np.log(1.96 * 0.05), abs=2e-3)
    assert "known on one side only" in found.line


def test_only_the_sum_is_seen():
    """a + b is known and both lie in boxes: each is open on both sides of a likelihood ridge."""
    prior = Uniform(-1.0, 1.0)
    target = normal_about({"a": prior, "b": prior}, [0.0, 0.0], np.full((2, 2), 1e4))
    assert [found.kind for found in profiles(target)] == ["flat", "flat"]


def test_profile_ends_where_the_other_parameter_meets_its_bound():
    """a + b = 0 +- 0.01 with |b| < 0.5: beyond |a| = 0.5 the fit falls within 0.0196."""
    priors = {"a": Uniform(-1.0, 1.0), "b": Uniform(-0.5, 0.5)}
    (found,) = profiles(normal_about(priors, [0.0, 0.0], np.full((2, 2), 1e4)), "a")
    assert (found.lower, found.upper) == pytest.approx((-0.5196, 0.5196), abs=1e-4)


def test_beside_a_region_of_zero_likelihood():
    def cut(v, data):
        return jnp.where(v["a"] < 0.6, -0.5 * ((v["a"] - 0.5) / 0.1) ** 2, -jnp.inf)

    (found,) = profiles(posterior({"a": Uniform(-5.0, 5.0)}, cut))
    assert found.lower == pytest.approx(0.304, abs=1e-3)
    assert found.upper == pytest.approx(0.6, abs=1e-3)


def test_a_better_fit_beyond_the_posterior_mode():
    """The prior prefers the broad peak at 0, the likelihood the higher one at 1.5: the profile is about the latter."""

    def two_peaks(v, data):
        return jnp.logaddexp(-0.5 * (v["a"] / 0.4) ** 2, 1.0 - 0.5 * ((v["a"] - 1.5) / 0.3) ** 2)

    (found,) = profiles(posterior({"a": Normal(0.0, 0.5)}, two_peaks))
    assert found.best == pytest.approx(1.5, abs=0.01)
    assert found.drop.min() == 0


def test_climbs_stay_a_hair_inside_the_prior():
    """Bounds are a millionth of their distance inside a prior's, and six deviations from the mean where it has none."""
    target = posterior(
        {"a": Uniform(-1.0, 3.0), "b": Normal(5.0, 0.5), "c": Uniform(-2.0, 2.0)}, lambda v, data: -0.5 * v["a"] ** 2
    )
    mode = find_mode(target, key=KEY)._replace(sd=np.array([0.1, 100.0, 0.0]))
    found = bounded_slope(target, mode)
    assert found.lower == pytest.approx([-1 + 4e-6, 2 + 6e-6, -2 + 4e-6], abs=1e-12)
    assert found.upper == pytest.approx([3 - 4e-6, 8 - 6e-6, 2 - 4e-6], abs=1e-12)
    width = found.upper - found.lower
    assert found.scale == pytest.approx([0.1, width[1] / 4, 1e-9 * width[2]])


def test_climb_holds_what_is_held_and_goes_no_further_than_the_bounds():
    """-(a - 2 b)^2 - (b - 3)^2 in |a| < 4, |b| < 2: b is pushed to 2 and a follows to 4, or to twice the b that is held."""
    priors = {"a": Uniform(-4.1, 4.1), "b": Uniform(-2.0, 2.0)}
    target = normal_about(priors, [6.0, 3.0], [[2.0, -4.0], [-4.0, 10.0]])
    slope = bounded_slope(target, find_mode(target, key=KEY))
    starts = np.array([[0.0, 0.0], [9.0, 1.0], [1.0, -9.0]])
    found = maximise_rows(slope, starts, [None, 1, 0])
    assert found.values == pytest.approx(np.array([[4.0, 2.0], [2.0, 1.0], [1.0, 1.0]]), abs=1e-3)
    assert found.height == pytest.approx([-1.0, -4.0, -5.0], abs=1e-3)


def test_words_and_units_of_an_interval():
    """Names the ends that are known, with their unit, and where the prior ends on a side that is open."""
    numbers = (np.zeros(1), np.zeros(1), np.zeros((1, 1)))

    def line(lower, upper, unit="kg"):
        return Profile("X_u", unit, "X_{u}", 1.0, *numbers, lower, upper, (-5.0, 7.0)).line

    assert line(0.5, 2.5) == "X_u: 95 % interval 0.5 to 2.5 kg by profile likelihood"
    assert line(0.5, 2.5, "1") == "X_u: 95 % interval 0.5 to 2.5 by profile likelihood"
    assert "only, below 2.5 kg:" in line(-np.inf, 2.5)
    assert "as far as -5, the end" in line(-np.inf, 2.5)
    assert "only, above 0.5 kg:" in line(0.5, np.inf)
    assert "as far as 7, the end" in line(0.5, np.inf)
    assert "excludes no value from -5 to 7 kg" in line(-np.inf, np.inf)


@pytest.mark.parametrize(
    ("point", "held", "step", "gain"),
    [
        ([0.0, 0.0], None, [0.4, 4.0], 3.4),
        ([0.0, 0.0], 1, [0.4, 0.0], 0.4),
        ([1.0, 0.0], None, [0.0, 8.0], 6.0),
        ([1.0, 0.0], 1, [0.0, 0.0], 0.0),
    ],
)
def test_damped_step_by_hand(point, held, step, gain):
    """Slopes 2 and 3 over bends 4 and 0.5 with a quarter of the largest bend, or of 1, added; the second in units of 2."""
    slope = Slope(None, np.array([1.0, 2.0]), np.array([-1.0, -9.0]), np.array([1.0, 9.0]))
    found = _newton(slope, np.array(point), np.array([2.0, 1.5]), np.diag([-4.0, -0.125]), held, 0.25)
    assert found[0] == pytest.approx(step)
    assert found[1] == pytest.approx(gain)


def path_of(points, sign=1.0):
    """A path of the second parameter through such values of it and roots r; the first is half the second."""
    return _Path(1, sign, [_Point(np.array([0.5 * x, x]), -0.5 * r**2, r) for x, r in points])


UNIT = Slope(None, np.array([1.0, 3.0]), np.array([-50.0, -9.0]), np.array([50.0, 9.0]))


@pytest.mark.parametrize(
    ("points", "sign", "expected"),
    [
        ([(0.0, 0.0)], 1.0, [0.0, 1.5]),
        ([(0.0, 0.0)], -1.0, [0.0, -1.5]),
        ([(0.0, 0.0), (2.0, 0.5)], 1.0, [2.02, 4.04]),
        ([(0.0, 0.0), (-2.0, 0.1)], -1.0, [-3.0, -6.0]),
        ([(0.0, 1.4), (2.0, 1.9)], 1.0, [1.22, 2.44]),
        ([(0.0, 0.0), (6.0, 0.5)], 1.0, [6.06, 9.0]),
        ([(0.0, 1.0), (2.0, 3.0)], 1.0, [0.5 * (CROSSING - 1), CROSSING - 1]),
        ([(0.0, 1.0), (2.0, 3.0), (4.0, 9.0)], 1.0, [0.5, 1.0]),
        ([(0.0, CROSSING - 1e-2), (2.0, 9.0)], 1.0, [0.02, 0.04]),
        ([(0.0, 0.0), (2.0, CROSSING + 1e-3)], 1.0, [0.98, 1.96]),
        ([(0.0, 1.0), (2.0, np.inf)], 1.0, [0.0, 1.0]),
    ],
    ids=[
        "first step up",
        "first step down",
        "half a unit of r and a little",
        "no more than twice as far",
        "just beyond the crossing",
        "no further than the bound",
        "on a line to the crossing",
        "halved now and then",
        "away from the inner point",
        "away from the outer point",
        "halved alone where nothing is likely",
    ],
)
def test_where_a_path_goes_next_by_hand(points, sign, expected):
    """The first step is half a scale; then so far that r grows by 0.5, the other parameter on the line through the last two points."""
    assert _next_start(UNIT, path_of(points, sign)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("points", "sign", "done"),
    [
        ([(0.0, 0.0), (8.9, 1.0)], 1.0, False),
        ([(0.0, 0.0), (9.0, 1.0)], 1.0, True),
        ([(0.0, 0.0), (9.0, 1.0)], -1.0, False),
        ([(0.0, 0.0), (-9.0, 1.0)], -1.0, True),
        ([(0.0, CROSSING - 0.9 * ROOT_TOLERANCE), (2.0, 3.0)], 1.0, True),
        ([(0.0, CROSSING - 1.1 * ROOT_TOLERANCE), (2.0, 3.0)], 1.0, False),
        ([(0.0, 1.0), (2.0, CROSSING + 0.9 * ROOT_TOLERANCE)], 1.0, True),
        ([(0.0, 1.0), (2.0, CROSSING + 1.1 * ROOT_TOLERANCE)], 1.0, False),
        ([(0.0, 1.0), (2.9e-6, np.inf)], 1.0, True),
        ([(0.0, 1.0), (3.1e-6, np.inf)], 1.0, False),
    ],
)
def test_a_path_ends_at_its_bound_or_a_thousandth_of_r_or_a_millionth_of_its_scale_from_the_crossing(
    points, sign, done
):
    assert _is_done(UNIT, path_of(points, sign)) == done
