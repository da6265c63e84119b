"""The surge trial that the filter tests share: noisy data, the state space, and the same problem for the textbook.

The linear drag is known, so that three states are left and the filters compile quickly.
"""

import numpy as np

from seatrial.numerics.gaussian import independent
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import DEDUCTION, SCALES, THRUST, U0, X_U, X_UU, naive_rk4, surge_rate
from tests.filters.textbook import Problem

N_SAMPLES = 120
HULL = Hull("known linear drag", 30.47, thrust_deduction=DEDUCTION, fixed={"X_udot": -0.93, "X_u": X_U})
MODEL = whole_vehicle(HULL, ("X_uabsu", "T_nabsn"), moves=("u",))
TRUE_STATE = np.array([U0, X_UU, THRUST])
MEAN = TRUE_STATE * [1.0, 0.75, 0.75]
SD = np.array([0.1, 1.5, 0.03])
PROCESS_SD = np.array([0.003, 1e-3, 1e-5])
MEASUREMENT_SD = np.array([0.02, 0.05])


def surge_trial(seed=0):
    """Control, measurement of u and udot, and uneven steps; shape (n, 1), (n, 2), (n,)."""
    rng = np.random.default_rng(seed)
    rev_per_s = np.repeat(rng.uniform(8, 17, N_SAMPLES // 10), 10)
    step, u, measured = rng.uniform(0.05, 0.15, N_SAMPLES), U0, []
    for n, h in zip(rev_per_s, step, strict=True):
        measured.append(np.array([u, surge_rate(u, n)]) + MEASUREMENT_SD * rng.normal(size=2))
        u = naive_rk4(lambda x, n=n: surge_rate(x, n), u, h) + PROCESS_SD[0] * rng.normal()
    return 2 * np.pi * rev_per_s[:, None], np.array(measured), step


def surge_space(mean=MEAN, sd=SD, process_sd=PROCESS_SD, measurement_sd=MEASUREMENT_SD, **options) -> StateSpace:
    return discretise(MODEL, ("u", "udot"), independent(mean, sd), process_sd, measurement_sd, SCALES[1:], **options)


def surge_problem(mean=MEAN, sd=SD) -> Problem:
    """The problem of `surge_space`, written out by hand."""

    def transition(x, control, h):
        return np.array([naive_rk4(lambda u: surge_rate(u, control[0] / (2 * np.pi), X_U, *x[1:]), x[0], h), *x[1:]])

    def observe(x, control):
        return np.array([x[0], surge_rate(x[0], control[0] / (2 * np.pi), X_U, *x[1:])])

    return Problem(mean, np.diag(sd**2), transition, observe, np.diag(PROCESS_SD**2), np.diag(MEASUREMENT_SD**2))


GAPS = {
    "complete": lambda y: y,
    "one channel never": lambda y: np.where([True, False], y, np.nan),
    "two rates": lambda y: np.where(np.arange(len(y))[:, None] % np.array([4, 3]) == 0, y, np.nan),
    "long gap": lambda y: np.where((np.arange(len(y))[:, None] // 20) % 2 == 0, y, np.nan),
    "ends unmeasured": lambda y: np.where(abs(np.arange(len(y))[:, None] / len(y) - 0.4) < 0.35, y, np.nan),
}
"""Ways in which measurements go missing."""
