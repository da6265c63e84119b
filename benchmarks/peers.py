"""What people use today on the same model: filters of filterpy and dynamax, a plain Python loop, and scipy's integrator."""

from importlib.metadata import version

import jax.numpy as jnp
import numpy as np
from problems import ENTRY, MASS, SCALES, SHARE, STEP, family, grid, state_space, trial, vehicle
from scipy.integrate import solve_ivp
from timing import Ratio, Row, agree, alternate, processor_seconds, row
from tools import ask

from seatrial.design.sweep import sweep_family
from seatrial.filters.run import run_filter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.vehicles.simulate import simulate

US = "us per step"
FILTER, SIMULATION = "unscented filter, one lane", "surge simulation, one lane"
MEANS = np.array(list(ENTRY.coefficients.values()))


def rate(u: float, control: float, x_u: float, x_uu: float, thrust: float) -> float:
    """Return du/dt, written out."""
    return (x_u * u + x_uu * u * abs(u) + SHARE * thrust * control * abs(control)) / MASS


def rk4(u: float, control: float, *coefficients: float) -> float:
    """One classical Runge-Kutta step."""
    k1 = rate(u, control, *coefficients)
    k2 = rate(u + 0.5 * STEP * k1, control, *coefficients)
    k3 = rate(u + 0.5 * STEP * k2, control, *coefficients)
    k4 = rate(u + STEP * k3, control, *coefficients)
    return u + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def filters(cores: int) -> list[Row | Ratio]:
    """Return processor seconds of filterpy's and dynamax's unscented filters, of one lane of ours and of a lane of the sweep."""
    n, peer_steps, space = 3_000, 300, state_space()
    control = trial(n).control
    scales = np.array([1.0, 1.0, SCALES["T_nabsn"]])
    speed = [float(space.initial.mean[0])]
    for c in control[:-1, 0]:
        speed.append(rk4(speed[-1], c, *MEANS))
    measured = np.array([[u, rate(u, c, *MEANS)] for u, c in zip(speed, control[:, 0], strict=True)])

    def filterpy() -> np.ndarray:
        found = _filterpy(space, scales)
        for c, y in zip(control[:peer_steps, 0], measured[:peer_steps], strict=True):
            found.predict(control=c)
            found.update(y, control=c)
        return np.sqrt(np.diag(found.P))

    def ours() -> np.ndarray:
        trace = run_filter(
            UnscentedKalmanFilter(), space, jnp.asarray(control), jnp.asarray(measured), jnp.full(n, STEP)
        )
        return np.stack([trace.means, trace.sds])

    (means, sds), first, again = processor_seconds(ours, 5)
    peer_sds, _, peer_again = processor_seconds(filterpy, 5)
    agree("standard deviations of seatrial and filterpy", sds[peer_steps - 1], peer_sds, 0.02, relative=True)
    arrays = {"control": control[:, 0], "measured": measured, "mean": space.initial.mean, "cov": space.initial.cov}
    arrays |= {"process_sd": space.process_sd, "measurement_sd": space.measurement_sd, "scales": scales}
    numbers = {"step": STEP, "mass": MASS, "share": SHARE, "lanes": 400, "lane_samples": 1_500}
    found = ask("peer_dynamax.py", {name: np.asarray(a).tolist() for name, a in arrays.items()} | numbers, {})
    agree("standard deviations of seatrial and dynamax", sds, np.array(found["sds"]), 1e-5, relative=True)
    agree("means of seatrial and dynamax, in deviations,", means / sds, np.array(found["means"]) / sds, 1e-5)
    doublets, designs = family(1_500), grid(20, 20, 5.0)
    _, _, lane = processor_seconds(lambda: sweep_family(space, doublets, *designs), 5)
    steps, dynamax = 400 * 1_500, f"dynamax {found['version']}"
    filterpy_name, mapped = f"filterpy {version('filterpy')}", np.array(found["mapped"]) / steps
    rates = {
        "seatrial, covariance form, whole trace": again / n,
        "seatrial, square root, in a sweep of 400": lane / steps,
        f"{filterpy_name} UnscentedKalmanFilter": peer_again / peer_steps,
        f"{dynamax} unscented_kalman_filter": np.array(found["again"]) / n,
        f"{dynamax}, 400 records mapped": mapped,
    }
    best = {name: rate.min() for name, rate in rates.items()}
    one, swept, loop, compiled, _ = best.values()
    return [
        *(row(FILTER, name, cores, US, rate, 1e-6) for name, rate in rates.items()),
        Row(FILTER, "seatrial, first run in a process", cores, "processor s", first, first),
        Row(FILTER, f"{dynamax}, first run in a process", cores, "processor s", found["first"], found["first"]),
        Ratio(FILTER, f"{filterpy_name} / lane of our sweep", cores, loop / swept, at_least=1_000),
        Ratio(FILTER, f"{dynamax} / our one lane", cores, compiled / one, at_least=1),
        Ratio(FILTER, f"{dynamax}, mapped / lane of our sweep", cores, mapped.min() / swept, at_least=1),
        Ratio(FILTER, f"{dynamax} / ours, first run", cores, found["first"] / first, at_least=1),
    ]


