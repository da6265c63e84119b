"""The mode of a whole vehicle by filter error: eight states, two disturbances, fifteen coefficients, two minutes at 10 Hz.

Processor seconds: the first time in a process, with what it compiles or loads, and again.
"""

import time

import numpy as np
from timing import Row

import seatrial as st
from seatrial.estimation.posterior.posterior import Posterior

FREE = {
    **{"X_uabsu": -3.4, "T_nabsn": 6.9e-4, "K_pabsp": -0.13},
    **{"Y_uv": -37.0, "Y_ur": 5.22, "Y_uudelta_r": 21.3, "N_uv": -14.0, "N_ur": -9.0, "N_uudelta_r": -14.6},
    **{"Z_uw": -37.0, "Z_uq": -10.6, "Z_uudelta_s": -21.3, "M_uw": 14.0, "M_uq": -9.0, "M_uudelta_s": -14.6},
}
"""Coefficients that are sought, and their true values, SI."""
NOISE = {"u": 0.02, "v": 0.02, "w": 0.02, "p": 0.004, "q": 0.004, "r": 0.004, "phi": 0.004, "theta": 0.004}
PUSHES = {"disturbance_X": 1.0, "disturbance_time_X": 3.0, "disturbance_N": 1.0, "disturbance_time_N": 3.0}
SAMPLES, STEP = 1200, 0.1
RPM, DEG = 2 * np.pi / 60, np.pi / 180


def seconds(cores: int) -> list[Row]:
    """Mode and standard deviations."""
    st.configure()
    posterior, group = problem(), "mode of a whole vehicle by filter error"
    found = []
    for turn in ("first in a process", "again"):
        start = time.process_time()
        st.find_mode(posterior)
        spent = time.process_time() - start
        found.append(Row(group, turn, cores, "processor s", spent, spent))
    return found


def problem() -> Posterior:
    """Return the posterior of a simulated trial."""
    model = st.load_vehicle("remus100_hall_anstee").build(free=list(FREE), attitude="euler")
    time_of = np.arange(SAMPLES) * STEP
    propeller = 250 * doublets(time_of, (3, 60), 16) - 200 * doublets(time_of, (40, 100), 14)
    rudder = 6 * doublets(time_of, (12, 75), 9) - 8 * doublets(time_of, (44,), 10)
    plane = 3 * doublets(time_of, (5, 85), 6) + 4 * doublets(time_of, (30,), 4)
    controls = {"n": (1200 + propeller) * RPM, "delta_r": rudder * DEG, "delta_s": plane * DEG}
    sigmas = {f"sigma_{channel}": sd for channel, sd in NOISE.items()}
    still = dict.fromkeys("vwpqr", 0.0)
    schedule = st.Schedule(time_of, controls)
    record = st.simulate(model, FREE | sigmas | PUSHES, schedule, list(NOISE), start={"u": 1.5, **still}, key=1)
    priors = {name: st.Normal(1.05 * value, 0.2 * abs(value)) for name, value in FREE.items()}
    scales = {name: st.LogUniform(value / 30, value * 30) for name, value in (sigmas | PUSHES).items()}
    return st.make_posterior(model, record, priors | scales)


def doublets(time_of: np.ndarray, starts: tuple[float, ...], period: float) -> np.ndarray:
    """Sum of doublets: 1 for half a period, then -1, then 0."""
    since = np.subtract.outer(time_of, starts)
    first, second = (since >= 0) & (since < period / 2), (since >= period / 2) & (since < period)
    return (first.astype(float) - second).sum(1)


if __name__ == "__main__":
    for found in seconds(1):
        print(found)
