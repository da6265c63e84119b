"""Posteriors whose moments are published or known in closed form, written as priors and likelihoods of ours.

Data, and means and standard deviations of 10 000 reference draws each: posteriordb (Magnusson et al., arXiv:2407.04967),
posteriors hudson_lynx_hare-lotka_volterra, arK-arK, garch-garch11, eight_schools-eight_schools_noncentered,
one_comp_mm_elim_abs-one_comp_mm_elim_abs and low_dim_gauss_mix-low_dim_gauss_mix; series to four decimals. The banana is
the twisted normal of Haario, Saksman and Tamminen (Computational Statistics 14, 1999).
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr

from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors import LogNormal, Normal, Uniform, truncated_normal
from seatrial.numerics.integrate import rk4_step
from tests.estimation_cases import posterior


class Reference(NamedTuple):
    """A posterior, the quantities of it that are published as functions of its parameters, and their moments.

    Attributes:
        target: posterior.
        quantities: of parameters by name to quantities by name.
        moments: mean and standard deviation of each quantity.
        draws: reference draws behind these; infinite where they are exact.
    """

    target: Posterior
    quantities: Callable[[Mapping[str, Any]], dict[str, Any]]
    moments: dict[str, tuple[float, float]]
    draws: float


def lynx_hare() -> Reference:
    """Hare u and lynx v, thousands of pelts: u' = (a - b v) u, v' = (d u - c) v, measured with log-normal errors."""
    priors = {
        "a": truncated_normal(1.0, 0.5, lower=0.0),
        "b": truncated_normal(0.05, 0.05, lower=0.0),
        "c": truncated_normal(1.0, 0.5, lower=0.0),
        "d": truncated_normal(0.05, 0.05, lower=0.0),
        "u0": LogNormal(10.0, np.e),
        "v0": LogNormal(10.0, np.e),
        "sigma_u": LogNormal(np.exp(-1.0), np.e),
        "sigma_v": LogNormal(np.exp(-1.0), np.e),
    }
    published = {
        "a": (0.546864, 0.0630548),
        "b": (0.0277473, 0.00415472),
        "c": (0.800095, 0.0893702),
        "d": (0.0240859, 0.00352809),
        "u0": (34.0352, 2.9169),
        "v0": (5.93590, 0.530552),
        "sigma_u": (0.248057, 0.0432627),
        "sigma_v": (0.251017, 0.0435903),
    }
    return Reference(posterior(priors, _pelts, jnp.log(jnp.asarray(PELTS))), dict, published, 10_000)


def autoregression() -> Reference:
    """Autoregression of order five: y_t ~ N(m + sum_k b_k y_(t-k), sigma), sigma half-Cauchy of scale 2.5."""
    y = _series(AR_SERIES)
    before = np.column_stack([np.ones(y.size - 5)] + [y[5 - k : -k] for k in range(1, 6)])
    priors = {name: Normal(0.0, 10.0) for name in ("m", "b1", "b2", "b3", "b4", "b5")} | {"score": Normal(0.0, 1.0)}
    published = {
        "m": (-0.00071865, 0.0107082),
        "b1": (0.692163, 0.0705509),
        "b2": (0.439043, 0.0873098),
        "b3": (0.105816, 0.0930826),
        "b4": (-0.035435, 0.0860418),
        "b5": (-0.301512, 0.0698831),
        "sigma": (0.150567, 0.00777472),
    }
    data = jnp.asarray(before), jnp.asarray(y[5:])
    return Reference(posterior(priors, _regressed, data), _with_cauchy("sigma", 2.5), published, 10_000)


def garch() -> Reference:
    """GARCH(1, 1), y_t ~ N(m, s_t), s_t^2 = a0 + a1 (y_(t-1) - m)^2 + b1 s_(t-1)^2, flat where a1 + b1 < 1.

    The bounds on m and a0, without which a flat prior would be improper, lie over 14 standard deviations away.
    """
    priors = {"m": Uniform(3.0, 7.0), "a0": Uniform(0.0, 10.0), "a1": Uniform(0.0, 1.0), "share": Uniform(0.0, 1.0)}
    published = {
        "m": (5.05002, 0.124031),
        "a0": (1.47076, 0.571817),
        "a1": (0.567284, 0.12711),
        "b1": (0.293025, 0.124776),
    }

    def quantities(values: Mapping[str, Any]) -> dict[str, Any]:
        return {**values, "b1": values["share"] * (1.0 - values["a1"])}

    return Reference(posterior(priors, _volatile, jnp.asarray(_series(GARCH_SERIES))), quantities, published, 10_000)


def eight_schools() -> Reference:
    """Effects theta_j = m + tau e_j of eight schools, not centred, tau half-Cauchy of scale 5."""
    effects = {f"e{j}": Normal(0.0, 1.0) for j in range(1, 9)}
    priors = {"m": Normal(0.0, 5.0), "score": Normal(0.0, 1.0), **effects}
    published = {
        "theta1": (6.1505, 5.61586),
        "theta2": (4.93958, 4.64558),
        "theta3": (3.90591, 5.28071),
        "theta4": (4.79602, 4.77094),
        "theta5": (3.61444, 4.61472),
        "theta6": (4.05115, 4.79625),
        "theta7": (6.31717, 5.00286),
        "theta8": (4.884, 5.31769),
        "m": (4.41052, 3.3093),
        "tau": (3.60206, 3.19848),
    }
    data = jnp.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0]), jnp.array([15.0, 10, 16, 11, 9, 11, 10, 18])
    return Reference(posterior(priors, _schools, data), _thetas, published, 10_000)


def one_compartment() -> Reference:
    """Concentration y' = k D exp(-k t) / V - (m / V) y / (c + y) of a dose D = 30 in a volume V = 2, log-normal errors, half-Cauchy priors.

    The fourth moments of c are infinite in practice: c and m are compared by their logarithms, whose moments are those of the draws.
    """
    published = {
        "k": (0.761013, 0.0778999),
        "log c": (-0.0729307, 1.42951),
        "log m": (-0.0749699, 0.290155),
        "sigma": (0.128835, 0.0234012),
    }

    def quantities(values: Mapping[str, Any]) -> dict[str, Any]:
        named = {name: _half_cauchy(score, 1.0) for name, score in values.items()}
        return named | {f"log {name}": jnp.log(named[name]) for name in "cm"}

    priors = {name: Normal(0.0, 1.0) for name in ("k", "c", "m", "sigma")}
    return Reference(posterior(priors, _eliminated, jnp.log(_series(CONCENTRATIONS))), quantities, published, 10_000)


def mixture() -> Reference:
    """Two normal densities with shares theta and 1 - theta, of 1000 values by the moments of eight stretches of them.

    The mode of the likelihood is that of the single values to 0.005 standard deviations. Of both orders of the means one is kept: zero is
    over fifty standard deviations away from either.
    """
    priors = {
        "m1": truncated_normal(0.0, 2.0, upper=0.0),
        "m2": truncated_normal(0.0, 2.0, lower=0.0),
        "s1": truncated_normal(0.0, 2.0, lower=0.0),
        "s2": truncated_normal(0.0, 2.0, lower=0.0),
        "theta": Uniform(0.0, 1.0),
    }
    published = {
        "m1": (-2.73351, 0.0420429),
        "m2": (2.86983, 0.0546006),
        "s1": (1.02807, 0.0314359),
        "s2": (1.02382, 0.0404819),
        "theta": (0.621549, 0.0154802),
    }
    count, mean, sd = jnp.asarray(STRETCHES).T
    data = jnp.concatenate([mean - sd, mean + sd]), jnp.tile(0.5 * count, 2)
    return Reference(posterior(priors, _mixed, data), dict, published, 10_000)


def banana() -> Reference:
    """x2 + 0.03 (x1^2 - 100) ~ N(0, 1) with x1 ~ N(0, 10^2): x2 has mean 0 and variance 1 + 2 (0.03 100)^2 = 19."""
    target = posterior({"x1": Normal(0.0, 10.0), "x2": Normal(0.0, 20.0)}, _twisted)
    return Reference(target, dict, {"x1": (0.0, 10.0), "x2": (0.0, np.sqrt(19.0))}, np.inf)


REFERENCES = {
    "lynx-hare": lynx_hare,
    "autoregression": autoregression,
    "garch": garch,
    "eight-schools": eight_schools,
    "one-compartment": one_compartment,
    "mixture": mixture,
    "banana": banana,
}
STEPS = 8
"""Runge-Kutta steps in a year, or in half an hour."""


def _pelts(values: Mapping[str, Any], log_pelts: Any) -> Any:
    """The logarithms of both populations are integrated, so that none falls below zero."""

    def rate(x: tuple) -> tuple:
        return values["a"] - values["b"] * jnp.exp(x[1]), values["d"] * jnp.exp(x[0]) - values["c"]

    def year(x: tuple, measured: Any) -> tuple:
        off = [(y - at) / values[name] for y, at, name in zip(measured, x, ("sigma_u", "sigma_v"), strict=True)]
        x = jax.lax.fori_loop(0, STEPS, lambda _, x: rk4_step(rate, x, 1.0 / STEPS), x)
        return x, -0.5 * (off[0] ** 2 + off[1] ** 2) - jnp.log(values["sigma_u"] * values["sigma_v"])

    _, terms = jax.lax.scan(year, (jnp.log(values["u0"]), jnp.log(values["v0"])), log_pelts)
    return _finite(jnp.sum(terms))


def _regressed(values: Mapping[str, Any], data: tuple) -> Any:
    before, y = data
    named = _with_cauchy("sigma", 2.5)(values)
    off = y - before @ jnp.stack([named[name] for name in ("m", "b1", "b2", "b3", "b4", "b5")])
    return _finite(-0.5 * jnp.sum((off / named["sigma"]) ** 2) - y.size * jnp.log(named["sigma"]))


def _volatile(values: Mapping[str, Any], y: Any) -> Any:
    """The factor 1 - a1 makes what is uniform in the share uniform in b1."""
    b1 = values["share"] * (1.0 - values["a1"])

    def step(carry: tuple, now: Any) -> tuple:
        square, total = carry
        total = total - 0.5 * ((now - values["m"]) ** 2 / square + jnp.log(square))
        return (values["a0"] + values["a1"] * (now - values["m"]) ** 2 + b1 * square, total), None

    (_, total), _ = jax.lax.scan(step, (jnp.asarray(0.25), jnp.zeros(())), y)
    return _finite(total + jnp.log1p(-values["a1"]))


def _schools(values: Mapping[str, Any], data: tuple) -> Any:
    y, sd = data
    named = _thetas(values)
    return _finite(-0.5 * jnp.sum(((y - jnp.stack([named[f"theta{j}"] for j in range(1, 9)])) / sd) ** 2))


def _eliminated(values: Mapping[str, Any], log_measured: Any) -> Any:
    k, c, m, sigma = (_half_cauchy(values[name], 1.0) for name in ("k", "c", "m", "sigma"))
    step = 0.5 / STEPS

    def rate(x: tuple) -> tuple:
        return 1.0, 15.0 * k * jnp.exp(-k * x[0]) - 0.5 * m * x[1] / (c + x[1])

    def half_hour(x: tuple, measured: Any) -> tuple:
        x = jax.lax.fori_loop(0, STEPS, lambda _, x: rk4_step(rate, x, step), x)
        return x, -0.5 * ((measured - jnp.log(x[1])) / sigma) ** 2 - jnp.log(sigma)

    _, terms = jax.lax.scan(half_hour, (jnp.zeros(()), jnp.zeros(())), log_measured)
    return _finite(jnp.sum(terms))


def _mixed(values: Mapping[str, Any], data: tuple) -> Any:
    """The prior of theta is the beta density of 5 and 5."""
    y, count = data
    first, second = (jnp.exp(-0.5 * ((y - values[f"m{i}"]) / values[f"s{i}"]) ** 2) / values[f"s{i}"] for i in (1, 2))
    theta = values["theta"]
    terms = jnp.log(theta * first + (1.0 - theta) * second)
    return _finite(jnp.sum(count * terms) + 4.0 * jnp.log(theta * (1.0 - theta)))


def _thetas(values: Mapping[str, Any]) -> dict[str, Any]:
    named = _with_cauchy("tau", 5.0)(values)
    return named | {f"theta{j}": named["m"] + named["tau"] * named[f"e{j}"] for j in range(1, 9)}


def _twisted(values: Mapping[str, Any], data: None) -> Any:
    """The likelihood takes the prior of x2 off again."""
    x1, x2 = values["x1"], values["x2"]
    return -0.5 * (x2 + 0.03 * (x1 * x1 - 100.0)) ** 2 + 0.5 * (x2 / 20.0) ** 2


def _with_cauchy(name: str, scale: float) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """Add a half-Cauchy quantity, whose distribution function is the normal one of `score`."""
    return lambda values: {**values, name: _half_cauchy(values["score"], scale)}


def _half_cauchy(score: Any, scale: float) -> Any:
    return scale * jnp.tan(0.5 * jnp.pi * ndtr(score))


def _finite(x: Any) -> Any:
    return jnp.where(jnp.isfinite(x), x, -jnp.inf)


def _series(text: str) -> np.ndarray:
    return np.array(text.split(), float)


PELTS = [
    (30, 4), (47.2, 6.1), (70.2, 9.8), (77.4, 35.2), (36.3, 59.4), (20.6, 41.7), (18.1, 19), (21.4, 13), (22, 8.3),
    (25.4, 9.1), (27.1, 7.4), (40.3, 8), (57, 12.3), (76.6, 19.5), (52.3, 45.7), (19.5, 51.1), (11.2, 29.7), (7.6, 15.8),
    (14.6, 9.7), (16.2, 10.1), (24.7, 8.6),
]  # fmt: skip
"""Hare and lynx in 1900 to 1920, thousands of pelts."""
CONCENTRATIONS = """
5.7081 7.1013 8.3852 9.7901 13.4390 11.4479 11.2124 11.4269 12.2433 13.8202 13.8409 11.4223 10.5032 11.9121 14.0850
10.5506 10.1906 12.2232 11.7291 12.2720
"""
"""Each half hour from 0.5 on, mg/L."""
STRETCHES = [
    (467, -3.1640, 0.7693), (134, -1.5867, 0.2840), (15, -0.7996, 0.1688), (4, -0.3394, 0.0943), (5, 0.1872, 0.0924),
    (10, 0.7074, 0.0735), (61, 1.6299, 0.2786), (304, 3.2154, 0.7897),
]  # fmt: skip
"""Number, mean and standard deviation of the values up to -2, -1, -0.5, 0, 0.5, 1, 2 and beyond."""
AR_SERIES = """
0.7294 0.8298 0.7840 1.0260 0.9697 1.0829 0.7064 0.7769 0.4618 0.6386 0.3742 0.0855 -0.1260 -0.2934 -0.2617 -0.3359
-0.5020 -0.6417 -0.6225 -0.8509 -0.8678 -1.0164 -1.0559 -0.9695 -1.0673 -0.8431 -0.6827 -0.4447 -0.5920 -0.5106
-0.4179 -0.1736 -0.1073 -0.0355 0.3432 0.3842 0.4961 0.7085 0.5963 0.6414 0.6513 0.5942 0.7779 0.7308 0.4822 0.5320
0.4851 0.3686 0.3533 0.1634 0.2530 0.0007 -0.0158 -0.0145 -0.0253 -0.0056 -0.3189 -0.0228 -0.0717 -0.1850 -0.2350
-0.1243 -0.1305 -0.1995 0.0776 -0.1629 0.0235 -0.0647 0.0845 0.0550 0.1417 0.0877 -0.0528 0.0695 -0.1014 -0.0689
-0.2512 -0.3903 -0.1676 -0.2792 -0.3121 -0.2866 -0.4118 -0.4982 -0.5029 -0.7394 -0.2492 -0.4710 -0.4646 -0.4457
-0.2844 -0.0228 -0.0606 0.0662 0.1405 0.2763 0.3772 0.6103 0.8809 0.7885 0.8014 0.6610 0.8098 0.8205 0.9808 0.7240
0.9319 0.8505 0.4806 0.5086 0.4161 0.3147 -0.0282 -0.0717 -0.1439 -0.5224 -0.4034 -0.6886 -0.6947 -0.6497 -0.9927
-0.9354 -0.8970 -0.9782 -1.0668 -0.9536 -0.7571 -0.8426 -0.6978 -0.3166 -0.3878 -0.0671 -0.0385 0.0896 0.1455 0.1852
0.3956 0.6853 0.5563 0.7108 0.7463 0.6685 0.6937 0.7380 0.6628 0.6901 0.6807 0.3733 0.4537 0.3138 0.4500 -0.0338
0.0047 -0.0857 0.1083 -0.1398 -0.0430 -0.4542 -0.3326 -0.2334 -0.2015 -0.1827 -0.2279 -0.0415 -0.1210 -0.0724 -0.0482
0.1580 0.0584 -0.1118 -0.0382 0.1790 -0.0148 0.0501 -0.1981 -0.1400 -0.1747 -0.1768 -0.2154 -0.4145 -0.3405 -0.4483
-0.6571 -0.3546 -0.5257 -0.6564 -0.5245 -0.4759 -0.3631 -0.3367 -0.3254 0.0007 0.2080 0.0023 0.1125 0.3494 0.4717
0.5907 0.6049 0.9332
"""
GARCH_SERIES = """
4.9377 4.8899 5.0255 4.3557 3.8357 6.4251 6.2175 5.3789 6.1203 5.1143 7.6246 -1.8588 5.5093 6.4493 5.1634 3.4464
4.1698 4.1065 4.3615 5.9580 4.0460 3.1269 3.0014 7.2569 0.6181 -0.1529 9.1520 4.2929 8.4798 3.4712 -0.7845 6.3644
7.3925 7.4482 7.9463 7.4520 4.9161 7.0784 2.2756 4.3339 5.3357 7.7133 3.8466 6.5228 3.8073 5.5855 4.0172 3.9905 5.3564
5.6390 5.8895 6.0431 7.0166 5.2398 7.5705 7.1372 5.0647 3.9294 3.4554 4.3275 8.2122 5.4182 4.7842 3.9840 8.2692 3.3376
2.0657 1.5275 1.8313 3.4273 10.6729 9.1517 5.0238 9.3370 6.2414 6.0495 5.1751 3.5839 2.5955 4.8391 3.9603 5.8276
4.2355 7.2289 2.6013 4.6906 1.9172 4.6100 5.4795 5.1600 6.1819 4.3444 4.4135 6.6870 3.3490 6.8327 4.1952 6.7873 3.3810
6.9186 3.6889 6.2622 3.4475 0.5622 12.0984 -3.9476 -3.2152 8.9190 6.9925 8.6113 0.7973 0.7408 6.6504 -1.0103 6.0101
1.0597 6.8293 4.1637 5.1218 5.3588 2.9457 3.0979 4.2589 7.3676 2.1470 7.3754 4.8272 4.5120 5.7304 4.4194 2.7559 4.3645
7.1601 8.2984 2.8167 3.9180 9.7952 -4.7243 5.4549 6.5447 6.5973 6.2416 3.0397 1.2094 5.2637 8.6438 7.4911 6.4736
4.5251 6.7227 4.9341 4.1566 4.5101 6.2951 3.1983 5.0968 3.2662 5.5376 6.2442 7.2051 3.0705 2.7455 0.9820 5.2894 3.8638
3.2133 5.9142 7.2122 5.7236 6.8713 2.7827 3.9140 5.8715 4.8225 6.4461 4.9014 4.7609 6.5645 2.6158 7.2306 4.3069 3.9418
8.9272 3.4283 1.1672 0.8544 12.1461 -6.3508 7.7056 4.5137 4.9229 6.4622 0.2857 3.6448 6.2438 7.6303 8.8403 6.9153
4.1049 5.2848
"""
