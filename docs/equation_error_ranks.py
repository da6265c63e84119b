"""Calibration of equation error: is the refined regression's normal approximation right about the truth?"""

import jax.numpy as jnp
import numpy as np
from scipy import stats

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.diagnostics.calibration import DRAWS, Calibration
from seatrial.estimation.regression.equation_error import fit_equation_error, measured_accelerations
from seatrial.vehicles.catalogue import load_surge
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle

STEP, SAMPLES = 0.1, 600
NOISE = {"u": 0.05, "udot": 0.05}
PRIORS = {"X_u": (-1.2, 0.4), "X_uabsu": (-3.0, 0.3), "T_nabsn": (6.3e-4, 0.4e-4)}
"""Means and standard deviations of normal priors from which truths are drawn."""
CHANNELS = (
    Channel("n", "rad/s", "control"),
    Channel("u", "m/s", "measurement"),
    Channel("udot", "m/s^2", "measurement"),
)


def equation_error_ranks(replicates: int) -> Calibration:
    """Place of the truth in the normal distribution that each regression states, in hundredths."""
    entry, random = load_surge("remus100_surge"), np.random.default_rng(11)
    model = whole_vehicle(entry.hull, list(PRIORS), moves=("u",))
    means, sds = np.array(list(PRIORS.values())).T
    time = np.arange(SAMPLES) * STEP
    control = entry.hull.trim["n"] + 20.0 * np.where(time % 10 < 5, 1.0, -1.0) * (time > 1)
    step, start = jnp.full(SAMPLES, STEP), jnp.array([entry.hull.trim["u"]])
    ranks = []
    for _ in range(replicates):
        truth = random.normal(means, sds)
        params = dict(zip(PRIORS, map(float, truth), strict=True))
        speed = np.asarray(simulate(model, params, jnp.asarray(control[:, None]), step, start))[:, 0]
        rate = np.asarray(model.derivative(params, (speed,), (control,))[0])
        noisy = {
            "n": control,
            "u": speed + NOISE["u"] * random.normal(size=SAMPLES),
            "udot": rate + NOISE["udot"] * random.normal(size=SAMPLES),
        }
        record = make_record(time, noisy, CHANNELS, Provenance("calibration", "0" * 64))
        fit = fit_equation_error(model, [measured_accelerations(model, record)])
        ranks.append(np.floor((DRAWS + 1) * stats.norm.cdf((truth - fit.values) / fit.sd)))
    return Calibration(tuple(PRIORS), np.clip(np.array(ranks, int), 0, DRAWS))
