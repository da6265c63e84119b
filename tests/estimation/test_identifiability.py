"""Ranks, null vectors and best sums against closed forms, dense linear algebra and numbers measured elsewhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import listed, measured, percent
from seatrial.estimation.diagnostics.combinations import Combination, Unknown, known_combinations, null_combinations
from seatrial.estimation.diagnostics.identifiability import (
    Group,
    Identifiability,
    identifiability_of_design,
    identifiability_of_fit,
    identify,
)
from seatrial.estimation.posterior.information import expand_likelihood, is_noise, likelihood_information
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.posterior import Parameter
from seatrial.estimation.priors import LogUniform, Normal, Uniform
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.messages.identifiability import (
    identifiability_cautions,
    invisible_change,
    precision,
    what_separates,
)
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle
from studies.remus100.fisher import fisher_information
from tests.cases import DEDUCTION, MASS, TRUTH, U0, paper_model
from tests.estimation_cases import SIGMA, golden_posterior, make_trial, naive_doublets, posterior

KEY = jax.random.key(0)
AT = {"u": U0}
WIDE = [Parameter(name, CoefficientName.parse(name).unit, name, Normal(x, 1e3 * abs(x))) for name, x in TRUTH.items()]


def golden_design(rpm=200, period=10, n=6000):
    control = 2 * np.pi * naive_doublets(np.arange(n) * 0.01, rpm, period)[:, None]
    return identifiability_of_design(WIDE, paper_model(), control, 0.01, [U0], {"u": SIGMA}, AT)


def test_golden_design():
    """200 rpm, 10 s: X_u to 8.4 %, X_uabsu to 2.3 %, correlation -.93, the slope of the drag to 1.2 %."""
    found = golden_design()
    assert found.relative_sd[:2] == pytest.approx([0.084, 0.023], abs=5e-4)
    assert found.correlation[0, 1] == pytest.approx(-0.93, abs=0.006)
    (group,) = found.groups
    assert group.names == ("X_u", "X_uabsu")
    sums = {item.text: item for item in group.known}
    slope = sums["X_u + 2 u0 X_uabsu"]
    assert slope.relative_sd == pytest.approx(0.012, abs=6e-4)
    assert slope.value == pytest.approx(TRUTH["X_u"] + 2 * U0 * TRUTH["X_uabsu"])
    assert (slope.unit, slope.meaning) == ("kg/s", "the slope of the drag at u0 = 1.542 m/s")
    drag = sums["X_u + u0 X_uabsu"]
    assert drag.value == pytest.approx(TRUTH["X_u"] + U0 * TRUTH["X_uabsu"])
    assert drag.relative_sd < slope.relative_sd
    text = "\n".join(identifiability_cautions(found))
    assert "X_u + 2 u0 X_uabsu (the slope of the drag at u0 = 1.542 m/s) to 1.1 % (-10.25 +- 0.12 kg/s)" in text
    assert "separately X_u to 8.4 % and X_uabsu to 2.3 %, correlation -0.925" in text
    assert "wider range of speeds" in text


@pytest.mark.parametrize(("rpm", "sd", "accuracy"), [(5, 4.2, 0.05), (100, 0.21, 0.005), (700, 0.031, 5e-4)])
def test_golden_amplitudes(rpm, sd, accuracy):
    assert golden_design(rpm).sd[0] == pytest.approx(sd, abs=accuracy)


def test_longer_periods_separate():
    assert golden_design(period=20).correlation[0, 1] == pytest.approx(-0.80, abs=0.01)
    assert golden_design(period=20).groups == ()


def test_trim_only():
    """At rest about trim only the balance of forces is seen: rank one, so two combinations are invisible."""
    found = golden_design(rpm=0, n=300)
    assert len(found.invisible) == 2
    drag = np.array([TRUTH["X_u"] * U0, TRUTH["X_uabsu"] * U0**2])
    drag = np.append(drag, -drag.sum())
    for item in found.invisible:
        changes = np.array([dict(zip(item.names, item.steps, strict=True)).get(name, 0.0) for name in TRUTH])
        assert abs(changes @ drag) < 1e-5 * np.abs(changes * drag).max()
    assert sum("structural" in line for line in identifiability_cautions(found)) == 2


@pytest.mark.proof
def test_golden_fit():
    target = golden_posterior("M-1")
    mode = find_mode(target, key=KEY)
    found = identifiability_of_fit(target, mode, at=AT)
    assert found.sd == pytest.approx(mode.sd, rel=1e-9)
    assert found.contraction == pytest.approx(mode.sd / [p.prior.sd for p in target.parameters], rel=1e-9)
    assert (found.untouched, found.invisible) == ((), ())
    (caution,) = identifiability_cautions(found)
    assert "X_u + 2 u0 X_uabsu" in caution
    assert found.groups[0].known[1].relative_sd == pytest.approx(0.012, abs=6e-4)
    control = 2 * np.pi * naive_doublets(np.arange(6000) * 0.01, 200, 10)
    information = likelihood_information(target, mode.values)
    named = dict(zip(TRUTH, mode.values[:3], strict=True))
    by_design = fisher_information(paper_model(), named, control[None, :, None], 0.01, [U0], {"u": mode.values[3]})[0]
    assert np.allclose(information[:3, :3], by_design, rtol=1e-8)
    assert np.abs(information[3, :3]).max() == pytest.approx(0, abs=1e-3)
    assert information[3, 3] == pytest.approx(2 * 6000 / mode.values[3] ** 2, rel=1e-3)


def test_coloured_information_is_that_of_the_dense_covariance():
    """S^T C^-1 S with C the covariance of an Ornstein-Uhlenbeck process at the times measured, gaps included."""
    time = np.arange(120) * 0.1
    rev_per_s = naive_doublets(time, 300, 4, active=8)
    u = np.random.default_rng(0).normal(U0, 0.1, 120)
    u[20:35] = np.nan
    likelihood, data = output_error(
        paper_model(), [make_trial(time, rev_per_s, u=u)], [Sensor("u", "coloured")], [[U0]]
    )
    names = {
        **{name: Normal(x, 1.0) for name, x in TRUTH.items()},
        "sigma_u": Normal(0.1, 1.0),
        "tau_u": Normal(0.5, 1),
    }
    target = posterior(names, likelihood, data)
    values = np.array([*TRUTH.values(), 0.1, 0.5])

    def outputs(coefficients):
        named = dict(zip(TRUTH, coefficients, strict=True))
        trial = jax.tree.map(lambda x: x[0], data)
        return likelihood.simulator.outputs(named, jnp.array([U0]), trial.control, trial.step)[:, 0]

    seen = np.isfinite(u)
    slopes = np.asarray(jax.jacfwd(outputs)(jnp.array(values[:3])))[seen]
    cov = 0.1**2 * np.exp(-np.abs(time[seen][:, None] - time[seen]) / 0.5)
    expected = slopes.T @ np.linalg.solve(cov, slopes)
    np.testing.assert_allclose(likelihood_information(target, values)[:3, :3], expected, rtol=1e-8)


def free_inertia(values, data):
    """Noise-free speed of the paper's vehicle whose mass and thrust deduction are parameters too, against itself."""
    n, measured = data
    drag, thrust = (values["X_u"], values["X_uabsu"]), (1 - values.get("t_d", DEDUCTION)) * values["T_nabsn"]

    def advance(state, n):
        rate = lambda x: ((drag[0] * x[0] + drag[1] * x[0] * abs(x[0]) + thrust * n * n) / values.get("m", MASS),)  # noqa: E731
        return rk4_step(rate, state, 0.1), state[0]

    _, speed = jax.lax.scan(advance, (jnp.asarray(U0),), n)
    return -0.5 * jnp.sum((speed - measured) ** 2) / 0.01**2, speed


