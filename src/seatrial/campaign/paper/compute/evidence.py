"""Tables IV and V: Listing 1 as printed, its effective sample size and spread, beside evidences that share no code.

One 60 s trial of doublets (200 rpm, 10 s, over 40 s) at 0.01 s of the vehicle with X_du3, measured with a noise of 0.0757 m/s.
M-1 lacks the cubic term, M-0 has it. Priors are uniform about half the truth, 200 % of it to either side.
"""

from collections.abc import Callable, Sequence
from math import sqrt
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.campaign.paper.items import Item, Number, Verdict
from seatrial.campaign.paper.reading import NAMES, RPM, Reading
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.core.signals import signal_unit
from seatrial.estimation.mode import find_mode
from seatrial.estimation.output_error import output_error
from seatrial.estimation.posterior import Parameter, Posterior
from seatrial.estimation.priors import Uniform
from seatrial.manoeuvres.signals import repeated_doublet
from seatrial.sampling.adaptive_metropolis import MetropolisSettings, sample_adaptive_metropolis
from seatrial.selection.bridge import bridge_evidence
from seatrial.selection.evidence import Evidence, smc_evidence
from seatrial.selection.importance import importance_evidence
from seatrial.selection.prior_monte_carlo import ListingOne, listing_one
from seatrial.vehicles.simulate import simulate

SIGMA, N, STEP = 0.0757, 6000, 0.01
CUBIC = "X_du3"
METHODS = ("importance sampling", "bridge sampling", "tempered SMC")
Estimator = Callable[[Posterior, jax.Array], Evidence]
TABLES = {"table-4": (0.1, 0.4642), "table-5": (1.0, 0.5501)}
"""True X_du3 and the printed probability of M-0."""


class Comparison(NamedTuple):
    """M-0 against M-1 on the same data.

    Attributes:
        listing: Listing 1 over many seeds, M-0 first.
        methods: evidences of (M-0, M-1) by method.
    """

    listing: ListingOne
    methods: dict[str, tuple[Evidence, Evidence]]


def paper_trial(reading: Reading, cubic: float, seed: int = 1) -> Record:
    """The trial of Section IV, simulated with the cubic term."""
    model, stamps = reading.model(CUBIC), STEP * np.arange(N)
    manoeuvre = repeated_doublet(
        "n", trim=reading.trim, amplitude=200 * RPM, period=10.0, duration=N * STEP, active=40.0, start=1.0
    )
    control = manoeuvre.signal(stamps)
    truth = {**reading.truth, CUBIC: cubic}
    speed = simulate(
        model, truth, jnp.asarray(control[:, None]), jnp.full(N, STEP), jnp.array([reading.hull.trim["u"]])
    )
    noise = SIGMA * np.random.default_rng(seed).normal(size=N)
    channels = (Channel("n", signal_unit("n"), "control"), Channel("u", signal_unit("u"), "measurement"))
    provenance = Provenance("simulated", "", {"reading": reading.name, CUBIC: cubic, "seed": seed})
    return make_record(stamps, {"n": control, "u": np.asarray(speed)[:, 0] + noise}, channels, provenance, "paper")


def paper_posterior(reading: Reading, record: Record, cubic: Uniform | None) -> Posterior:
    """M-1, or M-0 with a prior of the cubic term; eqs. (17) to (21)."""
    model = reading.model(CUBIC) if cubic is not None else reading.model()
    priors = {name: around(reading.truth[name]) for name in NAMES} | ({CUBIC: cubic} if cubic is not None else {})
    parameters = [
        Parameter(term.text, model.unit_of(term), term.label, priors[term.text]) for term in model.coefficients
    ]
    parameters.append(Parameter("sigma_u", "m/s", r"\sigma_{u}", Uniform(0.0, 2 * SIGMA)))
    likelihood, data = output_error(model, [record], ["u"], [[reading.hull.trim["u"]]])
    return Posterior(tuple(parameters), likelihood, data)


