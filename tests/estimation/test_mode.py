from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

import seatrial as st
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.posterior import mode as module
from seatrial.estimation.posterior.mode import draw_about, find_mode, higher_mode, maximise
from seatrial.estimation.posterior.posterior import values_of
from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Uniform
from seatrial.estimation.simulation.trial_data import first_samples, stack_trials
from tests.estimation_cases import (
    GOLDEN_LOG_EVIDENCE,
    THRUST_UNIT,
    golden_posterior,
    linear_gaussian,
    normal_about,
    posterior,
)

KEY = jax.random.key(0)
TWO_SD = float(Uniform(-10.0, 10.0).constrain(-2.0))
"""Where two standard deviations of z below the middle lie in a uniform prior from -10 to 10."""


@pytest.mark.parametrize("d", [1, 2, 6])
def test_laplace_is_exact_for_a_linear_gaussian_model(d):
    problem = linear_gaussian(d)
    mode = find_mode(problem.posterior, key=KEY)
    mean, cov = problem.moments
    assert mode.values == pytest.approx(mean, abs=1e-7)
    assert mode.sd == pytest.approx(np.sqrt(np.diag(cov)), rel=1e-8)
    assert mode.z == pytest.approx((mean - problem.prior_mean) / problem.prior_sd, abs=1e-7)
    assert np.allclose(mode.cov, cov / problem.prior_sd**2, rtol=1e-7, atol=1e-12)
    assert np.allclose(mode.precision @ mode.cov, np.eye(d), atol=1e-9)
    assert mode.log_evidence == pytest.approx(problem.log_evidence, abs=1e-9)
    assert not mode.flat


def test_sharp_peak_in_a_wide_box():
    """Ten sigma inside the box, the evidence is the likelihood's integral over the width."""
    mode = find_mode(normal_about({"X_u": Uniform(-10.0, 10.0)}, [3.2], [[1e6]]), key=KEY)
    assert mode.values == pytest.approx([3.2], abs=1e-8)
    assert mode.sd == pytest.approx([1e-3], rel=1e-6)
    assert mode.log_evidence == pytest.approx(np.log(1e-3 * np.sqrt(2 * np.pi) / 20), abs=1e-6)


def two_peaks(values, data):
    a = values["a"]
    return jnp.logaddexp(-0.5 * ((a + 3) / 0.4) ** 2, jnp.log(3.0) - 0.5 * ((a - 4) / 0.1) ** 2)


@pytest.mark.parametrize(
    ("likelihood", "peaks", "top"),
    [(lambda v, data: -0.5 * (v["a"] / 0.1) ** 2, 1, 0.0), (two_peaks, 2, 4.0 * 2500 / 2501)],
)
def test_each_peak_is_climbed_once_and_the_highest_wins(likelihood, peaks, top, monkeypatch):
    """Of all 512 draws, only one on each side of the valley has anything to show; the prior pulls the narrow peak in by 1/2501."""
    climb, ends = module._maximise, []
    monkeypatch.setattr(module, "_maximise", lambda *start, **rest: ends.append(climb(*start, **rest)) or ends[-1])
    mode = find_mode(posterior({"a": Normal(0.0, 5.0)}, likelihood), key=KEY, tries=512)
    assert mode.values == pytest.approx([top], abs=1e-7)
    assert len(ends) == peaks
    assert np.ptp([z[0] for z, _ in ends]) == pytest.approx(1.4 * (peaks - 1), abs=0.01)


