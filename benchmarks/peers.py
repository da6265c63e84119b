"""What people use today on the same model: filterpy's filter, a plain Python loop, and scipy's integrator."""

import jax.numpy as jnp
import numpy as np
from problems import ENTRY, MASS, SCALES, SHARE, STEP, family, grid, state_space, trial, vehicle
from scipy.integrate import solve_ivp
from timing import Ratio, Row, agree, alternate, row

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
    """Filterpy's unscented filter against one lane of ours and against a lane of the sweep."""
    n, peer_steps, space = 3_000, 300, state_space()
    control = trial(n).control
    scales = np.array([1.0, 1.0, SCALES["T_nabsn"]])
    speed = [float(space.initial.mean[0])]
    for c in control[:-1, 0]:
        speed.append(rk4(speed[-1], c, *MEANS))
    measured = np.array([[u, rate(u, c, *MEANS)] for u, c in zip(speed, control[:, 0], strict=True)])

    def peer() -> np.ndarray:
        found = _filterpy(space, scales)
        for c, y in zip(control[:peer_steps, 0], measured[:peer_steps], strict=True):
            found.predict(control=c)
            found.update(y, control=c)
        return np.sqrt(np.diag(found.P))

    def ours() -> np.ndarray:
        trace = run_filter(
            UnscentedKalmanFilter(), space, jnp.asarray(control), jnp.asarray(measured), jnp.full(n, STEP)
        )
        return np.asarray(trace.sds)[peer_steps - 1]

    agree("standard deviations of seatrial and filterpy", ours(), peer(), 0.02, relative=True)
    doublets, designs = family(1_500), grid(20, 20, 5.0)
    seconds = alternate({"ours": ours, "peer": peer}, 5)
    lane = alternate({"": lambda: sweep_family(space, doublets, *designs)}, 5)[""] / (400 * 1_500)
    return [
        row(FILTER, "seatrial, covariance form, whole trace", cores, US, seconds["ours"], 1e-6 * n),
        row(FILTER, "seatrial, square root, in a sweep of 400", cores, US, lane, 1e-6),
        row(FILTER, "filterpy UnscentedKalmanFilter", cores, US, seconds["peer"], 1e-6 * peer_steps),
        Ratio(
            FILTER,
            "filterpy / lane of our sweep",
            cores,
            seconds["peer"].min() / peer_steps / lane.min(),
            at_least=1_000,
        ),
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
    return [
        row(SIMULATION, "seatrial", cores, US, seconds["ours"], 1e-6 * n),
        row(SIMULATION, "plain Python loop", cores, US, seconds["loop"], 1e-6 * n),
        row(SIMULATION, "scipy solve_ivp, each held input", cores, US, seconds["scipy"], 1e-6 * n / 10),
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