def around(value: float) -> Uniform:
    """Uniform about half a true value, 200 % of it to either side."""
    return Uniform(0.5 * value - 2 * abs(value), 0.5 * value + 2 * abs(value))


def compare(
    reading: Reading,
    cubic: float,
    *,
    methods: Sequence[str] = METHODS,
    repeats: int = 200,
    draws: int = 100_000,
    seed: int = 0,
) -> Comparison:
    """Listing 1 over many seeds, and estimators that share no code, on the trial of one table."""
    record = paper_trial(reading, cubic)
    models = [paper_posterior(reading, record, prior) for prior in (around(cubic), None)]
    key = jax.random.key(seed)
    listing = listing_one(models, jax.random.fold_in(key, 0), draws=draws, repeats=repeats)
    estimators: dict[str, Estimator] = {
        "importance sampling": importance_evidence,
        "bridge sampling": _bridge,
        "tempered SMC": smc_evidence,
    }
    found = {}
    for method in methods:
        full, reduced = (
            estimators[method](model, jax.random.fold_in(key, 1 + METHODS.index(method))) for model in models
        )
        found[method] = (full, reduced)
    return Comparison(listing, found)


def probability_of_full(pair: tuple[Evidence, Evidence]) -> tuple[float, float]:
    """P(M-0) at equal prior probabilities, and its Monte Carlo error."""
    full, reduced = pair
    p = 1.0 / (1.0 + float(np.exp(reduced.log_value - full.log_value)))
    return p, p * (1 - p) * sqrt(full.std_error**2 + reduced.std_error**2)


def bayes_factor_table(reading: Reading, key: str, comparison: Comparison) -> Item:
    """Table IV or V: whether the printed preference is one."""
    cubic, printed = TABLES[key]
    chances = comparison.listing.probability[:, 0]
    ess = np.concatenate([evidence.diagnostics["ess"] for evidence in comparison.listing.evidences])
    certain = float(np.mean((chances < 0.01) | (chances > 0.99)))
    found, error = probability_of_full(comparison.methods["importance sampling"])
    numbers = [
        Number("Listing 1: share of seeds with P(M-0) below .01 or above .99", None, certain),
        Number("Listing 1: share of seeds with P(M-0) in [.4, .6]", None, float(np.mean(np.abs(chances - 0.5) <= 0.1))),
        Number("Listing 1: median effective sample size", None, float(np.median(ess))),
    ]
    for method, pair in comparison.methods.items():
        numbers.append(Number(f"P(M-0), {method}", printed, *probability_of_full(pair)))
        numbers += [
            Number(f"log Z of {name}, {method}", None, evidence.log_value, evidence.std_error)
            for name, evidence in zip(("M-0", "M-1"), pair, strict=True)
        ]
    stable = np.median(ess) >= 400
    verdict: Verdict = "reproduced" if stable and abs(found - printed) < 3 * error + 0.02 else "cannot hold"
    because = (
        ""
        if verdict == "reproduced"
        else f"the printed {printed} is noise: over {chances.size} seeds {certain:.0%} of Listing 1's answers are below .01 or above .99, "
        f"carried by {np.median(ess):.1f} effective draws; the data say {found:.3f} ± {error:.3f}"
    )
    settings = {"reading": reading.name, CUBIC: cubic, "seeds": int(chances.size), "data_seed": 1, "sigma": SIGMA}
    return Item(key, f"Bayes factor at X_du3 = {cubic:g}", verdict, because, tuple(numbers), settings)


def _bridge(posterior: Posterior, key: jax.Array) -> Evidence:
    """Bridge sampling from adaptive Metropolis draws."""
    mode_key, start_key, chain_key, key = jax.random.split(key, 4)
    mode = find_mode(posterior, mode_key)
    noise = jax.random.normal(start_key, (32, posterior.dim))
    starts = jnp.asarray(mode.z) + noise @ jnp.linalg.cholesky(jnp.asarray(mode.cov)).T
    draws = sample_adaptive_metropolis(posterior, starts, jnp.asarray(mode.cov), chain_key, MetropolisSettings())
    return bridge_evidence(posterior, draws.z, key)