def simulation(cores: int) -> list[Row | Ratio]:
    """One trajectory: ours, a plain loop, and scipy over each interval of constant input."""
    n, model = 1_500, vehicle()
    control, start = trial(n).control, state_space().initial.mean[:1]

    def ours() -> np.ndarray:
        return np.asarray(simulate(model, ENTRY.coefficients, jnp.asarray(control), jnp.full(n, STEP), start))[:, 0]

    def loop() -> np.ndarray:
        speed = [float(start[0])]
        for c in control[:-1, 0].tolist():
            speed.append(rk4(speed[-1], c, *MEANS.tolist()))
        return np.array(speed)

    def scipy_segments() -> np.ndarray:
        speed = [float(start[0])]
        for c in control[: n // 10 - 1, 0].tolist():
            found = solve_ivp(
                lambda t, u, c=c: [rate(u[0], c, *MEANS)], (0.0, STEP), [speed[-1]], rtol=1e-8, atol=1e-10
            )
            speed.append(float(found.y[0, -1]))
        return np.array(speed)

    agree("speeds of seatrial and the plain loop", ours(), loop(), 1e-12)
    agree("speeds of seatrial and scipy", ours()[: n // 10], scipy_segments(), 1e-8)
    seconds = alternate({"ours": ours, "loop": loop, "scipy": scipy_segments}, 5)
    best, scipy_name = {name: taken.min() for name, taken in seconds.items()}, f"SciPy {version('scipy')} solve_ivp"
    return [
        row(SIMULATION, "seatrial", cores, US, seconds["ours"], 1e-6 * n),
        row(SIMULATION, "plain Python loop", cores, US, seconds["loop"], 1e-6 * n),
        row(SIMULATION, f"{scipy_name}, each held input", cores, US, seconds["scipy"], 1e-6 * n / 10),
        Ratio(SIMULATION, "plain Python loop / seatrial", cores, best["loop"] / best["ours"], at_least=1),
        Ratio(SIMULATION, f"{scipy_name} / seatrial", cores, 10 * best["scipy"] / best["ours"], at_least=1),
    ]


def _filterpy(space, scales: np.ndarray):
    """Filterpy's filter of the same model, prior and noise; it does not redraw its points before an update."""
    from filterpy.kalman import MerweScaledSigmaPoints
    from filterpy.kalman import UnscentedKalmanFilter as Peer

    found = Peer(
        4,
        2,
        STEP,
        fx=lambda x, dt, control: np.array([rk4(x[0], control, *(x[1:] * scales)), *x[1:]]),
        hx=lambda x, control: np.array([x[0], rate(x[0], control, *(x[1:] * scales))]),
        points=MerweScaledSigmaPoints(4, 1.0, 2.0, 0.0),
    )
    found.x, found.P = np.array(space.initial.mean), np.array(space.initial.cov)
    found.Q, found.R = np.diag(np.array(space.process_sd) ** 2), np.diag(np.array(space.measurement_sd) ** 2)
    return found
