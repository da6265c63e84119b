"""How a sweep of designs grows with the number of states, filters on scalars and on arrays, compilation counted apart."""

import time

import jax
import numpy as np
from timing import Row, alternate, row

from seatrial.design.sweep import Sweep, sweep_family
from seatrial.filters.belief import Filter
from seatrial.filters.square_root import LargeUnscentedKalmanFilter, SquareRootUnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle

TERMS = {
    "X_u": -1.2,
    "X_uabsu": -2.9,
    "T_nabsn": 6.3e-4,
    "X_u3": -0.1,
    "X_0": 0.1,
    "T_nu": -1e-4,
    "X_du3": -1.0,
    "X_u4": -0.01,
    "T_n2": 1e-6,
}
"""Coefficients in the order in which they are added, SI."""
HULL = Hull(name="benchmark", mass=30.48, fixed={"X_udot": -0.93}, thrust_deduction=0.1, trim={"u": 1.54, "n": 125.0})
FAMILY = Family("n", 125.0, duration=60.0, active=40.0, sample_time=0.1)
AMPLITUDES, PERIODS = np.linspace(5.0, 30.0, 10), np.linspace(3.0, 20.0, 16)
ON_SCALARS, ON_ARRAYS = (4, 6, 8), (4, 6, 8, 10)
"""States: the speed and its coefficients. Ten on scalars take minutes to compile."""


def seconds(cores: int) -> list[Row]:
    """160 doublets over 600 samples."""
    jax.config.update("jax_enable_compilation_cache", False)
    group, gains, found = "sweep of 160 doublets, 600 samples", {}, []
    forms = (
        ("scalars", ON_SCALARS, SquareRootUnscentedKalmanFilter()),
        ("arrays", ON_ARRAYS, LargeUnscentedKalmanFilter()),
    )
    for form, sizes, method in forms:
        for states in sizes:
            space = space_of(states)
            start = time.perf_counter()
            gain = sweep(space, method).gain
            first = time.perf_counter() - start
            assert np.allclose(gain, gains.setdefault(states, gain), rtol=0, atol=1e-8)
            times = alternate({"": lambda space=space, method=method: sweep(space, method)}, 3)[""]
            found.append(Row(group, f"{states:2} states on {form}, compiling", cores, "s", first, first))
            found.append(row(group, f"{states:2} states on {form}", cores, "s", times, 1.0))
    return found


def space_of(states: int) -> StateSpace:
    """Surge with so many states, coefficients known to a fifth."""
    model = whole_vehicle(HULL, list(TERMS)[: states - 1], moves=("u",))
    mean = np.array([TERMS[term.text] for term in model.coefficients])
    scales = 0.2 * np.abs(mean)
    belief = Gaussian(np.concatenate([[HULL.trim["u"]], mean / scales]), np.eye(states))
    return discretise(model, ("u",), belief, np.zeros(states), np.array([0.05]), scales.tolist())


def sweep(space: StateSpace, method: Filter) -> Sweep:
    """All designs."""
    return sweep_family(space, FAMILY, AMPLITUDES, PERIODS, method=method)
