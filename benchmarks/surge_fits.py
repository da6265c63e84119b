"""A surge model fitted to the log of the paper's trial, 60 s at 100 Hz: our mode with its standard deviations, MuJoCo's, PySINDy's.

MuJoCo maximises the same likelihood, so that coefficients and standard deviations must agree. PySINDy fits derivatives, which are noisy
here: its simulated speed must, and how far its coefficients are from the most likely ones is in its row.
"""

import jax
import numpy as np
from paper_problem import Problem, paper_problem
from timing import Ratio, Row, agree, processor_seconds, row
from tools import ask, later_process

import seatrial as st
from seatrial.estimation.posterior.mode import find_mode
from studies.remus100.reading import READINGS
from studies.remus100.trial import simulated_speed

GROUP, UNIT = "surge fit, 6 000 samples", "processor s"
AGREED = 0.02
"""Standard deviations by which the coefficients of one likelihood may differ, and share by which the deviations may."""
SPEED_AGREED = 0.01
"""Root mean square by which simulated speeds may differ where another error is minimised, m/s."""


def seconds(cores: int) -> list[Row | Ratio]:
    """Return processor seconds of all three: again, the first time in a process, and for ours with programs that another process kept."""
    problem = paper_problem()
    mode, first, again = processor_seconds(lambda: find_mode(problem.posterior, key=jax.random.key(0)), 5)
    kept = later_process("surge_fits.py")
    names, values, sd = problem.posterior.names[:3], mode.values[:3], mode.sd[:3]
    mujoco, sindy = (
        ask(script, problem.plain | {"names": names}, {}) for script in ("peer_mujoco.py", "peer_sindy.py")
    )
    agree("coefficients of seatrial and MuJoCo, in deviations,", values / sd, np.array(mujoco["values"]) / sd, AGREED)
    agree("standard deviations of seatrial and MuJoCo", sd, np.array(mujoco["half_widths"]) / 1.96, AGREED, True)
    speeds = [_speed(problem, dict(zip(names, x, strict=True))) for x in (values, sindy["values"])]
    apart = float(np.sqrt(np.mean((speeds[0] - speeds[1]) ** 2)))
    agree("speeds of seatrial and PySINDy", np.zeros(1), np.array([apart]), SPEED_AGREED)
    off = float(np.max(np.abs(np.array(sindy["values"]) - values) / sd))
    peers = {
        f"MuJoCo {mujoco['version']} sysid": mujoco,
        f"PySINDy {sindy['version']}, coefficients {off:.1f} sd off": sindy,
    }
    rows = [row(GROUP, "seatrial, mode", cores, UNIT, again, 1.0)]
    rows += [row(GROUP, name, cores, UNIT, np.array(peer["again"]), 1.0) for name, peer in peers.items()]
    rows.append(Row(GROUP, "seatrial, mode, first run", cores, UNIT, first, first))
    rows.append(Row(GROUP, "seatrial, mode, first run in a later process", cores, UNIT, kept, kept))
    rows += [Row(GROUP, f"{name}, first run", cores, UNIT, one["first"], one["first"]) for name, one in peers.items()]
    ratios = []
    for name, peer in peers.items():
        what = f"{name.split(',')[0]} / seatrial"
        ratios.append(Ratio(GROUP, what, cores, min(peer["again"]) / again.min(), at_least=1))
        ratios.append(Ratio(GROUP, f"{what}, first run", cores, peer["first"] / first, at_least=1))
        ratios.append(Ratio(GROUP, f"{what}, later process", cores, peer["first"] / kept, at_least=1))
    return [*rows, *ratios]


def _speed(problem: Problem, coefficients: dict[str, float]) -> np.ndarray:
    return simulated_speed(READINGS["A"], coefficients, problem.control)


def main() -> None:
    """Print the processor seconds of one mode."""
    st.configure()
    problem = paper_problem()
    print(processor_seconds(lambda: find_mode(problem.posterior, key=jax.random.key(0)), 0)[1])


if __name__ == "__main__":
    main()
