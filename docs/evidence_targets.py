"""Posteriors of known evidence for docs/evidence.py: benign ones, and ones made to mislead.

All are integrals over a prior that can be done without sampling, in closed form or by quadrature over one variable.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy import integrate, special, stats

from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Prior, Uniform


class Problem(NamedTuple):
    """A posterior, its exact log evidence, nats, and how that is known."""

    posterior: Posterior
    log_evidence: float
    known: str


def normal(d: int, correlation: float = 0.9, sd: float = 0.3) -> Problem:
    """Correlated normal likelihood under standard normal priors: Z is the density of the sum of both at its centre."""
    centre = np.linspace(-1.0, 1.0, d)
    cov = sd**2 * (correlation * np.ones((d, d)) + (1 - correlation) * np.eye(d))
    data = (jnp.asarray(centre), jnp.asarray(np.linalg.inv(cov)), jnp.asarray(np.linalg.slogdet(cov)[1]))
    exact = stats.multivariate_normal(centre, cov + np.eye(d)).logpdf(np.zeros(d))
    return Problem(
        _posterior({f"x{i}": Normal(0.0, 1.0) for i in range(d)}, _normal, data), float(exact), "closed form"
    )


def regression() -> Problem:
    """Three coefficients and an unknown noise: given the noise, data are jointly normal, and its prior is integrated over."""
    design, measured = _regression_data()
    noise = LogNormal(0.5, 2.0)
    priors = {f"c{i}": Normal(0.3, 2.0) for i in range(3)} | {"noise": noise}

    def density(z: float) -> float:
        sd = noise.median * noise.factor**z
        return float(np.exp(_log_marginal(design, measured, sd))) * float(stats.norm.pdf(z))

    exact = np.log(integrate.quad(density, -6.0, 6.0, points=[-1.0, 0.0, 1.0], epsabs=0.0, epsrel=1e-10)[0])
    data = (jnp.asarray(design), jnp.asarray(measured))
    return Problem(_posterior(priors, _linear, data), float(exact), "quadrature over the noise")


def term(index: int = 1, sd: float = 0.5) -> Problem:
    """As `regression` with known noise; the value is log Z with coefficient `index` less that without it."""
    design, measured = _regression_data()
    priors = {f"c{i}": Normal(0.3, 2.0) for i in range(3)}
    without = np.delete(design, index, axis=1)
    exact = _log_marginal(design, measured, sd) - _log_marginal(without, measured, sd)
    data = (jnp.asarray(design), jnp.asarray(measured), jnp.asarray(sd))
    return Problem(_posterior(priors, _linear_known, data), exact, "closed form")


def banana() -> Problem:
    """A curved ridge: x measured coarsely, y + 0.7 x^2 finely; y is integrated by hand, x by quadrature."""
    coarse, fine, x_seen, bent_seen, bend = 0.8, 0.1, 0.5, 0.3, 0.7
    data = tuple(map(jnp.asarray, (x_seen, coarse, bent_seen, fine, bend)))

    def density(x: float) -> float:
        seen = stats.norm.pdf(x_seen, x, coarse) * stats.norm.pdf(bent_seen - bend * x**2, 0.0, np.hypot(1.0, fine))
        return float(seen * stats.norm.pdf(x))

    exact = np.log(integrate.quad(density, -8.0, 8.0, points=[-1.0, 0.0, 1.0], epsabs=0.0, epsrel=1e-10)[0])
    return Problem(
        _posterior({"x": Normal(0.0, 1.0), "y": Normal(0.0, 1.0)}, _bent, data), float(exact), "quadrature over x"
    )


def wide_regression() -> Problem:
    """Three nearly equal regressors, unknown noise and flat priors 3 000 times wider than the posterior, as of a new surge campaign.

    Given the noise the integral over the coefficients is closed, for all of it lies far inside their prior.
    """
    rows, k, half, least, most = 300, 3, 50.0, 0.002, 20.0
    rng = np.random.default_rng(5)
    design = rng.normal(size=(rows, 1)) + 0.2 * rng.normal(size=(rows, k))
    measured = design @ np.linspace(1.0, 2.0, k) + 0.016 * rng.normal(size=rows)
    square = float(np.linalg.lstsq(design, measured, rcond=None)[1][0])
    best = 0.5 * np.log(square / (rows - k))

    def density(log_sd: float) -> float:
        return float(np.exp(-(rows - k) * (log_sd - best) - 0.5 * square * (np.exp(-2 * log_sd) - np.exp(-2 * best))))

    inside = integrate.quad(density, best - 0.5, best + 0.5, points=[best], epsabs=0.0, epsrel=1e-10)[0]
    exact = np.log(inside / np.log(most / least)) - (rows - k) * (best + 0.5 * np.log(2 * np.pi))
    exact -= 0.5 * square * np.exp(-2 * best) + 0.5 * np.linalg.slogdet(design.T @ design)[1] + k * np.log(2 * half)
    priors = {f"c{i}": Uniform(-half, half) for i in range(k)} | {"noise": LogUniform(least, most)}
    data = (jnp.asarray(design), jnp.asarray(measured))
    return Problem(_posterior(priors, _linear, data), float(exact), "closed form, and quadrature over the noise")


def beyond_the_edge() -> Problem:
    """A peak two standard deviations outside the prior's box: a product of differences of normal distributions."""
    centre, sd = np.array([1.2, 0.5]), np.array([0.1, 0.1])
    inside = stats.norm(centre, sd).cdf(1.0) - stats.norm(centre, sd).cdf(0.0)
    data = (jnp.asarray(centre), jnp.asarray(np.diag(sd**-2.0)), jnp.asarray(2 * np.log(sd).sum()))
    target = _posterior({"a": Uniform(0.0, 1.0), "b": Uniform(0.0, 1.0)}, _normal, data)
    return Problem(target, float(np.log(inside).sum()), "closed form")