def inertia_posterior(**more):
    n = jnp.asarray(2 * np.pi * naive_doublets(np.arange(300) * 0.1, 200, 10, active=20))
    truth = {**TRUTH, **more}
    measured = free_inertia(truth, (n, 0.0))[1]
    priors = {name: Normal(x, abs(x)) for name, x in truth.items()}
    return posterior(priors, lambda values, data: free_inertia(values, data)[0], (n, measured)), np.array(
        [*truth.values()]
    )


def test_free_mass_is_a_scale():
    """{X_u, X_uabsu, T, m} with the mass free: null vector (1, 1, 1, 1) in relative changes."""
    target, truth = inertia_posterior(m=MASS)
    found = identify(target.parameters, truth, likelihood_information(target, truth))
    (null,) = found.invisible
    assert null.names == target.names
    assert null.steps == pytest.approx((1, 1, 1, 1), abs=1e-5)
    assert found.eigenvalues[0] == pytest.approx(0, abs=1e-10 * found.eigenvalues[-1])
    assert found.eigenvalues[1] > 1e-6 * found.eigenvalues[-1]
    said = identifiability_cautions(found)[0]
    assert "X_u, X_uabsu, T_nabsn and m scale together: only their ratios are known" in said
    assert "fix the mass" in said


def test_only_the_product_of_thrust_and_deduction():
    """(1 - t_d) T stays when T grows by 1 % and t_d by (1 - t_d) / t_d = 9 %."""
    target, truth = inertia_posterior(t_d=DEDUCTION)
    (null,) = identify(target.parameters, truth, likelihood_information(target, truth)).invisible
    assert null.names == ("T_nabsn", "t_d")
    assert null.steps == pytest.approx((1, 9), rel=1e-5)
    assert (
        "only the product (1 - t_d) T"
        in identifiability_cautions(identify(target.parameters, truth, likelihood_information(target, truth)))[0]
    )


