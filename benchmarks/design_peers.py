"""D-optimal free-form input, 60 intervals, 60 s at 100 Hz: ours, a plain SciPy script, and Pyomo.DoE, by time and by what is reached.

All begin at the same random binary levels; ours also from the doublets of 10 and 20 s. What each reaches is judged by the
information at every sample: half the log-determinant for X_u, X_uabsu and 100 T, thrust in N/(rev/s)^2. The script is what a user
writes in an afternoon: a loop of RK4, forward differences for sensitivities and for the gradient, SLSQP; it is stopped after a
while and its best so far is taken.
"""

import time
from importlib.metadata import version

import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize
from timing import Ratio, Row, alternate, row
from tools import ask

from seatrial.design.free_form import design_free_form
from seatrial.design.free_form_problem import FreeFormProblem
from seatrial.design.trial_plan import plan_trial
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.free_form import SteppedInput
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.linearise import trim_speed
from seatrial.vehicles.whole import whole_vehicle

GROUP = "D-optimal free form, 60 intervals, 6 000 steps"
CAP = 100.0
"""Seconds after which a peer is stopped."""
GRID = 600
"""Points of Pyomo.DoE's discretised model."""
SAMPLES, STEP, SIZE, SIGMA, MASS, SHARE = 6000, 0.01, 60, 0.0757, 31.4, 0.9
RAD = 2 * np.pi
TRIM, AMPLITUDE = 12.5 * RAD, 200 / 60 * RAD
UNITS = np.array([1.0, 1.0, 1e-2 / RAD**2])
"""SI value of one printed unit of each coefficient."""
VALUES = np.array([-1.21, -2.93, 6.28]) * UNITS
WIDE = 1e4
"""Prior standard deviation in printed units: as good as none."""
LIMITS = Limits(TRIM - AMPLITUDE, TRIM + AMPLITUDE)