def two_peaks(at: float = 1.0, sd: float = 0.03) -> Problem:
    """Equal peaks sixty-six standard deviations apart under standard normal priors, half of Z in each."""
    centre = np.array([at, 0.0])
    data = tuple(map(jnp.asarray, (np.stack([-centre, centre]), np.full(2, sd), np.log([0.5, 0.5]))))
    exact = stats.multivariate_normal(centre, (1 + sd**2) * np.eye(2)).logpdf(np.zeros(2))
    return Problem(_posterior({"x0": Normal(0.0, 1.0), "x1": Normal(0.0, 1.0)}, _mixture, data), exact, "closed form")


def phase_transition(d: int = 10, spike: float = 0.01, slab: float = 0.1, away: float = 0.031) -> Problem:
    """A spike of a hundred times the evidence inside a slab, in the unit cube (Skilling, Bayesian Analysis 1, 2006)."""
    data = (np.stack([np.full(d, away), np.zeros(d)]), np.array([spike, slab]), np.log([100.0, 1.0]))
    inside = [d * np.log(np.diff(stats.norm(c, s).cdf([-0.5, 0.5]))[0]) for c, s in ((away, spike), (0.0, slab))]
    target = _posterior({f"x{i}": Uniform(-0.5, 0.5) for i in range(d)}, _mixture, tuple(map(jnp.asarray, data)))
    return Problem(target, float(np.logaddexp(np.log(100.0) + inside[0], inside[1])), "closed form")


def shells(d: int, radius: float = 2.0, width: float = 0.1, away: float = 3.5, half: float = 6.0) -> Problem:
    """Two thin spherical shells in a box (Feroz, Hobson and Bridges, MNRAS 398, 2009); each is integrated over its radius."""
    centre = np.zeros(d)
    centre[0] = away
    data = jnp.asarray(np.stack([-centre, centre])), jnp.asarray(radius), jnp.asarray(width)
    area = np.log(2.0) + 0.5 * d * np.log(np.pi) - special.gammaln(0.5 * d)

    def density(r: float) -> float:
        return float(r ** (d - 1) * stats.norm.pdf(r, radius, width))

    inside = integrate.quad(density, 0.0, half - away, points=[radius], epsabs=0.0, epsrel=1e-10)[0]
    exact = np.log(2.0 * inside) + area - d * np.log(2.0 * half)
    target = _posterior({f"x{i}": Uniform(-half, half) for i in range(d)}, _on_shells, data)
    return Problem(target, float(exact), "quadrature over the radius")


