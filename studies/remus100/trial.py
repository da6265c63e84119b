"""The trial of Section IV and the posteriors fitted to it, eqs. (17) to (21).

60 s at 0.01 s: doublets of the largest amplitude and of 10 s, over 40 s. M-0 has the doubted term, M-1 lacks it. Priors are uniform
about half the truth, 200 % of it to either side.
"""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import Prior, Uniform
from seatrial.manoeuvres.family import Family
from seatrial.vehicles.simulate import simulate
from studies.remus100.reading import NAMES, Reading

DURATION, STEP, PERIOD, ACTIVE = 60.0, 0.01, 10.0, 40.0
N = round(DURATION / STEP)


def stamps() -> Float[np.ndarray, " n"]:
    """Sample times, s."""
    return STEP * np.arange(N)


def doublets(reading: Reading, period: float = PERIOD, active: float = ACTIVE) -> Float[np.ndarray, " n"]:
    """Return the propeller speed of the largest doublets, rad/s."""
    family = Family("n", reading.turns, DURATION, active, STEP)
    return np.asarray(family.signal(reading.highest, period, stamps()))


def simulated_speed(
    reading: Reading, truth: Mapping[str, float], control: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Surge speed from trim under true coefficients, the doubted one among them or not, m/s."""
    model = reading.model(*(name for name in truth if name not in NAMES))
    start = jnp.array([reading.hull.trim["u"]])
    return np.asarray(simulate(model, dict(truth), jnp.asarray(control[:, None]), jnp.full(control.size, STEP), start))[
        :, 0
    ]


def paper_trial(
    reading: Reading,
    doubted: float | None,
    seed: int = 1,
    control: Float[np.ndarray, " n"] | None = None,
    label: str = "paper",
) -> Record:
    """Return a simulated and measured trial; `doubted` is the true value of the doubted term, None for a vehicle without it."""
    control = doublets(reading) if control is None else control
    truth = reading.truth | ({} if doubted is None else {reading.doubted: doubted})
    noise = reading.sigma * np.random.default_rng(seed).normal(size=control.size)
    channels = (Channel("n", signal_unit("n"), "control"), Channel("u", signal_unit("u"), "measurement"))
    provenance = Provenance("simulated", "", {"reading": reading.name, "truth": truth, "seed": seed})
    measured = {"n": control, "u": simulated_speed(reading, truth, control) + noise}
    return make_record(STEP * np.arange(control.size), measured, channels, provenance, label)


def paper_posterior(reading: Reading, records: Sequence[Record], doubted: Prior | None) -> Posterior:
    """M-1, or M-0 with a prior of the doubted term."""
    model = reading.model(reading.doubted) if doubted is not None else reading.model()
    priors = {name: around(reading.truth[name]) for name in NAMES}
    priors |= {reading.doubted: doubted} if doubted is not None else {}
    parameters = [
        Parameter(term.text, model.unit_of(term), term.label, priors[term.text]) for term in model.coefficients
    ]
    parameters.append(Parameter("sigma_u", "m/s", r"\sigma_{u}", Uniform(0.0, 2 * reading.sigma)))
    start = [[reading.hull.trim["u"]]] * len(records)
    likelihood, data = output_error(model, records, ["u"], start)
    return Posterior(tuple(parameters), likelihood, data)


def around(value: float) -> Uniform:
    """Uniform about half a true value, 200 % of it to either side."""
    return Uniform(0.5 * value - 2 * abs(value), 0.5 * value + 2 * abs(value))


def wide(reading: Reading) -> Uniform:
    """Uninformative prior of the doubted term."""
    return Uniform(-reading.wide, reading.wide)
