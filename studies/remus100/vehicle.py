"""Section II: the longitudinal vehicle, its linearisation about level flight, and the surge model that is its restriction."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.vehicles.catalogue import load_surge, load_vehicle
from seatrial.vehicles.linearise import linearise, trim
from seatrial.vehicles.simulate import simulate
from studies.remus100.reading import RPM
from studies.remus100.study import Item, Number, Study

STEP, N, CHANGE = 0.01, 1000, 50 * RPM  # 10 s after the propeller speed rose by 50 rpm


def vehicle_part(study: Study) -> xr.Dataset:
    """Linear model of the published REMUS 100, and its answer to a step of n beside the non-linear and the surge model's."""
    longitudinal = load_vehicle("remus100_longitudinal")
    hull, values = longitudinal.hull, dict(longitudinal.coefficients)
    model = longitudinal.build(positions=("z",))
    # The vehicle floats: level flight with heave and pitch held is that of a neutrally buoyant one.
    surge = replace(longitudinal, hull=replace(hull, buoyancy=hull.weight)).build(moves=("u",))
    state, control = map(np.array, trim(model, values, n=hull.trim["n"]))
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


def vehicle(study: Study) -> Item:
    """The longitudinal vehicle, its linearisation, and the surge model as its restriction."""
    data = study.part("vehicle")
    time, speed = data["time"].values, data["full"].values[:, 0]
    linear = float(np.abs(speed - data["linear"].values[:, 0]).max())
    alone = float(np.abs(speed - data["surge"].values).max())
    change = float(abs(data["surge"].values[-1] - data["surge"].values[0]))
    growing = data["eigenvalues"].values[data["eigenvalues"].values[:, 0] > 1e-6]
    unstable = (
        "; the published coefficients make level flight unstable without control (growth rate "
        f"{growing[:, 0].max():.2f} 1/s), which "
        "the paper does not mention"
        if growing.size
        else ""
    )
    numbers = (
        Number("trim speed of the longitudinal vehicle [m/s]", None, float(data["trim"].values[0])),
        Number("trim speed of the surge model [m/s]", None, float(data.attrs["surge_trim"])),
        Number(f"change of speed {time[-1]:.0f} s after n rose by 50 rpm, surge model [m/s]", None, change),
        Number("largest difference of the linearised model from the non-linear one [m/s]", None, linear),
        Number("largest difference of the surge model from the longitudinal one [m/s]", None, alone),
        *(
            Number(f"A, row {s}, column u [1/s]", None, float(a))
            for s, a in zip(data["state"].values, data["a"].values[:, 0], strict=True)
        ),
    )
    return Item(
        "vehicle",
        "Longitudinal vehicle, its linearisation, and the surge model as its restriction",
        "not comparable" if max(linear, alone) < 0.25 * change else "contradicted",
        f"no number is printed to compare with: the speed of the linearised model differs by up to {linear:.1e} m/s from that of "
        f"the non-linear one, and that of the surge model by up to {alone:.1e} m/s, in a change of {change:.2f} m/s{unstable}",
        numbers,
        {"vehicle": "remus100_longitudinal", "step_rpm": 50, "duration_s": round(float(time[-1]), 2)},
    )


def _discrete(a: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact step of dx/dt = A x + r over one sample, by the exponential of the joined matrix."""
    from scipy.linalg import expm

    d = len(rate)
    joined = np.zeros((d + 1, d + 1))
    joined[:d, :d], joined[:d, d] = a, rate
    step = expm(STEP * joined)
    return step[:d, :d], step[:d, d]
