"""Every equation the study uses, at one point, beside an independent computation of it."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from scipy import stats

from seatrial.core.gaussian import Gaussian
from seatrial.vehicles.linearise import linearise
from studies.remus100.compute.trial import STEP, doublets, paper_posterior, paper_trial
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES

DRAWS_SEED = 6
POINT = (1.2, 1.1)
"""Surge speed and propeller speed, over trim, at which the vehicle's equations are compared."""


def equations_part(study: Study) -> xr.Dataset:
    """Rows of (equation, what, ours, independent)."""
    rows = [*_vehicle(study), *_entropy(), *_model(study)]
    return xr.Dataset(
        {"ours": ("row", [row[2] for row in rows]), "independent": ("row", [row[3] for row in rows])},
        {"equation": ("row", [row[0] for row in rows]), "what": ("row", [row[1] for row in rows])},
    )


def _vehicle(study: Study) -> list[tuple[str, str, float, float]]:
    reading, model = study.reading, study.reading.model()
    x_u, x_uu, t_nn = (reading.truth[name] for name in NAMES)
    u, n = POINT[0] * reading.hull.trim["u"], POINT[1] * reading.trim
    share = 1.0 - reading.hull.thrust_deduction
    force = x_u * u + x_uu * u * abs(u) + share * t_nn * n * abs(n)
    by_state, _ = linearise(model, reading.truth, (u,), (n,))
    by_parameter = jax.jacfwd(lambda c: model.derivative(dict(zip(NAMES, c, strict=True)), (u,), (n,))[0])(
        jnp.array([x_u, x_uu, t_nn])
    )
    return [
        ("(1), (3)", "du/dt [m/s^2]", float(model.derivative(reading.truth, (u,), (n,))[0]), force / reading.inertia),
        (
            "(4)",
            "d(du/dt)/du [1/s], divided by m - X_udot",
            float(by_state[0, 0]),
            (x_u + 2 * x_uu * abs(u)) / reading.inertia,
        ),
        ("(5)", "d(du/dt)/dX_u", float(by_parameter[0]), u / reading.inertia),
        ("(5)", "d(du/dt)/dX_uabsu", float(by_parameter[1]), u * abs(u) / reading.inertia),
        ("(5)", "d(du/dt)/dT_nabsn", float(by_parameter[2]), share * n * abs(n) / reading.inertia),
    ]


def _entropy() -> list[tuple[str, str, float, float]]:
    cov = np.array([[2.0, 0.6, 0.1], [0.6, 1.0, -0.2], [0.1, -0.2, 0.5]])
    after = 0.3 * cov
    mean = np.array([1.0, -2.0, 0.5])
    normal = stats.multivariate_normal(mean, cov)
    entropies = [
        float(Gaussian(jnp.asarray(mean), jnp.linalg.cholesky(jnp.asarray(p))).entropy()) for p in (cov, after)
    ]
    gain = normal.entropy() - stats.multivariate_normal(mean, after).entropy()
    draws = np.random.default_rng(DRAWS_SEED).multivariate_normal(mean, cov, 200_000)
    return [
        (
            "(6), (7), (9), (10)",
            "H = -E[log p] of a normal, by 200 000 draws [nat]",
            entropies[0],
            float(-stats.multivariate_normal.logpdf(draws, mean, cov).mean()),
        ),
        ("(13), (14)", "H = 1/2 ln((2 pi e)^n |P|) [nat]", entropies[0], float(normal.entropy())),
        ("(8), (11)", "gain = H(prior) - H(posterior) [nat]", entropies[0] - entropies[1], float(gain)),
    ]


def _model(study: Study) -> list[tuple[str, str, float, float]]:
    """Density of the hierarchical model at a point, by a plain loop and textbook densities."""
    reading, record = study.reading, paper_trial(study.reading, None)
    posterior = paper_posterior(reading, [record], None)
    sigma = 1.1 * reading.sigma
    values = {**{name: 0.97 * x for name, x in reading.truth.items()}, "sigma_u": sigma}
    share = 1.0 - reading.hull.thrust_deduction

    def rate(u: float, n: float) -> float:
        force = values["X_u"] * u + values["X_uabsu"] * u * abs(u) + share * values["T_nabsn"] * n * abs(n)
        return force / reading.inertia

    u, speed = reading.hull.trim["u"], []
    for n in doublets(reading).tolist():
        speed.append(u)
        k1 = rate(u, n)
        k2 = rate(u + STEP / 2 * k1, n)
        k3 = rate(u + STEP / 2 * k2, n)
        u += STEP / 6 * (k1 + 2 * k2 + 2 * k3 + rate(u + STEP * k3, n))
    residual = record.channel("u") - np.array(speed)
    likelihood = float(stats.norm.logpdf(residual, 0, sigma).sum())
    prior = -sum(math.log(4 * abs(x)) for x in reading.truth.values()) - math.log(2 * reading.sigma)
    z = posterior.unconstrain(jnp.array([values[name] for name in posterior.names]))
    slopes = jax.jvp(posterior.constrain, (z,), (jnp.ones_like(z),))[1]
    ours = float(posterior.log_prior(z) - jnp.log(jnp.abs(slopes)).sum())
    return [
        ("(18) to (20)", "log prior density", ours, prior),
        ("(17), (21), (23)", "log likelihood", float(posterior.log_likelihood(z)), likelihood),
    ]
