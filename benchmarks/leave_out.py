"""Leave-one-run-out of ten runs against one fit of all of them: `python benchmarks/leave_out.py`.

Runs of a minute at 10 Hz of a vehicle that moves along its keel, three coefficients. Processor seconds of one process, the first time, with
what it compiles or loads, and again. The goal is that leaving out takes less than twice the fit.
"""

import time

import numpy as np

import seatrial as st
from seatrial.selection.leave_one_run_out import leave_one_run_out
from seatrial.vehicles.model import VehicleModel

TRUTH = {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.02}
RUNS, SAMPLES, STEP, HOLD = 10, 600, 0.1, 40


def main() -> None:
    """Print what a fit takes, what leaving out takes, and their ratio."""
    st.configure()
    model = st.load_vehicle("remus100_surge").build(free=[name for name in TRUTH if name != "sigma_u"])
    priors = {"X_u": st.Normal(-1.2, 1.5), "X_uabsu": st.Normal(-3.0, 3.0), "T_nabsn": st.Normal(6e-4, 3e-4)}
    posterior = st.make_posterior(model, runs(model), priors | {"sigma_u": st.LogUniform(0.002, 0.5)})
    for turn in ("first in a process", "again"):
        begun = time.process_time()
        mode = st.find_mode(posterior)
        fitted = time.process_time()
        leave_one_run_out(posterior, mode=mode)
        fit, left = fitted - begun, time.process_time() - fitted
        print(f"{turn}: fit {fit:.2f} s, leaving out {RUNS} runs {left:.2f} s, {left / fit:.1f} times the fit")


def runs(model: VehicleModel) -> list[st.Record]:
    """Return simulated runs, each with steps of the propeller of its own."""
    found = []
    for number in range(RUNS):
        levels = np.random.default_rng(number).uniform(65.0, 185.0, SAMPLES // HOLD)
        schedule = st.Schedule(np.arange(SAMPLES) * STEP, {"n": np.repeat(levels, HOLD)})
        found.append(st.simulate(model, TRUTH, schedule, ["u"], start={"u": 1.5}, key=number, label=f"run {number}"))
    return found


if __name__ == "__main__":
    main()
