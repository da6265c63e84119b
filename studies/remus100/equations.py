"""Section II and the equations of all sections: each one used, at one point, beside an independent computation of it."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from scipy import stats

from seatrial.numerics.gaussian import Gaussian
from seatrial.vehicles.linearise import linearise
from studies.remus100.reading import NAMES
from studies.remus100.study import Item, Number, Study
from studies.remus100.trial import STEP, doublets, paper_posterior, paper_trial

DRAWS_SEED = 6
POINT = (1.2, 1.1)  # Surge speed and propeller speed, over trim, at which the vehicle's equations are compared
# Relative differences allowed: to rounding, and where the independent number is itself a sample of 200 000.
ROUNDING_TOLERANCE, SAMPLING_TOLERANCE = 1e-9, 0.02
REASONS = {
    "equations-2": "(3) lacks a bracket, and (4) and (5) lack the division by m - X_udot: our sums of forces are as printed, "
    "and our filters have the Jacobians of du/dt",
    "equations-3": "(6) has one p too many, and (7), (9) and (10) lack the minus sign of an entropy, so that two errors "
    "cancel in (8); with H = -E[log p] throughout, the gain is H(prior) - H(posterior), never negative",
    "equations-4": "(26) and (27) are DIC = D(mean) + 2 p_D = Dbar + p_D, and (28) also includes the prior odds: its "
    "columns BF are posterior probabilities",
}
TITLES = {
    "equations-2": "Vehicle and Jacobians, eqs. (1) to (5)",
    "equations-3": "Entropy and information gain, eqs. (6) to (14)",
    "equations-4": "Hierarchical model and criteria, eqs. (17) to (28)",
}
ROWS = {"equations-2": ("(1), (3)", "(4)", "(5)"), "equations-3": ("(6), (7), (9), (10)", "(13), (14)", "(8), (11)")}


def equations_part(study: Study) -> xr.Dataset:
    """Return the rows of (equation, what, ours, independent)."""
    rows = [*_vehicle(study), *_entropy(), *_model(study)]
    return xr.Dataset(
        {"ours": ("row", [row[2] for row in rows]), "independent": ("row", [row[3] for row in rows])},
        {"equation": ("row", [row[0] for row in rows]), "what": ("row", [row[1] for row in rows])},
    )


def equations_2(study: Study) -> Item:
    """Eqs. (1) to (5)."""
    return _item(study, "equations-2", [])


def equations_3(study: Study) -> Item:
    """Eqs. (6) to (14)."""
    return _item(study, "equations-3", [])


def equations_4(study: Study) -> Item:
    """Eqs. (17) to (28), the criteria by the identities that hold between them."""
    data = study.part("chain-6-reduced")["criterion_value"]
    dic, bpic, p_d, mean = (float(data.sel(criterion=name)) for name in ("DIC", "BPIC", "p_D", "Dbar"))
    odds = study.part("evidence-4")["log_value"].sel({"method": "importance sampling"}).values
    extra = [
        ("(22) to (27)", "DIC - Dbar - p_D", dic - mean - p_d, 0.0),
        ("(22) to (27)", "BPIC - DIC - p_D", bpic - dic - p_d, 0.0),
        ("(24)", "p_D of Table VI, BPIC - DIC as printed", -13934.6 + 13939.8, 5.2),
        ("(28)", "P(M-0) + P(M-1)", float(np.sum(np.exp(odds - np.logaddexp(*odds)))), 1.0),
    ]
    return _item(study, "equations-4", extra)


def _vehicle(study: Study) -> list[tuple[str, str, float, float]]:
    reading, model = study.reading, study.reading.model()
    x_u, x_uu, t_nn = (reading.truth[name] for name in NAMES)
    u, n = POINT[0] * reading.hull.trim["u"], POINT[1] * reading.turns
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
    """Return the density of the hierarchical model at a point, by a plain loop and textbook densities."""
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


def _item(study: Study, key: str, extra: list[tuple[str, str, float, float]]) -> Item:
    data = study.part("equations")
    rows = zip(
        data["equation"].values, data["what"].values, data["ours"].values, data["independent"].values, strict=True
    )
    known = ROWS.get(key)
    taken = [row for row in rows if (row[0] in known if known else row[0].startswith(("(17)", "(18)")))] + extra
    apart = [
        f"{equation} {what} is {ours:.10g} here and {other:.10g} independently"
        for equation, what, ours, other in taken
        if not abs(ours - other)
        <= (SAMPLING_TOLERANCE if "draws" in what else ROUNDING_TOLERANCE) * max(1.0, abs(other))
    ]
    numbers = [
        Number(f"{equation} {what}, {whose}", None, float(value))
        for equation, what, ours, other in taken
        for whose, value in (("here", ours), ("independently", other))
    ]
    return Item(
        key,
        TITLES[key],
        "contradicted" if apart else "not comparable",
        "; ".join(apart) or REASONS[key],
        tuple(numbers),
        {"reading": study.reading.name, "sampled_with_seed": DRAWS_SEED, "data_seed": 1},
    )
