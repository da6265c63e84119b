"""Section II: the longitudinal vehicle, its linearisation about level flight, and the surge model that is its restriction."""

from dataclasses import replace
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.core.display_units import shown_unit
from seatrial.report.drawing import signal_symbol
from seatrial.report.figures.style import BLUE, MUTED, ORANGE, PURPLE, thin, unit_label
from seatrial.vehicles.catalogue import load_surge, load_vehicle
from seatrial.vehicles.linearise import linearise, trim
from seatrial.vehicles.simulate import simulate
from studies.remus100.panels import PAGE, key, name_axes, panels
from studies.remus100.reading import RPM
from studies.remus100.study import Item, Number, Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STEP, N, CHANGE = 0.01, 1000, 50 * RPM  # 10 s after the propeller speed rose by 50 rpm
LOOKS = {
    "longitudinal, non-linear": {"color": BLUE, "linewidth": 1.6},
    "longitudinal, linearised": {"color": ORANGE, "linewidth": 1.3, "linestyle": (0, (5, 2))},
    "surge alone": {"color": PURPLE, "linewidth": 1.4, "linestyle": (0, (1.5, 1.5))},
}
PARTS = ("full", "linear")  # Names in the results of the first two
POLES = {"color": BLUE, "marker": "x", "markersize": 5, "markeredgewidth": 1.4, "linestyle": "none"}


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
        "reproduced in shape" if max(linear, alone) < 0.25 * change else "differs",
        f"no number is printed to compare with: the speed of the linearised model differs by up to {linear:.1e} m/s from that of "
        f"the non-linear one, and that of the surge model by up to {alone:.1e} m/s, in a change of {change:.2f} m/s{unstable}",
        numbers,
        {"vehicle": "remus100_longitudinal", "step_rpm": 50, "duration_s": round(float(time[-1]), 2)},
    )


def draw_vehicle(study: Study) -> "Figure":
    """Draw every state after the step, speed by the surge model too, and the poles of the linear model."""
    data = study.part("vehicle")
    figure, grid = panels(PAGE, [84, 84], 3, left=48, between=56, gap=34, share_x=False)
    time = data["time"].values
    keep = thin(time.size, 400)
    for axes, name in zip(grid.flat, map(str, data["state"].values), strict=False):
        factor, unit = shown_unit(name)
        lines = {look: data[part].sel(state=name).values for look, part in zip(LOOKS, PARTS, strict=False)}
        if name == "u":
            lines["surge alone"] = data["surge"].values
        for label, values in lines.items():
            axes.plot(time[keep], factor * values[keep], label=label, **LOOKS[label])
        axes.margins(y=0.08)
        name_axes(axes, "time [s]", unit_label(signal_symbol(name), unit))
    _poles(grid.flat[-1], data)
    key(figure, LOOKS)
    return figure


def _discrete(a: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact step of dx/dt = A x + r over one sample, by the exponential of the joined matrix."""
    from scipy.linalg import expm

    d = len(rate)
    joined = np.zeros((d + 1, d + 1))
    joined[:d, :d], joined[:d, d] = a, rate
    step = expm(STEP * joined)
    return step[:d, :d], step[:d, d]


def _poles(axes: "Axes", data: xr.Dataset) -> None:
    """Draw the eigenvalues of the linear model; what lies right of the line grows."""
    real, imaginary = data["eigenvalues"].values.T
    axes.axvline(0, color=MUTED, linewidth=0.9, label="stable to the left")
    axes.plot(real, imaginary, label="poles", **POLES)
    axes.margins(0.15)
    name_axes(axes, "real part of poles [1/s]", "imaginary part [1/s]")