def test_free_added_mass():
    """With added mass unknown beside X_u, X_uabsu and T, m - X_udot scales: X_udot by (m - X_udot) / -X_udot."""
    model = whole_vehicle(Hull("free", mass=30.47, thrust_deduction=DEDUCTION), [*TRUTH, "X_udot"], moves=("u",))
    parameters = [*WIDE, Parameter("X_udot", "kg", "X_udot", Normal(-0.93, 1.0))]
    control = 2 * np.pi * naive_doublets(np.arange(300) * 0.1, 200, 10, active=20)[:, None]
    found = identifiability_of_design(parameters, model, control, 0.1, [U0], {"u": SIGMA, "udot": 0.1})
    (null,) = found.invisible
    assert null.steps == pytest.approx((1, 1, 1, 31.4 / 0.93), rel=1e-4)
    assert "X_udot by +33.8 %" in identifiability_cautions(found)[0]


def test_unknown_bias_and_start_destroy_the_drag():
    """Speed bias and u(0) free: sd(X_u) from .10 to 11.1, sd of the bias 1.5."""
    time = np.arange(6000) * 0.01
    record = make_trial(time, naive_doublets(time, 200, 10), u=U0 + np.sin(time))
    likelihood, data = output_error(paper_model(), [record], [Sensor("u", bias=True)], [[U0]], free_initial=True)
    priors = {name: Normal(x, 1e4 * abs(x)) for name, x in TRUTH.items()}
    nuisances = {"sigma_u": Normal(SIGMA, 0.01), "bias_u": Normal(0.0, 1e4), "u_0[trial]": Normal(U0, 1e4)}
    target = posterior({**priors, **nuisances}, likelihood, data)
    motion, point = np.flatnonzero(~is_noise(target)), np.array([one.prior.mean for one in target.parameters])
    information = likelihood_information(target, point)[np.ix_(motion, motion)]
    found = identify([target.parameters[i] for i in motion], point[motion], information, at=AT)
    assert found.names == (*TRUTH, "bias_u", "u_0[trial]")
    assert found.sd[0] == pytest.approx(11.1, abs=0.05)
    assert found.sd[3] == pytest.approx(1.5, abs=0.05)
    said = "\n".join(identifiability_cautions(found))
    assert "X_u would be" in said
    assert "not even its sign" in said
    assert "measure the current, run both ways" in said


def unseen_case(*lost):
    """A trial of which the channels `lost` were never measured."""
    time = np.arange(60) * 0.1
    wave = 0.1 * np.sin(time)
    trial = make_trial(time, naive_doublets(time, 300, 2, active=4), u=U0 + wave, udot=wave)
    channels = ("u", "udot")
    likelihood, data = output_error(paper_model(), [trial], channels, [[U0]])
    blank = tuple(
        channel._replace(present=0 * channel.present, counts=0 * channel.counts) if name in lost else channel
        for name, channel in zip(channels, data.channels, strict=True)
    )

    priors = {name: Uniform(*sorted((0.2 * x, 2.5 * x))) for name, x in TRUTH.items()}
    noises = {f"sigma_{name}": Uniform(0.01, 1.0) for name in channels}
    return posterior({**priors, **noises}, likelihood, data._replace(channels=blank))


