"""The textbook twin of the engine: one structure after the other, by the density of the data under it."""

from itertools import product

import numpy as np
from scipy import stats

from seatrial.selection.subsets.conjugate import IndependentPrior
from seatrial.selection.subsets.gram import gram

NAMES = tuple("abcdefghijklmnopqrstuvwxy")


def regression(k, n=40, seed=0, strength=0.3):
    """Correlated regressors, and a response to the first three of them."""
    rng = np.random.default_rng(seed)
    phi = (rng.normal(size=(n, k)) + 0.5 * rng.normal(size=(n, 1))) * np.geomspace(0.1, 10, k)
    true = np.where(np.arange(k) < 3, strength, 0.0) / np.geomspace(0.1, 10, k)
    return phi, phi @ true + rng.normal(size=n)


def some_prior(k, mean=None):
    """Independent coefficients of different widths."""
    return IndependentPrior(np.geomspace(0.002, 30, k), 2.5, 1.3, mean)


def prior_of(prior, phi, chosen):
    """Prior mean and covariance over s^2 of a structure's coefficients."""
    part = phi[:, chosen]
    if isinstance(prior, IndependentPrior):
        mean = np.zeros(phi.shape[1]) if prior.mean is None else prior.mean
        return mean[chosen], np.diag(1 / prior.precision[chosen])
    return np.zeros(len(chosen)), prior.g * np.linalg.inv(part.T @ part)


def naive_log_evidence(prior, phi, y, chosen):
    """Multivariate t density of the response, its scale matrix n by n."""
    mean, cov = prior_of(prior, phi, chosen)
    scale = prior.rate / prior.shape * (np.eye(y.size) + phi[:, chosen] @ cov @ phi[:, chosen].T)
    return stats.multivariate_t(phi[:, chosen] @ mean, scale, df=2 * prior.shape).logpdf(y)


def naive_fit(prior, phi, y, chosen):
    """Posterior mean and covariance of a structure's coefficients, from the joint distribution with the response."""
    mean, cov = prior_of(prior, phi, chosen)
    part = phi[:, chosen]
    whole = np.eye(y.size) + part @ cov @ part.T
    left = y - part @ mean
    gain = np.linalg.solve(whole, part @ cov).T
    spread = 2 * prior.rate + left @ np.linalg.solve(whole, left)
    return mean + gain @ left, spread / (2 * prior.shape + y.size - 2) * (cov - gain @ part @ cov)


def naive_all(prior, phi, y, always=(), allowed=lambda there: True, log_prior=lambda there: 0.0):
    """Every structure with its evidence and probability, and averages over them, by the definitions."""
    k = phi.shape[1]
    logs, rows, means, covs = {}, [], [], []
    for bits in product([0, 1], repeat=k):
        there = np.array(bits[::-1], bool)
        if not there[list(always)].all() or not allowed(there):
            continue
        chosen = np.flatnonzero(there)
        structure = int(np.sum(2**chosen))
        logs[structure] = naive_log_evidence(prior, phi, y, chosen)
        mean, cov = np.zeros(k), np.zeros((k, k))
        mean[chosen], cov[np.ix_(chosen, chosen)] = naive_fit(prior, phi, y, chosen)
        rows.append(there)
        means.append(mean)
        covs.append(cov)
    log_evidence = np.array(list(logs.values()))
    weight = np.exp(log_evidence - log_evidence.max() + [log_prior(there) for there in rows])
    weight /= weight.sum()
    there, means, covs = np.array(rows, float), np.array(means), np.array(covs)
    mean = weight @ means
    return {
        "structures": np.array(list(logs)),
        "log_evidence": log_evidence,
        "probability": weight,
        "joint": (there.T * weight) @ there,
        "mean": mean,
        "within": np.einsum("s,sij->ij", weight, covs),
        "between": ((means - mean).T * weight) @ (means - mean),
    }


def agree(found, naive, tolerance=1e-10):
    """Compare everything, covariances relative to their diagonals."""
    order = np.argsort(found.structures)
    np.testing.assert_array_equal(found.structures[order], np.sort(naive["structures"]))
    by_number = np.argsort(naive["structures"])
    assert found.count == naive["structures"].size
    np.testing.assert_allclose(found.log_evidence[order], naive["log_evidence"][by_number], rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.probability[order], naive["probability"][by_number], rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.joint, naive["joint"], rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.inclusion, np.diag(naive["joint"]), rtol=0, atol=tolerance)
    sd = np.sqrt(np.diag(naive["within"] + naive["between"]) + 1e-300)
    np.testing.assert_allclose(found.mean / sd, naive["mean"] / sd, rtol=0, atol=tolerance)
    for which in ("within", "between"):
        np.testing.assert_allclose(
            getattr(found, which) / np.outer(sd, sd), naive[which] / np.outer(sd, sd), rtol=0, atol=tolerance
        )


def problem(k, **how):
    """Regressors, response and statistics."""
    phi, y = regression(k, **how)
    return phi, y, gram(phi, y)
