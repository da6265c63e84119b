"""Section II: the longitudinal vehicle, its linearisation about level flight, and the surge model that is its restriction."""

import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.vehicles.catalogue import load_longitudinal, load_surge
from seatrial.vehicles.linearise import linearise
from seatrial.vehicles.longitudinal import longitudinal_vehicle, surge_restriction
from seatrial.vehicles.simulate import simulate
from studies.remus100.study import Study
from studies.remus100.vehicle_file import RPM

STEP, N, CHANGE = 0.01, 1000, 50 * RPM
"""10 s after the propeller speed rose by 50 rpm."""


def vehicle_part(study: Study) -> xr.Dataset:
    """Linear model of the published REMUS 100, and its answer to a step of n beside the non-linear and the surge model's."""
    entry = load_longitudinal("remus100_longitudinal")
    hull, values = entry.hull, entry.coefficients
    model = longitudinal_vehicle(hull, tuple(values))
    surge = surge_restriction(hull, tuple(values))
    state = np.array([hull.trim.get(name, 0.0) for name in model.states])
    control = np.array([hull.trim[name] for name in model.controls])
    a, b = map(np.asarray, linearise(model, values, state, control))
    pushed = control + CHANGE * np.array([name == "n" for name in model.controls])
    steps, held = jnp.full(N, STEP), jnp.tile(jnp.asarray(pushed), (N, 1))
    full = np.asarray(simulate(model, values, held, steps, jnp.asarray(state)))
    linear = [np.zeros(len(state))]
    transition, forced = _discrete(a, b @ (pushed - control))
    for _ in range(N - 1):
        linear.append(transition @ linear[-1] + forced)
    surge_values = {term.text: values[term.text] for term in surge.coefficients}
    alone = np.asarray(simulate(surge, surge_values, held[:, :1], steps, jnp.asarray(state[:1])))
    published = load_surge("remus100_surge")
    return xr.Dataset(
        {
            "a": (("state", "by_state"), a),
            "b": (("state", "control"), b),
            "trim": ("state", state),
            "eigenvalues": (("mode", "part"), np.column_stack([np.linalg.eigvals(a).real, np.linalg.eigvals(a).imag])),
            "full": (("time", "state"), full),
            "linear": (("time", "state"), state + np.array(linear)),
            "surge": ("time", alone[:, 0]),
        },
        {
            "state": list(model.states),
            "control": list(model.controls),
            "time": STEP * np.arange(N),
        },
        {"surge_trim": published.hull.trim["u"]},
    )


def _discrete(a: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact step of dx/dt = A x + r over one sample, by the exponential of the joined matrix."""
    from scipy.linalg import expm

    d = len(rate)
    joined = np.zeros((d + 1, d + 1))
    joined[:d, :d], joined[:d, d] = a, rate
    step = expm(STEP * joined)
    return step[:d, :d], step[:d, d]