@pytest.mark.proof
def test_one_channel_all_missing():
    target = unseen_case("udot")
    found = identifiability_of_fit(target, find_mode(target, key=KEY), at=AT)
    assert found.untouched == ("sigma_udot",)
    assert any(text.startswith("no measurement of udot is left") for text in identifiability_cautions(found))


def test_every_channel_missing():
    target = unseen_case("u", "udot")
    found = identifiability_of_fit(target, find_mode(target, key=KEY), at=AT)
    assert found.untouched == target.names
    assert identifiability_cautions(found)[0].startswith("the data contain no information on any parameter")


def test_model_that_diverges():
    """Nothing is invented where the likelihood has no derivatives."""
    found = identify(WIDE, np.ones(3), np.full((3, 3), np.nan))
    assert identifiability_cautions(found)[0].startswith("identifiability is not judged")


def unknown(values):
    values = np.asarray(values, float)
    return Unknown(tuple("abcdef"[: values.size]), ("m/s",) * values.size, values, np.abs(values), values != 0)


def test_best_sum_beats_every_other():
    """No random sum has a smaller relative standard deviation, but for the 5 % that leaving parameters out may cost."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(4, 4))
    cov, values = root @ root.T, np.array([3.0, -2.0, 5.0, 1.0])
    best = known_combinations(unknown(values), 0.01 * cov, {})[-1]
    sums = rng.normal(size=(200_000, 4))
    others = np.sqrt(np.einsum("ni,ij,nj->n", sums, 0.01 * cov, sums)) / np.abs(sums @ values)
    optimum = 1 / np.sqrt(values @ np.linalg.solve(0.01 * cov, values))
    assert optimum * (1 - 1e-9) <= best.relative_sd <= 1.1 * optimum
    assert optimum * (1 - 1e-9) <= others.min()


def test_difference_that_is_known_and_small():
    """Correlation +.99 of equal values: their difference is known, though not to a share of itself."""
    cov = 0.01 * np.array([[1, 0.99], [0.99, 1]])
    (best,) = known_combinations(unknown([0.2, 0.2]), cov, {})
    assert best.text == "a - b"
    assert best.sd == pytest.approx(np.sqrt(0.0002))
    assert precision(best) == "as 0.000 +- 0.014 m/s"


def test_cubic_term_of_a_change_has_no_slope_at_trim():
    names = ("X_u", "X_uabsu", "X_du3")
    units = tuple(CoefficientName.parse(name).unit for name in names)
    values, sd = np.array([-1.0, -3.0, -8.0]), np.array([0.6, 0.3, 2.0])
    cov = np.array([[1, -0.99, 0.9], [-0.99, 1, -0.9], [0.9, -0.9, 1]]) * np.outer(sd, sd)
    *meant, _ = known_combinations(Unknown(names, units, values, values, values < 0), cov, {"u": 2.0})
    by_text = {item.text: item.sd for item in meant}
    assert by_text == {
        "X_u + u0 X_uabsu": pytest.approx(np.sqrt(0.36 + 0.36 - 2 * 0.99 * 0.36)),
        "X_u + 2 u0 X_uabsu": pytest.approx(np.sqrt(0.36 + 1.44 - 2 * 0.99 * 0.72)),
    }


def test_drag_and_thrust_give_their_ratio():
    """Known to 3.4 % each with correlation -.992, drag and thrust give a ratio to 3.4 % sqrt(2 (1 - .992))."""
    names = ("X_uabsu", "T_nabsn")
    values = np.array([-2.93, 6.28e-4])
    cov = 0.034**2 * np.array([[1, -0.992], [-0.992, 1]]) * np.outer(np.abs(values), np.abs(values))
    ratio, _ = known_combinations(Unknown(names, ("kg/m", "kg m/rad^2"), values, values, values != 0), cov, {})
    assert ratio.text == "the ratio X_uabsu / T_nabsn"
    assert ratio.meaning == "which sets the steady speed"
    assert ratio.unit == "rad^2/m^2"
    assert ratio.relative_sd == pytest.approx(0.034 * np.sqrt(2 * 0.008))
    draws = np.random.default_rng(1).multivariate_normal(values, cov, 100_000)
    assert (draws[:, 0] / draws[:, 1]).std() == pytest.approx(ratio.sd, rel=0.01)


def test_expected_covariance_is_that_of_both_informations():
    """What a normal prior and the data know together: the inverse of the sum of both."""
    information, prior_sd = np.array([[40.0, -6.0], [-6.0, 2.0]]), np.array([0.5, 3.0])
    expected = np.linalg.inv(information + np.diag(prior_sd**-2.0))
    parameters = [Parameter(name, "1", name, Normal(0.0, sd)) for name, sd in zip("ab", prior_sd, strict=True)]
    found = identify(parameters, np.ones(2), information)
    assert found.correlation * np.outer(found.sd, found.sd) == pytest.approx(expected, rel=1e-12)


def test_covariance_of_a_fit_has_the_signs_of_the_information():
    """Drag is negative, thrust positive, priors wide: correlations are those of the information, and draws have their own."""
    target = golden_posterior("M-1")
    mode = find_mode(target, key=KEY)
    inverse = np.linalg.inv(likelihood_information(target, mode.values)[:3, :3])
    sd = np.sqrt(np.diag(inverse))
    fit = identifiability_of_fit(target, mode)
    assert fit.correlation[:3, :3] == pytest.approx(inverse / np.outer(sd, sd), abs=0.02)
    cov = fit.correlation * np.outer(mode.sd, mode.sd)
    draws = np.random.default_rng(0).multivariate_normal(mode.values, 4 * cov, 20_000)
    assert identifiability_of_fit(target, mode, draws).sd == pytest.approx(2 * mode.sd, rel=0.03)


def test_a_fit_knows_no_less_than_its_prior():
    """Where a hardly informed coefficient of three decades lies near its upper end, the slope of its logarithm promises five times more."""
    target = posterior({"a": LogUniform(1.0, 1e3)}, lambda v, data: -0.5 * ((v["a"] - 900.0) / 3e3) ** 2)
    mode = find_mode(target, key=KEY)
    assert mode.sd > 2 * target.parameters[0].prior.sd
    assert identifiability_of_fit(target, mode).contraction == pytest.approx([1.0])


def test_expansion_of_a_density_of_ones_own_is_exact():
    target = posterior(
        {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, lambda v, data: v["a"] ** 3 * v["b"] + jnp.sin(v["b"])
    )
    a, b = point = np.random.default_rng(1).normal(size=2)
    value, gradient, hessian = expand_likelihood(target, point)
    assert value == pytest.approx(a**3 * b + np.sin(b))
    np.testing.assert_allclose(gradient, [3 * a**2 * b, a**3 + np.cos(b)], rtol=1e-12)
    np.testing.assert_allclose(hessian, [[6 * a * b, 3 * a**2], [3 * a**2, -np.sin(b)]], rtol=1e-12)


def test_sums_are_named_that_are_known_far_better_than_each_alone():
    """X_u and X_uabsu at 1 m/s, -1 each with deviations 0.1 and 0.14: 0.7 times the better one is 7 %, which their sum has at one rho."""
    values, sd = np.array([-1.0, -1.0]), np.array([0.1, 0.14])
    unknown = Unknown(("X_u", "X_uabsu"), ("kg/s", "kg/m"), values, np.abs(values), np.ones(2, bool))
    limit = ((0.07 * 2) ** 2 - (sd**2).sum()) / (2 * sd.prod())
    for rho, there in ((limit - 0.01, 1), (limit + 0.01, 0)):
        cov = np.outer(sd, sd) * [[1.0, rho], [rho, 1.0]]
        found = [item for item in known_combinations(unknown, cov, {"u": 1.0}) if item.meaning.startswith("the drag")]
        assert len(found) == there
        assert all(item.sd == pytest.approx(np.sqrt(cov.sum())) for item in found)


def judged(**numbers):
    """A report on two coefficients and a noise, all well known unless told otherwise."""
    whole = {
        "stage": "after",
        "names": ("X_u", "X_uabsu", "sigma_u"),
        "units": ("kg/s", "kg/m", "m/s"),
        "values": np.array([-2.0, -5.0, 0.1]),
        "sd": np.array([0.2, 0.1, 0.01]),
        "prior_sd": np.array([2.0, 5.0, 0.1]),
        "correlation": np.eye(3),
        "eigenvalues": np.array([2.0, 10.0, 50.0]),
        "untouched": (),
        "invisible": (),
    }
    return Identifiability(**{**whole, **numbers})


@pytest.mark.parametrize(
    ("sd", "said"),
    [
        ([0.2, 0.1, 0.01], []),
        ([0.2, 4.4, 0.01], ["(practical): the data narrow the prior, but determine not even its sign"]),
        ([0.2, 4.6, 0.01], ["the data cannot determine X_uabsu: its standard deviation is 92% of the prior's"]),
        ([0.99, 0.1, 0.01], []),
        ([1.01, 0.1, 0.01], ["determine little more than its sign"]),
        ([1.03, 0.1, 0.01], ["determine not even its sign"]),
        ([0.2, 0.1, 0.089], []),
        ([0.2, 0.1, 0.091], ["the data cannot determine sigma_u"]),
    ],
)
def test_parameters_that_are_hardly_known_are_named_from_both_sides(sd, said):
    """Nine tenths of the prior's deviation say nothing; of a coefficient half of its value is vague, and 1 / 1.96 leaves its sign open."""
    found = identifiability_cautions(judged(sd=np.array(sd)))
    assert len(found) == len(said)
    assert all(words in line for words, line in zip(said, found, strict=True))