def egg_box() -> Problem:
    """Some eighteen equal peaks, of log height 243 (Feroz, Hobson and Bridges, MNRAS 398, 2009); a grid of 2000 points a side is exact."""
    side = (np.arange(2000) + 0.5) * 10 * np.pi / 2000
    logs = (2.0 + np.cos(side[:, None] / 2) * np.cos(side / 2)) ** 5
    box = Uniform(0.0, 10 * np.pi)
    exact = special.logsumexp(logs) - np.log(logs.size)
    return Problem(_posterior({"x": box, "y": box}, _egg_box, None), float(exact), "quadrature over both")


def _posterior(priors: dict[str, Prior], likelihood: Callable[[dict[str, Any], Any], Any], data: Any) -> Posterior:
    return Posterior(tuple(Parameter(name, "1", name, prior) for name, prior in priors.items()), likelihood, data)


def _regression_data() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    design = random.normal(size=(20, 3)) + random.normal(size=(20, 1))
    return design, design @ np.array([-1.0, 0.1, 1.0]) + 0.5 * random.normal(size=20)


def _log_marginal(design: np.ndarray, measured: np.ndarray, sd: float, mean: float = 0.3, spread: float = 2.0) -> float:
    """Log density of the data of a linear model whose coefficients are normal about `mean`."""
    cov = spread**2 * design @ design.T + sd**2 * np.eye(measured.size)
    return float(stats.multivariate_normal(mean * design.sum(1), cov).logpdf(measured))


def _normal(values: dict[str, Any], data: Any) -> Any:
    centre, precision, log_det = data
    off = jnp.stack(list(values.values())) - centre
    return -0.5 * (off @ precision @ off + log_det + off.size * jnp.log(2 * jnp.pi))


def _linear(values: dict[str, Any], data: Any) -> Any:
    *coefficients, noise = values.values()
    return _linear_known(dict(enumerate(coefficients)), (*data, noise))


def _linear_known(values: dict[Any, Any], data: Any) -> Any:
    design, measured, sd = data
    residual = (measured - design @ jnp.stack(list(values.values()))) / sd
    return -0.5 * jnp.sum(residual**2) - measured.size * (jnp.log(sd) + 0.5 * jnp.log(2 * jnp.pi))


def _bent(values: dict[str, Any], data: Any) -> Any:
    x_seen, coarse, bent_seen, fine, bend = data
    x, y = values["x"], values["y"]
    off = ((x_seen - x) / coarse) ** 2 + ((bent_seen - y - bend * x**2) / fine) ** 2
    return -0.5 * off - jnp.log(2 * jnp.pi * coarse * fine)


def _mixture(values: dict[str, Any], data: Any) -> Any:
    """Log of a weighted sum of two round normal densities."""
    centres, sd, log_weight = data
    x = jnp.stack(list(values.values()))
    square = jnp.sum(((x - centres) / sd[:, None]) ** 2, -1)
    terms = log_weight - 0.5 * square - x.size * (jnp.log(sd) + 0.5 * jnp.log(2 * jnp.pi))
    return jnp.logaddexp(terms[0], terms[1])


def _on_shells(values: dict[str, Any], data: Any) -> Any:
    centres, radius, width = data
    x = jnp.stack(list(values.values()))
    off = (jnp.sqrt(jnp.sum((x - centres) ** 2, -1)) - radius) / width
    terms = -0.5 * off**2 - jnp.log(width) - 0.5 * jnp.log(2 * jnp.pi)
    return jnp.logaddexp(terms[0], terms[1])


def _egg_box(values: dict[str, Any], data: Any) -> Any:
    return (2.0 + jnp.cos(values["x"] / 2) * jnp.cos(values["y"] / 2)) ** 5
