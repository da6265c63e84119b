"""A user's own log density: what is found of it against the closed form of a normal mean and of a normal scale."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from arviz_stats import ess, rhat
from scipy import stats

import seatrial as st

Y = np.random.default_rng(3).normal(0.7, 0.5, 40)
SIGMA, WIDTH = 0.5, 2.0


def normal_mean(params):
    return jnp.sum(-0.5 * ((Y - params["mean"]) / SIGMA) ** 2 - jnp.log(SIGMA * jnp.sqrt(2 * jnp.pi)))


@pytest.fixture(scope="module")
def posterior():
    return st.posterior_of_density(normal_mean, {"mean": st.Normal(0.0, WIDTH)}, {"mean": "m/s"})


@pytest.fixture(scope="module")
def exact():
    """Posterior mean, its standard deviation, and the log evidence."""
    precision = 1 / WIDTH**2 + Y.size / SIGMA**2
    together = stats.multivariate_normal(np.zeros(Y.size), SIGMA**2 * np.eye(Y.size) + WIDTH**2)
    return Y.sum() / SIGMA**2 / precision, precision**-0.5, together.logpdf(Y)


@pytest.fixture(scope="module")
def draws(posterior):
    return st.sample(posterior, settings=st.ChainSettings(chains=8, warmup=300, draws=500), key=1)


def test_mode(posterior, exact):
    mode = st.find_mode(posterior)
    mean, sd, log_evidence = exact
    assert mode.by_name == pytest.approx({"mean": mean}, rel=1e-9)
    assert mode.log_evidence == pytest.approx(log_evidence, abs=1e-9)
    table = mode.summary()
    assert table.loc["mean", "unit"] == "m/s"
    assert table.loc["mean", "sd"] == pytest.approx(sd, rel=1e-9)


def test_draws_by_name(draws, exact):
    mean, sd, _ = exact
    assert draws["mean"].shape == (8, 500)
    assert np.array_equal(draws.array(["mean"])[:, 0].reshape(8, 500), draws["mean"])
    table = draws.summary().loc["mean"]
    assert abs(table["mean"] - mean) < 4 * table["mcse"]
    assert table["sd"] == pytest.approx(sd, rel=0.1)
    assert stats.norm(mean, sd).cdf([table["5%"], table["95%"]]) == pytest.approx([0.05, 0.95], abs=0.02)
    assert draws.findings() == []
    with pytest.raises(st.InputError, match='did you mean "mean"'):
        draws["meen"]


def test_draws_in_arviz(draws):
    """The tree has what ArviZ's own functions read, and these find what the table says."""
    tree, table = st.to_arviz(draws), draws.summary().loc["mean"]
    assert tree["posterior"]["mean"].dims == ("chain", "draw")
    assert tree["posterior"]["mean"].attrs["units"] == "m/s"
    assert np.array_equal(tree["sample_stats"]["lp"], draws.log_density)
    assert float(rhat(tree)["mean"]) == pytest.approx(table["r_hat"])
    assert float(ess(tree)["mean"]) == pytest.approx(table["ess_bulk"])


@pytest.mark.parametrize(
    ("method", "settings"), [("tempered-smc", st.SMCSettings(particles=256)), ("nested", st.NestedSettings(100, 400))]
)
@pytest.mark.proof
def test_populations_are_draws_too(posterior, exact, method, settings):
    found = st.sample(posterior, method, settings=settings, key=2)
    mean, sd, _ = exact
    assert found["mean"].mean() == pytest.approx(mean, abs=sd)
    assert found.is_population
    assert np.isnan(found.summary().loc["mean", "r_hat"])
    expected = stats.norm(0, WIDTH).logpdf(found["mean"]) + stats.norm(found["mean"][..., None], SIGMA).logpdf(Y).sum(
        -1
    )
    assert found.log_density == pytest.approx(expected + np.log(WIDTH), abs=1e-9)


