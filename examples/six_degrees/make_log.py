"""A trial of a REMUS 100 in six degrees of freedom, as its log would show it: `python make_log.py FOLDER` writes FOLDER/dive.csv.

The vehicle is the catalogue's, with coefficients of its own; doublets of propeller, rudder and stern plane are spread over a minute.
"""

import csv
import sys
from pathlib import Path

import jax
import numpy as np

from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.catalogue import load_vehicle

STEP, DURATION = 0.1, 60.0
TRUTH = {
    **{"X_uabsu": -3.4, "T_nabsn": 6.9e-4},
    **{"Y_uv": -37.0, "Y_uudelta_r": 21.3, "N_uv": -14.0, "N_ur": -9.0, "N_uudelta_r": -14.6},
    **{"Z_uw": -37.0, "Z_uq": -10.6, "Z_uudelta_s": -21.3, "M_uw": 14.0, "M_uq": -9.0, "M_uudelta_s": -14.6},
}
"""What this vehicle has otherwise than the catalogue: more drag and thrust, and fins that make it stable without an autopilot."""
NOISE = {"u": 0.02, "v": 0.02, "w": 0.02, "q": 0.004, "r": 0.004, "theta": 0.004}
RPM, DEG = 2 * np.pi / 60, np.pi / 180


def main(folder: Path) -> None:
    """Simulate and write."""
    time, states, control = dive()
    noise = np.random.default_rng(7)
    columns = {
        "t": time,
        "rpm": control[:, 0] / RPM,
        "rudder_deg": control[:, 1] / DEG,
        "plane_deg": control[:, 2] / DEG,
    }
    for name, sd in NOISE.items():
        columns[name] = states[name] + sd * noise.normal(size=time.size)
    with (folder / "dive.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(np.round(column, 6) for column in columns.values()), strict=True))


def dive() -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Times, s, states by name and controls, SI."""
    vehicle = load_vehicle("remus100_hall_anstee")
    model, params = vehicle.build(attitude="euler"), {**vehicle.coefficients, **TRUTH}
    move = jax.jit(lambda state, control: rk4_step(lambda x: model.derivative(params, x, control), state, STEP / 5))
    state = (1.5, *np.zeros(len(model.states) - 1))
    states, controls = [], []
    time = np.arange(round(DURATION / STEP)) * STEP
    for t in time:
        control = (
            (1200 + 250 * doublet(t, 3, 16) - 200 * doublet(t, 40, 14)) * RPM,
            (6 * doublet(t, 12, 8) + 4 * doublet(t, 24, 3) - 8 * doublet(t, 44, 10)) * DEG,
            (3 * doublet(t, 5, 6) + 4 * doublet(t, 30, 4) - 3 * doublet(t, 50, 3)) * DEG,
        )
        states.append(state)
        controls.append(control)
        for _ in range(5):
            state = move(state, control)
    return time, dict(zip(model.states, np.array(states).T, strict=True)), np.array(controls)


def doublet(t: float, start: float, period: float) -> float:
    """1, then -1, then 0."""
    return float(0 <= t - start < period / 2) - float(period / 2 <= t - start < period)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