def test_mode_beside_a_region_of_zero_likelihood():
    def cut(values, data):
        return jnp.where(values["a"] < 1.0, -0.5 * ((values["a"] - 0.5) / 0.1) ** 2, -jnp.inf)

    mode = find_mode(posterior({"a": Uniform(-20.0, 20.0)}, cut), key=KEY)
    assert mode.values == pytest.approx([0.5], abs=1e-7)
    assert mode.sd == pytest.approx([0.1], rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_direction_the_data_do_not_see_keeps_the_spread_of_the_prior(seed):
    target = normal_about({"a": Uniform(0.0, 2.0), "b": Uniform(-6.0, 6.0)}, [0.9, 0.0], np.diag([1e4, 0.0]))
    mode = find_mode(target, key=jax.random.key(seed))
    assert mode.flat
    assert mode.sd == pytest.approx([0.01, 12 / np.sqrt(12)], rel=1e-3)


def test_no_finite_likelihood():
    with pytest.raises(NumericalError, match=r"none of 64 draws.*Narrow the prior"):
        find_mode(posterior({"a": Normal(0.0, 1.0)}, lambda v, data: -jnp.inf + 0 * v["a"]), key=KEY, starts=64)


def test_same_key_same_bits():
    problem = linear_gaussian(2).posterior
    assert find_mode(problem, key=KEY).z.tobytes() == find_mode(problem, key=KEY).z.tobytes()


@pytest.mark.parametrize(
    ("model", "means", "sds"),
    [
        ("M-1", [-1.133, -2.962, 6.249], [0.103, 0.068, 0.044]),
        pytest.param("M-0 wide", [-1.683, -2.590, 6.231, -8.7], [0.38, 0.256, 0.045, 5.84], marks=pytest.mark.proof),
    ],
)
def test_golden_posterior(model, means, sds):
    """The mode lies within .1 sd of the golden mean, and its curvature gives the golden sds to 3 %."""
    mode = find_mode(golden_posterior(model), key=KEY)
    unit = np.array([1.0, 1.0, THRUST_UNIT, 1.0])[: len(means)]
    assert np.abs((mode.values[: len(means)] / unit - means) / sds).max() < 0.1
    assert mode.sd[: len(means)] / unit == pytest.approx(sds, rel=0.03)
    assert mode.log_evidence == pytest.approx(GOLDEN_LOG_EVIDENCE[model], abs=0.05)


def rippled(values, data):
    """Return a density with a peak every 0.02 s along the delay; what is left of `a` given the delay is normal."""
    delay, a = values["delay"], values["a"]
    ripple = 4.0 * jnp.cos(2 * jnp.pi * (delay - 0.303) / 0.02)
    return ripple - 0.5 * ((delay - 0.3) / 0.02) ** 2 - 0.5 * ((a - 5 * delay) / 0.01) ** 2


def test_delay_is_known_as_well_as_its_profile_over_all_peaks():
    """Against quadrature: of delay over its prior, of `a` in closed form."""
    target = posterior({"delay": Uniform(0.0, 1.0), "a": Uniform(-10.0, 10.0)}, rippled)
    mode = find_mode(target, key=KEY)
    delay = np.linspace(0.0, 1.0, 200_001)
    density = np.exp(4.0 * np.cos(2 * np.pi * (delay - 0.303) / 0.02) - 0.5 * ((delay - 0.3) / 0.02) ** 2)
    area = np.trapezoid(density, delay)
    best = delay[density.argmax()]
    spread = np.sqrt(np.trapezoid(density * (delay - best) ** 2, delay) / area)
    assert mode.by_name["delay"] == pytest.approx(best, abs=1e-4)
    assert mode.sd[0] == pytest.approx(spread, rel=0.05)
    assert mode.sd[1] == pytest.approx(np.hypot(0.01, 5 * spread), rel=0.05)
    assert mode.log_evidence == pytest.approx(np.log(area * 0.01 * np.sqrt(2 * np.pi) / 20.0), abs=0.05)
    assert np.allclose(mode.precision @ mode.cov, np.eye(2), atol=1e-6)


def test_mode_without_what_is_absent_is_that_of_the_rest_alone():
    """A parameter that the data never see is standard normal in z, and the density of the others is without it."""

    def seen(values, data):
        return -0.5 * ((values["a"] - 0.9) / 0.1) ** 2

    priors = {"b": Normal(3.0, 7.0), "a": Normal(0.0, 2.0)}
    found = find_mode(posterior(priors, seen), key=KEY).only(np.array([1]))
    alone = find_mode(posterior({"a": priors["a"]}, seen), key=KEY)
    for one, other in zip(found, alone, strict=True):
        assert one == (pytest.approx(other, abs=1e-9) if isinstance(other, float | np.ndarray) else other)


@pytest.mark.proof
def test_curvature_where_the_likelihood_still_rises_is_that_of_the_density_in_z():
    """Priors hold the mode back, so that how values bend with z counts too: against second derivatives of the whole."""
    target = posterior(
        {"a": Uniform(0.0, 2.0), "b": LogNormal(1.0, 2.0)},
        lambda v, data: -0.5 * ((v["a"] - 1.9) / 0.4) ** 2 - 0.5 * ((v["a"] * v["b"] - 5.0) / 0.8) ** 2,
    )
    mode = find_mode(target, key=KEY)
    np.testing.assert_allclose(mode.precision, -jax.hessian(target.log_density)(jnp.asarray(mode.z)), rtol=1e-6)


def test_what_is_expected_of_the_others_if_some_are_known():
    """The conditional mean of a normal density, by inverting the block of what is known."""
    problem = linear_gaussian(4)
    mean, cov = problem.moments
    mode = find_mode(problem.posterior, key=KEY)
    known, rest = [1, 3], [0, 2]
    off = np.array([0.4, -0.2]) - mean[known]
    expected = mean[rest] + cov[np.ix_(rest, known)] @ np.linalg.inv(cov[np.ix_(known, known)]) @ off
    found = mode.expected(dict(zip((mode.names[i] for i in known), (0.4, -0.2), strict=True)))
    assert list(found) == [mode.names[i] for i in rest]
    assert list(found.values()) == pytest.approx(expected, abs=1e-7)


def broad_and_sharp(values, data):
    sharp = [-0.5 * ((values["a"] - at) / 1e-5) ** 2 + 20.0 for at in (7.0, TWO_SD)]
    return jax.scipy.special.logsumexp(jnp.stack([*sharp, -0.5 * values["a"] ** 2]))


@pytest.mark.parametrize(("near", "found"), [({"a": 7.0}, 7.0), ({"a": -11.0}, TWO_SD), ({}, 0.0), (None, 0.0)])
def test_a_peak_that_is_told_of(near, found):
    """No draw meets a peak a millionth as wide as its box; what lies outside the box is moved to two standard deviations of z."""
    mode = find_mode(posterior({"a": Uniform(-10.0, 10.0)}, broad_and_sharp), key=KEY, near=near)
    # Beside a bound the density of z is steeper than a peak of this width: the mode lies within a width of it.
    assert mode.values == pytest.approx([found], abs=1.1e-5 if found == TWO_SD else 1e-6)


def ridge(values, data):
    """A broad peak at the lower bound of N_rdot, and one of 20 nats more where N_rdot is 0 and N_r -2, a thousandth as wide."""
    extra, drag = values.get("N_rdot", 0.0), values["N_r"]
    sharp = 20.0 - 0.5 * (((drag + 2.0) / 1e-4) ** 2 + (extra / 1e-4) ** 2)
    return jnp.logaddexp(sharp, -0.5 * ((drag - 1.0) ** 2 + (extra + 5.0) ** 2))


def test_a_structure_is_no_lower_than_the_mode_of_one_that_it_contains():
    """With the further term at zero, it has the density of the other and the prior density of that term."""
    drag, extra = Normal(0.0, 5.0), Uniform(-5.0, 1.0)
    wide, small = (posterior({"N_r": drag, **more}, ridge) for more in ({"N_rdot": extra}, {}))
    stuck, peak = find_mode(wide, key=KEY), find_mode(small, key=KEY, near={"N_r": -2.0})
    assert stuck.log_density < peak.log_density - 10.0
    better = higher_mode(wide, stuck, [peak])
    assert better.by_name == pytest.approx({"N_r": -2.0, "N_rdot": 0.0}, abs=1e-6)
    # z of a uniform has 1 / sqrt(12) of the width as its unit.
    assert better.log_density == pytest.approx(peak.log_density - 0.5 * np.log(12.0), abs=1e-6)
    assert higher_mode(wide, better, [peak]) is None
    assert higher_mode(wide, stuck, []) is None
    # The other way round too, as of a term at zero nothing is lost.
    assert higher_mode(small, find_mode(small, key=KEY), [better]).values == pytest.approx(peak.values, abs=1e-6)
    assert higher_mode(wide, None, [peak]).z == pytest.approx(better.z, abs=1e-6)


@pytest.mark.parametrize(
    ("prior", "centre", "sd", "bound"),
    [
        (Uniform(-5.0, 1.0), -9.0, 1.0, "-5"),
        (Uniform(0.02, 0.2), 0.0205, 1e-5, "0.02"),  # beside its bound, though the posterior does not reach it
        (Uniform(-5.0, 0.0), -0.01, 1e-3, ""),  # ten standard deviations on the physical side of 0
        (Uniform(-5.0, 0.0), 0.1, 0.1, "0"),
        (Uniform(-5.0, 1.0), 0.0, 1.0, ""),
        (Normal(0.0, 1.0), 9.0, 0.1, ""),
        (LogNormal(3.0, 10.0), 3.0, 0.1, ""),
        (LogUniform(1e-5, 1.0), 1e-6, 1e-5, "1e-05"),
        (LogUniform(1e-5, 1.0), 1e-3, 1e-4, ""),
    ],
)
def test_a_parameter_at_a_bound_of_its_prior_is_named(prior, centre, sd, bound):
    mode = find_mode(normal_about({"X_u": prior}, [centre], [[sd**-2]]), key=KEY)
    bounds = [f"{one.values['value']:g}" for one in mode.at_bounds]
    assert bounds == ([bound] if bound else [])
    assert ("at-prior-bound: X_u" in repr(mode)) == bool(bound)


def test_what_is_not_told_is_taken_from_the_middle_of_the_prior():
    def peak(values, data):
        return 20.0 - 0.5 * ((values["a"] - 7.0) / 1e-5) ** 2 - 0.5 * values["b"] ** 2

    mode = find_mode(posterior({"a": Uniform(-10.0, 10.0), "b": Normal(0.0, 1.0)}, peak), key=KEY, near={"a": 7.0})
    assert mode.values == pytest.approx([7.0, 0.0], abs=1e-5)


@pytest.mark.parametrize(
    ("near", "message"),
    [({"q": 1.0}, r'near\n.*"q", which nothing uses'), ({"a": "far"}, r'near\["a"\]'), (3, "near\n.*3")],
)
def test_what_is_told_in_vain_is_refused(near, message):
    with pytest.raises(InputError, match=message):
        find_mode(posterior({"a": Uniform(-10.0, 10.0)}, lambda v, data: -(v["a"] ** 2)), key=KEY, near=near)


def test_a_step_to_where_the_density_is_zero_is_refused():
    """Newton's first step from -3 ends near 60, where nothing is finite; the maximum lies at 1."""

    def expanded(z):
        away = z[0] - 1.0
        if away > 4.0:
            return SimpleNamespace(value=-np.inf, gradient=np.full(1, np.nan), hessian=np.full((1, 1), np.nan))
        long = np.sqrt(1.0 + away**2)
        return SimpleNamespace(
            value=-5.0 * long, gradient=np.array([-5.0 * away / long]), hessian=np.array([[-5.0 / long**3]])
        )

    found, height = maximise(expanded, np.array([-3.0]), str)
    assert found == pytest.approx([1.0], abs=1e-5)
    assert height == pytest.approx(-5.0)
    with pytest.raises(NumericalError, match="no finite derivative"):
        maximise(expanded, np.array([6.0]), str)


def surge_posterior(samples=400, sigma=(1e-4, 10.0), slow=None):
    truth = {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.02}
    model = st.load_vehicle("remus100_surge").build(free=[name for name in truth if name != "sigma_u"])
    levels = np.repeat(np.random.default_rng(3).uniform(65.0, 185.0, samples // 8), 8)
    schedule = st.Schedule(np.arange(samples) * 0.1, {"n": levels})
    record = st.simulate(model, truth, schedule, ["u"], start={"u": 1.5}, key=4)
    priors = {"X_u": st.Normal(-1.2, 1.5), "X_uabsu": st.Normal(-3.0, 3.0), "T_nabsn": st.Normal(6e-4, 3e-4)}
    priors["sigma_u"] = st.LogUniform(*sigma)
    if slow is None:
        return st.make_posterior(model, record, priors), record
    record = replace(record, measurement=record.measurement + slow[:, None])
    priors |= {"drift_u": st.LogUniform(2e-5, 0.1), "drift_time_u": st.LogUniform(0.3, 40.0)}
    return st.make_posterior(model, record, priors, [st.Sensor("u", "drifting")]), record


def test_noise_begins_at_the_size_of_the_residuals():
    """White noise: the root mean square of what a simulation at the start misses, whatever the start says of it."""
    target, record = surge_posterior()
    start = np.zeros(target.dim)
    start[target.names.index("sigma_u")] = 1.2  # ten times too large, and more
    named = dict(zip(target.names, values_of(target, start), strict=True))
    simulator, data = target.likelihood.simulator, target.data
    begun = target.likelihood.starts(named, data)[0]
    shown = simulator.outputs(named, begun, jax.tree.map(lambda x: x[0], data.control), data.step[0])
    missed = np.asarray(shown)[: record.time.size, 0] - record.channel("u")
    found = values_of(target, module._with_noise(target, start))
    assert found[target.names.index("sigma_u")] == pytest.approx(np.sqrt(np.mean(missed**2)), rel=1e-6)
    kept = [name != "sigma_u" for name in target.names]
    assert np.array_equal(found[kept], values_of(target, start)[kept])


@pytest.mark.proof
@pytest.mark.parametrize("drift", [0.0, 0.05])
def test_no_start_leads_higher_with_slow_noise(drift, monkeypatch):
    """On white data and on a slow error of two and a half times the noise, from the truth and from draws of the prior."""
    rng, memory = np.random.default_rng(6), np.exp(-0.1 / 8.0)
    slow = signal.lfilter([drift * np.sqrt(1 - memory**2)], [1.0, -memory], rng.normal(size=400))
    target, _ = surge_posterior(slow=slow)
    climbs, expand = [], module._expand
    monkeypatch.setattr(module, "_expand", lambda *a, **k: climbs.append(0) or expand(*a, **k))
    found = find_mode(target, key=KEY)
    assert len(climbs) < 50
    draws = np.array(target.sample_prior(KEY, 200))
    best = draws[np.argsort(-module._heights(target, draws))[:3]]
    known = {
        "X_u": -1.21,
        "X_uabsu": -2.93,
        "T_nabsn": 6.28e-4,
        "sigma_u": 0.02,
        "drift_u": drift + 1e-3,
        "drift_time_u": 8.0,
    }
    for start in (module._inside(target, known)[0], *best):
        assert found.log_density > module.maximise_from(target, start).log_density - 1e-4


@pytest.mark.parametrize(("memory", "shortest", "longest"), [(0.5, 0.3, 1.2), (20.0, 3.0, 40.0)])
def test_the_slow_noise_of_a_start_remembers_about_as_long_as_the_error_does(memory, shortest, longest):
    keep = np.exp(-0.1 / memory)
    shocks = np.random.default_rng(6).normal(size=400)
    target, _ = surge_posterior(slow=signal.lfilter([0.05 * np.sqrt(1 - keep**2)], [1.0, -keep], shocks))
    start = module._inside(target, {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.02})[0]
    moved, _ = module._with_slow_noise(target, start)
    found = dict(zip(target.names, np.asarray(target.constrain(moved)), strict=True))
    assert shortest < found["drift_time_u"] < longest


def test_a_long_record_has_the_mode_that_a_search_of_all_of_it_finds(monkeypatch):
    target, _ = surge_posterior()
    whole = find_mode(target, key=KEY)
    monkeypatch.setattr(module, "MIN_LONG_SAMPLES", 100)
    sizes, inner = [], module._maximise
    monkeypatch.setattr(
        module,
        "_maximise",
        lambda post, *rest, **more: sizes.append(post.data.step.shape[1]) or inner(post, *rest, **more),
    )
    long = find_mode(target, key=KEY)
    assert sizes[0] == target.data.step.shape[1] // module.N_PARTS
    assert sizes[-1] == target.data.step.shape[1]
    assert (np.abs(long.values - whole.values) < 1e-6 * whole.sd).all()
    assert long.log_evidence == pytest.approx(whole.log_evidence, abs=1e-5)


def test_a_part_that_leads_nowhere_does_not_lose_the_whole(monkeypatch):
    target, _ = surge_posterior()
    whole = find_mode(target, key=KEY)
    monkeypatch.setattr(module, "MIN_LONG_SAMPLES", 100)
    length, inner = target.data.step.shape[1], module._maximise

    def climb(post, *rest, **more):
        if post.data.step.shape[1] < length:
            raise NumericalError("no derivative")
        return inner(post, *rest, **more)

    monkeypatch.setattr(module, "_maximise", climb)
    assert np.array_equal(find_mode(target, key=KEY).values, whole.values)


@pytest.mark.parametrize(("still", "expected"), [(0, True), (200, False)])
def test_a_part_in_which_the_controls_rest_says_nothing(still, expected, monkeypatch):
    target, _ = surge_posterior()
    monkeypatch.setattr(module, "MIN_LONG_SAMPLES", 100)
    n = np.array(target.data.control[0])
    n[:, :still] = n[:, :1]
    resting = replace(target, data=target.data._replace(control=(jnp.asarray(n),)))
    assert (module._first_part(resting) is not None) == expected


def test_the_first_samples_of_trials_are_those_of_shorter_records():
    """Two channels, one measured now and then, so that gaps and their counts differ."""
    time = np.arange(64) * 0.1
    rng = np.random.default_rng(2)
    columns = {"n": rng.normal(size=64), "u": np.where(np.arange(64) % 3 == 0, rng.normal(size=64), np.nan)}
    channels = (Channel("n", "rad/s", "control"), Channel("u", "m/s", "measurement"))
    model = st.load_vehicle("remus100_surge").build(free=["X_u"])

    def record(n):
        made = {name: column[:n] for name, column in columns.items()}
        return make_record(time[:n], made, channels, Provenance("made", "0" * 64), str(n))

    cut = first_samples(stack_trials([record(64)], model, ["u"], [(1.5,)]), 16)
    short = stack_trials([record(16)], model, ["u"], [(1.5,)])
    assert jax.tree.map(np.shape, cut) == jax.tree.map(np.shape, short)
    for found, expected in zip(jax.tree.leaves(cut), jax.tree.leaves(short), strict=True):
        np.testing.assert_allclose(np.asarray(found)[..., :15], np.asarray(expected)[..., :15])


def test_a_climb_far_below_a_known_top_is_given_up():
    """A ridge that rises by a nat a step towards a top a thousand below the one that is known."""
    looks = []

    def expand_at(z):
        looks.append(z)
        return SimpleNamespace(value=float(z[0]), gradient=np.ones(1), hessian=np.full((1, 1), -1e-3))

    maximise(expand_at, np.zeros(1), str, known_modes=[(np.array([50.0]), 1e6)])
    assert len(looks) <= module.PATIENCE_STEPS + 4


def test_a_curvature_that_no_equation_can_be_solved_with_ends_the_search_in_words():
    """By its eigenvalues, rounded, this one is positive, and by its factors singular; as where a density rises without bound."""
    singular = np.outer([6.0, 5.0, 6.0], [6.0, 5.0, 6.0])
    assert np.linalg.eigvalsh(singular)[0] > 0

    def expand_at(z):
        return SimpleNamespace(value=float(z[0]), gradient=np.array([1.0, 0.0, 0.0]), hessian=-singular)

    with pytest.raises(NumericalError, match="curvature is not finite near"):
        maximise(expand_at, np.zeros(3), str)


def test_draws_about_a_normal_mode_are_those_of_numpy():
    mode = find_mode(linear_gaussian(3).posterior, key=KEY)
    drawn = draw_about(linear_gaussian(3).posterior, mode, 50, np.random.default_rng(5))
    expected = np.random.default_rng(5).multivariate_normal(mode.z, mode.cov, 50, method="eigh")
    assert drawn == pytest.approx(expected, abs=1e-12)


def test_draws_of_a_size_that_is_open_from_below_do_not_leave_what_the_data_allow():
    """A half-normal of 1e-4 in the size: one value in two million is above 5e-4; the logarithm is as wide as its prior."""
    target = posterior({"s": LogUniform(1e-8, 1.0)}, lambda v, data: -0.5 * (v["s"] / 1e-4) ** 2)
    mode = find_mode(target, key=KEY)
    drawn = values_of(target, draw_about(target, mode, 1000, np.random.default_rng(1)))
    symmetric = values_of(target, np.random.default_rng(1).multivariate_normal(mode.z, mode.cov, 1000))
    assert symmetric.max() > 4e-3
    assert drawn.max() < 1e-3
    assert drawn.min() == pytest.approx(symmetric.min(), rel=0.9)