def reached(cores: int) -> list[Row | Ratio]:
    """Return seconds, of ours with and without what is compiled, and half the log-determinant, also of doublets of 10 and 20 s."""
    problem = golden()
    start = TRIM + AMPLITUDE * np.where(np.random.default_rng(0).random(SIZE) < 0.5, -1.0, 1.0)
    sides = {half: TRIM + AMPLITUDE * (1.0 - 2.0 * (np.arange(SIZE) // half % 2)) for half in (5, 10)}
    starts = {"the same": start, **{f"doublets of {2 * half} s": levels for half, levels in sides.items()}}
    begin = time.perf_counter()
    ours = design_free_form(problem, starts)
    first, alone = time.perf_counter() - begin, design_free_form(problem, {"the same": start})
    seconds = alternate(
        {
            "all": lambda: design_free_form(problem, starts),
            "one": lambda: design_free_form(problem, {"the same": start}),
        },
        3,
    )
    script, script_seconds, script_status = plain_script(problem, start)
    question = {
        "grid": GRID,
        "levels": start.tolist(),
        "duration": SAMPLES * STEP,
        "limits": [LIMITS.lower, LIMITS.upper],
        "coefficients": VALUES.tolist(),
        "share": SHARE,
        "mass": MASS,
        "start": float(problem.plan.start[0]),
        "sd": SIGMA * (GRID / SAMPLES) ** 0.5,
        "cap": CAP,
        "prior_sd": (WIDE * UNITS).tolist(),
    }
    pyomo = ask("peer_pyomo.py", question, {})
    took = {
        "seatrial, 3 starts": (seconds["all"], ours.levels, "s"),
        "seatrial, the start of the others": (seconds["one"], alone.levels, "s"),
        f"SciPy {version('scipy')} script, {script_status}": (np.array([script_seconds]), script, "s"),
        f"{pyomo['name']}, {GRID} points, {pyomo['status']}": (
            np.array([pyomo["seconds"]]),
            np.array(pyomo["levels"]),
            "s",
        ),
    }
    gains = {name: half_log_det(problem, held(levels)) for name, (_, levels, _) in took.items()}
    rows = [row(GROUP, name, cores, unit, times, 1.0) for name, (times, _, unit) in took.items()]
    rows.insert(2, Row(GROUP, "seatrial, 3 starts, first run in a process", cores, "s", first, first))
    for period in (10.0, 20.0):
        doublets = Family("n", TRIM, duration=60.0, active=40.0, sample_time=STEP).manoeuvre(AMPLITUDE, period)
        gains[f"doublets of {period:g} s"] = half_log_det(problem, doublets.sample(STEP)[1])
    rows += [Row(GROUP, name, cores, "half log-determinant", gain, gain) for name, gain in gains.items()]
    peer_seconds = {name: times.min() for name, (times, _, _) in took.items() if not name.startswith("seatrial")}
    lead = gains["seatrial, 3 starts"]
    others = max(gain for name, gain in gains.items() if name in peer_seconds)
    return [
        *rows,
        *(
            Ratio(GROUP, f"{name.split(',')[0]} / seatrial, 3 starts, first run", cores, taken / first, at_least=1)
            for name, taken in peer_seconds.items()
        ),
        Ratio(GROUP, "seatrial, 3 starts, s", cores, seconds["all"].min(), at_most=20),
        Ratio(GROUP, "above doublets of 20 s, nats", cores, lead - gains["doublets of 20 s"], at_least=0.39),
        Ratio(GROUP, "above the better peer, nats", cores, lead - others, at_least=0),
    ]


def golden() -> FreeFormProblem:
    """The paper's surge vehicle at 750 rpm, 200 rpm either way, speed measured."""
    model = whole_vehicle(
        Hull("paper", 30.47, thrust_deduction=1 - SHARE, fixed={"X_udot": 30.47 - MASS}),
        ("X_u", "X_uabsu", "T_nabsn"),
        moves=("u",),
    )
    speed = trim_speed(model, dict(zip(("X_u", "X_uabsu", "T_nabsn"), VALUES, strict=True)), [TRIM])
    plan = plan_trial(model, [speed], {"u": SIGMA}, SAMPLES, STEP)
    form = SteppedInput("n", TRIM, SAMPLES * STEP, 0.0, SAMPLES * STEP, SIZE)
    return FreeFormProblem(plan, form, LIMITS, VALUES[None], np.diag((WIDE * UNITS) ** 2))


def half_log_det(problem: FreeFormProblem, control: np.ndarray) -> float:
    """Of the information at every sample, in printed units."""
    seen = np.asarray(problem.plan.information(jnp.asarray(VALUES), jnp.asarray(control)[:, None]))
    return float(0.5 * np.linalg.slogdet(seen * np.outer(UNITS, UNITS))[1])


def held(levels: np.ndarray) -> np.ndarray:
    """Levels held over their intervals, at every sample."""
    return np.repeat(levels, SAMPLES // SIZE)


class _Stopped(Exception):
    pass


def plain_script(problem: FreeFormProblem, start: np.ndarray) -> tuple[np.ndarray, float, str]:
    """Levels, seconds and how it ended."""
    began, best = time.perf_counter(), [np.inf, start]
    initial, scale = float(problem.plan.start[0]), np.abs(VALUES)

    def speed(coefficients: np.ndarray, control: list[float]) -> np.ndarray:
        x_u, x_uu, thrust = coefficients.tolist()
        u, found = initial, []
        for c in control:
            push = SHARE * thrust * c * abs(c)
            found.append(u)
            k1 = (x_u * u + x_uu * u * abs(u) + push) / MASS
            v = u + 0.5 * STEP * k1
            k2 = (x_u * v + x_uu * v * abs(v) + push) / MASS
            v = u + 0.5 * STEP * k2
            k3 = (x_u * v + x_uu * v * abs(v) + push) / MASS
            v = u + STEP * k3
            k4 = (x_u * v + x_uu * v * abs(v) + push) / MASS
            u += STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
        return np.array(found)

    def cost(x: np.ndarray) -> float:
        if time.perf_counter() - began > CAP:
            raise _Stopped
        levels = TRIM + AMPLITUDE * x
        control = held(levels).tolist()
        middle, size = speed(VALUES, control), 1e-5 * scale
        slopes = [(speed(VALUES + step, control) - middle) / step.max() for step in np.diag(size)]
        seen = np.array(slopes) * UNITS[:, None] / SIGMA
        value = -0.5 * float(np.linalg.slogdet(seen @ seen.T + np.eye(3) / WIDE**2)[1])
        if value < best[0]:
            best[:] = value, levels
        return value

    try:
        found = minimize(
            cost, (start - TRIM) / AMPLITUDE, method="SLSQP", bounds=[(-1.0, 1.0)] * SIZE, options={"eps": 1e-3}
        )
        status = f"{found.nit} steps"
    except _Stopped:
        status = f"stopped at {CAP:g} s"
    return best[1], time.perf_counter() - began, status