@pytest.mark.proof
def test_evidence_and_comparison(exact):
    """Three methods give the closed form; of two models the odds are those of their evidences."""

    def nothing(params):
        return jnp.sum(
            -0.5 * (Y / SIGMA / params["factor"]) ** 2 - jnp.log(SIGMA * params["factor"] * jnp.sqrt(2 * jnp.pi))
        )

    one = st.posterior_of_density(
        lambda p: normal_mean(p) + 0.0 * p["factor"], {"mean": st.Normal(0.0, WIDTH), "factor": st.Uniform(0.5, 2.0)}
    )
    other = st.posterior_of_density(nothing, {"factor": st.Uniform(0.5, 4.0)})
    found = st.compare(
        {"with": one, "without": other}, settings=st.EvidenceSettings(2, st.SMCSettings(particles=256)), key=4
    )
    assert found.evidences[0].log_value == pytest.approx(exact[2], abs=0.1)
    factor = np.linspace(0.5, 4.0, 20001)
    height = stats.norm(0, SIGMA * factor[:, None]).logpdf(Y).sum(-1)
    alone = np.log(np.trapezoid(np.exp(height - height.max()), factor) / 3.5) + height.max()
    assert found.evidences[1].log_value == pytest.approx(alone, abs=0.1)
    assert found.probability[0] == pytest.approx(1 / (1 + np.exp(alone - exact[2])), abs=0.02)
    assert found.inclusion == {"mean": pytest.approx(found.probability[0])}
    assert any("the data support mean" in said for said in found.verdicts)


def test_models_of_another_prior():
    """Two of three differ from the first by one term of two, so each of them is half as probable before the data."""
    flat = {name: st.Normal(0.0, 1.0) for name in ("mean", "a", "b")}
    models = {
        "none": st.posterior_of_density(lambda p: -0.5 * p["mean"] ** 2, {"mean": flat["mean"]}),
        "a": st.posterior_of_density(lambda p: -0.5 * p["mean"] ** 2, {one: flat[one] for one in ("mean", "a")}),
        "b": st.posterior_of_density(lambda p: -0.5 * p["mean"] ** 2, {one: flat[one] for one in ("mean", "b")}),
    }
    size = st.EvidenceSettings(2, st.SMCSettings(particles=64), 1024)
    found = st.compare(models, settings=size, structure_prior="multiplicity")
    assert found.probability == pytest.approx([0.5, 0.25, 0.25], abs=0.02)
    with pytest.raises(st.InputError, match=r"structure_prior(.|\n)*use one of: equal, multiplicity"):
        st.compare(models, structure_prior="uniform")


def test_a_term_that_is_absent_from_a_posterior_is_in_question():
    whole = st.posterior_of_density(
        lambda p: normal_mean(p) + 0.0 * p["factor"], {"mean": st.Normal(0.0, WIDTH), "factor": st.Uniform(0.5, 2.0)}
    )
    without = replace(whole, present=np.array([float(name != "mean") for name in whole.names]))
    found = st.compare(
        {"with": whole, "without": without}, settings=st.EvidenceSettings(2, st.SMCSettings(particles=256))
    )
    assert found.inclusion == {"mean": pytest.approx(found.probability[0])}


def test_the_same_seed_gives_the_same_bits(posterior):
    small = st.ChainSettings(4, 100, 100)
    assert np.array_equal(*(st.sample(posterior, settings=small, key=7)["mean"] for _ in range(2)))


@pytest.mark.parametrize(
    ("log_density", "words"),
    [
        (lambda p: p["mean"] * jnp.ones(3), "a result of shape (3,)"),
        (lambda p: p["slope"], "a parameter 'slope' without a prior"),
        (lambda p: float(np.sin(p["mean"])), "use jax.numpy instead of numpy"),
        (lambda p: p["mean"] if p["mean"] > 0 else 0.0, "jnp.where instead of if"),
    ],
)
def test_a_density_that_cannot_be_used_is_refused(log_density, words):
    with pytest.raises(st.InputError) as error:
        st.posterior_of_density(log_density, {"mean": st.Normal(0.0, 1.0)})
    assert words in str(error.value)


def test_what_is_no_number_counts_as_impossible():
    posterior = st.posterior_of_density(lambda p: jnp.log(p["a"]) - 2 * p["a"], {"a": st.Normal(0.5, 1.0)})
    assert float(posterior.log_likelihood(jnp.array([-3.0]))) == -np.inf
    assert st.find_mode(posterior).by_name["a"] > 0