def test_what_the_data_say_nothing_about_is_named():
    assert judged().contraction == pytest.approx([0.1, 0.02, 0.1])
    assert judged().relative_sd == pytest.approx([0.1, 0.02, 0.1])
    untouched = judged(untouched=("sigma_u",))
    assert identifiability_cautions(untouched)[0].startswith("no measurement of u is left")
    said = identifiability_cautions(judged(untouched=("X_u",)))[0]
    assert said.startswith("the trial contains no information on X_u: no measurement changes with it; move u, fix it")
    (nothing,) = identifiability_cautions(judged(untouched=judged().names))
    assert nothing.startswith("the data contain no information on any parameter")
    blind = judged(eigenvalues=np.full(3, np.nan))
    assert identifiability_cautions(blind)[0].startswith("identifiability is not judged")


def known(text, relative, meaning=""):
    return Combination(text, meaning, "kg/s", (1.0,), 1.0, relative)


def test_the_best_sum_heads_a_group_only_where_it_is_twice_as_good():
    """Of sums with a meaning all are told, unless the best of all is known more than twice as well."""
    meant, other = known("slope", 0.019, "the slope"), known("drag", 0.03, "the drag")
    close, far = known("best", 0.01), known("best", 0.009)
    assert [item.text for item in Group(("a", "b"), 0.99, (meant, other, close)).headline] == ["slope", "drag"]
    assert [item.text for item in Group(("a", "b"), 0.99, (meant, other, far)).headline] == ["best"]
    assert [item.text for item in Group(("a", "b"), 0.99, (far,)).headline] == ["best"]


