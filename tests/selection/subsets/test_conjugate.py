import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.selection.subsets.conjugate import GPrior, IndependentPrior, evidence_of, physical_prior, unit_information
from seatrial.selection.subsets.gram import MOST_ALIKE, check_gram, gram
from tests.selection.subsets.naive import naive_fit, naive_log_evidence, problem, some_prior

GOLDEN = {
    (0, 1, 2): 9.66532925,
    (0, 1, 2, 3): 8.53397527,
    (1, 2): -42.02104446,
    (0, 2): -256.02723612,
    (): -584.78407055,
}


@pytest.fixture(scope="module")
def golden():
    """The golden regression of surge damping, and its prior."""
    k = np.arange(200)
    u, n = 1.5 + 0.3 * np.sin(0.05 * k), 12.5 + 2.5 * np.sign(np.sin(0.08 * k + 0.1))
    phi = np.column_stack([u, u * np.abs(u), 0.009 * n * np.abs(n), (u - 1.5) ** 3])
    y = phi[:, :3] @ [-1.21, -2.93, 6.28] + 0.3 * np.sin(1.7 * k**2)
    return phi, y, physical_prior(2 * np.array([1.21, 2.93, 6.28, 10.0]), np.sqrt(0.1), shape=2.0)


@pytest.mark.parametrize("terms", GOLDEN)
def test_golden_evidence(golden, terms):
    phi, y, prior = golden
    assert abs(evidence_of(gram(phi, y), prior, terms).log_evidence - GOLDEN[terms]) < 1e-6


def test_physical_prior_is_the_golden_one(golden):
    prior = golden[2]
    np.testing.assert_allclose(prior.precision, 0.1 / (2 * np.array([1.21, 2.93, 6.28, 10.0])) ** 2)
    assert prior.shape == 2
    assert abs(prior.rate - 0.1) < 1e-15


@pytest.mark.parametrize("terms", [(), (1,), (3, 0), (0, 1, 2, 3)])
@pytest.mark.parametrize(
    "prior", [some_prior(4), some_prior(4, np.array([0.3, -2.0, 0.0, 0.1])), GPrior(40.0, 2.0, 0.7)], ids=str
)
def test_against_the_multivariate_t_density(prior, terms):
    phi, y, stats = problem(4)
    fit, chosen = evidence_of(stats, prior, terms), np.array(terms, int)
    assert abs(fit.log_evidence - naive_log_evidence(prior, phi, y, chosen)) < 1e-10
    mean, cov = naive_fit(prior, phi, y, chosen)
    np.testing.assert_allclose(fit.mean, mean, rtol=1e-9)
    np.testing.assert_allclose(fit.cov, cov, rtol=1e-8)


def test_units_of_a_regressor_do_not_matter():
    phi, y, stats = problem(3)
    prior, unit = some_prior(3), np.array([1e3, 1.0, 1e-4])
    other = IndependentPrior(prior.precision * unit**2, prior.shape, prior.rate)
    one, two = (evidence_of(s, p, (0, 1, 2)) for s, p in ((stats, prior), (gram(phi * unit, y), other)))
    assert abs(one.log_evidence - two.log_evidence) < 1e-9
    np.testing.assert_allclose(one.mean, two.mean * unit, rtol=1e-9)


def test_bad_physical_prior():
    with pytest.raises(InputError, match="prior sd"):
        physical_prior(np.array([1.0, 0.0]), 1.0)


def test_unit_information_is_one_measurement_and_expects_the_noise_that_is_given():
    """The mean of an inverse gamma is its rate over its shape less one."""
    prior = unit_information(gram(np.eye(4), np.ones(4)), 0.3)
    assert prior.rate / (prior.shape - 1) == pytest.approx(0.09)
    assert prior.g == 4


@pytest.mark.parametrize(("rows", "terms", "enough"), [(2, 1, False), (3, 1, True), (4, 5, False), (5, 5, True)])
def test_three_measurements_and_one_for_each_term_are_enough(rows, terms, enough):
    random = np.random.default_rng(0)
    stats, names = gram(random.normal(size=(rows, terms)), random.normal(size=rows)), [f"t{i}" for i in range(terms)]
    if enough:
        check_gram(stats, names)
    else:
        with pytest.raises(InputError, match=f"{rows} measurements for {terms} terms"):
            check_gram(stats, names)


@pytest.mark.parametrize(("apart", "told"), [(1.1, True), (0.9, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_regressors_are_too_much_alike_from_a_cosine_on(apart, told, sign):
    """Two orthogonal directions mixed to a cosine just beyond, or short of, the one from which on they count as proportional."""
    basis = np.linalg.qr(np.random.default_rng(1).normal(size=(20, 3)))[0]
    cosine = 1 - (1 - MOST_ALIKE) / apart
    phi = np.column_stack(
        [3 * basis[:, 0], basis[:, 2], sign * (cosine * basis[:, 0] + np.sqrt(1 - cosine**2) * basis[:, 1])]
    )
    if told:
        with pytest.raises(InputError, match="of a and c are proportional"):
            check_gram(gram(phi, basis[:, 0]), "abc")
    else:
        check_gram(gram(phi, basis[:, 0]), "abc")


def test_scaled_priors_are_wider_by_the_factor():
    """Deviations times 3: precisions over 9, and nine times the g."""
    prior = some_prior(3, np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(prior.scaled(3.0).precision, prior.precision / 9)
    np.testing.assert_array_equal(prior.scaled(3.0).mean, prior.mean)
    assert GPrior(2.0, 1.5, 0.5).scaled(3.0) == GPrior(18.0, 1.5, 0.5)