def test_words_of_a_group():
    group = Group(("X_u", "X_uabsu"), -0.987, (known("X_u + X_uabsu", 0.01, "the drag"),))
    (well,) = identifiability_cautions(
        judged(sd=np.array([0.06, 0.2, 0.01]), prior_sd=np.full(3, 99.0), groups=(group,))
    )[-1:]
    assert well.startswith("known much better in combination: X_u + X_uabsu (the drag) to 1 %")
    assert "separately X_u to 3 % and X_uabsu to 4 %" in well
    (line,) = identifiability_cautions(
        judged(sd=np.array([0.2, 5.5, 0.01]), prior_sd=np.full(3, 99.0), groups=(group,))
    )[-1:]
    assert line == (
        "known only in combination: X_u + X_uabsu (the drag) to 1 % (1.000 +- 0.010 kg/s); separately X_u to 10 % and X_uabsu as "
        "-5.0 +- 5.5 kg/m, correlation -0.987. To separate them: cover a wider range of speeds, by larger "
        "steps, longer periods, a reverse or a coast-down"
    )


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (-5.704, 0.04, "-5.704 +- 0.040 kg/s"),
        (123.4, 12.0, "123 +- 12 kg/s"),
        (1234.0, 120.0, "1234 +- 120 kg/s"),
        (0.123456, 0.0012, "0.1235 +- 0.0012 kg/s"),
        (1.23456e-4, 1.2e-5, "0.0001235 +- 1.2e-05 kg/s"),
        (1.23456e-3, 1.2e-4, "0.001235 +- 0.00012 kg/s"),
        (2.0, 0.0, "2.0000 +- 0.0000 kg/s"),
    ],
)
def test_values_have_two_digits_of_their_deviation(value, sd, text):
    assert measured(value, sd, "kg/s") == text
    assert measured(value, sd, "1") == text.removesuffix(" kg/s")


def test_shares_and_lists_in_words():
    assert [percent(x) for x in (0.0123, 0.099, 0.1, 0.126, 1.5)] == ["1.2 %", "9.9 %", "10 %", "13 %", "150 %"]
    assert [listed(names) for names in (["a"], ["a", "b"], ["a", "b", "c"])] == ["a", "a and b", "a, b and c"]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("X_u", "current[1]"), "measure the current, run both ways"),
        (("X_u", "bias_u"), "measure the current, run both ways"),
        (("t_d", "T_nabsn"), "fix t_d"),
        (("X_udot", "X_u"), "weigh the vehicle"),
        (("m", "X_u"), "weigh the vehicle"),
        (("T_nabsn", "X_u"), "bollard pull, or add a coast-down"),
        (
            ("T_nabsn", "T_nu"),
            "a trial with larger propeller speeds and faster surge, and one in which they change one at a time",
        ),
        (("X_u", "delay"), "sharper steps"),
        (("X_u", "lag_u"), "sharper steps"),
        (("X_u", "X_uabsu"), "cover a wider range of speeds, by larger steps"),
        (("Y_v", "Y_r"), "a trial with faster turns and faster sway, and one in which only yaw or only sway moves"),
        (("N_r", "N_rabsr"), "a trial with faster turns, and one with slower turns"),
        (("N_delta_r", "N_delta_r3"), "a trial with larger rudder angles, and one with smaller rudder angles"),
        (("T_f", "T_fabsf"), "a trial with larger commanded thrusts, and one with smaller commanded thrusts"),
        (("sigma_u", "tau_u"), "a longer record"),
        (("sigma_u", "X_u"), "fix one of them"),
        (("T_nabsn", "T_n"), "larger propeller speeds"),
        (("T_f", "dead_f", "lag_f"), "use steps from small to large thrust"),
        (("X_u", "T_nabsn"), "fix the thrust by a bollard pull, or add a coast-down with the propeller stopped"),
    ],
)
def test_what_would_tell_parameters_apart(names, words):
    assert words in what_separates(names)


def test_invisible_changes_are_the_null_space_in_few_parameters():
    """Information that sees a + b and c / d alone: two changes of two parameters each, in shares of the values."""
    values = np.array([2.0, 4.0, 5.0, 10.0])
    rows = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1 / 5.0, -1 / 10.0]])
    unknown = Unknown(("a", "b", "c", "d"), ("1",) * 4, values, values, np.ones(4, bool))
    found = {item.names: item for item in null_combinations(rows.T @ rows, unknown)}
    assert set(found) == {("a", "b"), ("c", "d")}
    assert found["a", "b"].steps == pytest.approx((2.0, -1.0))
    assert found["c", "d"].steps == pytest.approx((1.0, 1.0))
    assert found["c", "d"].is_scale
    assert invisible_change(found["c", "d"]) == "c and d scale together: only their ratios are known"
    assert invisible_change(found["a", "b"]) == "changing a by +2 % and b by -1 % leaves every measurement as it is"
    prior = unknown._replace(relative=np.array([True, False, True, True]))
    text = {item.names: invisible_change(item) for item in null_combinations(rows.T @ rows, prior)}["a", "b"]
    assert "b by -0.01 prior standard deviations" in text
    assert null_combinations(np.diag([1.0, 1e-3, 1e6, 1e-9]), unknown) == ()


@pytest.mark.parametrize(("prior_sd", "information", "untouched"), [(1e-6, 1.0, True), (1e6, 1e-4, False)])
def test_what_the_data_touch_is_told_in_prior_standard_deviations(prior_sd, information, untouched):
    """An information of 1e-12 over the prior's says nothing, one of 1e8 much, whatever the unit."""
    parameter = Parameter("X_u", "kg/s", "X_u", Normal(1.0, prior_sd))
    found = identify([parameter], np.ones(1), np.array([[information]]))
    assert bool(found.untouched) == untouched
