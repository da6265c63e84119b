"""Figures 3 and 4: entropy reduction over repeated doublets and self-oscillating tests, eqs. (6) to (14) with their signs made right.

Gain = H(prior) - H(posterior) = 1/2 ln(|P_0| / |P_N|) of the three coefficients, by a Kalman filter along the noise-free
motion, which an Euler step makes, as in the paper's time.
"""

import time
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.design.relay_sweep import sweep_relay
from seatrial.design.sweep import sweep_family
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.relay import RelayFamily, run_relay
from seatrial.numerics.gaussian import independent
from seatrial.numerics.integrate import Integrator, euler_step, rk4_step
from seatrial.numerics.state_space import StateSpace
from seatrial.report.figures.style import (
    BLUE,
    INK,
    MUTED,
    ORANGE,
    POINT,
    PURPLE,
    RULE,
    limit_ticks,
    thin,
    thin_steps,
)
from seatrial.vehicles.discretise import discretise
from studies.remus100.filters import (
    INITIAL_SHARE,
    PROCESS_VARIANCE,
    filter_scales,
    in_printed_units,
    rates,
)
from studies.remus100.panels import PAGE, TEXT, key, name_axes, panels, plain_axes, rpm
from studies.remus100.reading import NAMES, Reading
from studies.remus100.study import Study
from studies.remus100.trial import DURATION, STEP, doublets, simulated_speed, stamps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.contour import ContourSet
    from matplotlib.figure import Figure

POINTS = 20
PERIODS = np.linspace(1.0, 20.0, POINTS)
# Manoeuvre windows, s: the paper does not print its own; 20 s gives its ridge at 10 s.
ACTIVE = {"short": 20.0, "medium": 40.0, "long": 58.0}
INITIAL_VARIANCE = (1.0, 1e5, 1e5, 1e5)  # P of the text, T in printed units
NOISE_SEED = 4  # Of the noise in the chosen doublet's trial
# Of the self-oscillating test, over trim speed; the largest are out of reach, and said to be.
THRESHOLDS = np.linspace(0.03, 0.36, 12)
COLOURS, LEVELS = "viridis", 12
GAIN, AMPLITUDE, PERIOD = "entropy reduction [nat]", "amplitude [rpm]", "period [s]"
WINDOWS = {
    "short": {"color": BLUE, "marker": "o"},
    "medium": {"color": ORANGE, "marker": "s"},
    "long": {"color": PURPLE, "marker": "^"},
}
RELAY = {"color": BLUE, "linewidth": 1.2}
DOUBLET = {"color": ORANGE, "linewidth": 1.1, "linestyle": (0, (4, 2))}


def sweep_part(study: Study, window: str, method: Filter = SquareRootUnscentedKalmanFilter()) -> xr.Dataset:
    """Sweep of Figure 3 for one manoeuvre window; the time is of a second sweep, compiled beforehand."""
    reading, report = study.reading, study.progress(f"designs, {ACTIVE[window]:g} s window, {type(method).__name__}")
    family = Family("n", reading.turns, duration=DURATION, active=ACTIVE[window], sample_time=STEP)
    report(0, 2)
    for done in (1, 2):
        begun = time.perf_counter()
        sweep = sweep_family(
            design_space(reading, euler_step),
            family,
            np.linspace(reading.lowest, reading.highest, POINTS),
            PERIODS,
            truth=true_state(reading),
            method=method,
        )
        report(done, 2)
    return xr.Dataset(
        {"gain": (("amplitude", "period"), sweep.gain), "seconds": ((), time.perf_counter() - begun)},
        {"amplitude": sweep.amplitude, "period": PERIODS},
    )


def ekf_sweep_part(study: Study) -> xr.Dataset:
    """Return the 40 s window by the extended Kalman filter."""
    return sweep_part(study, "medium", ExtendedKalmanFilter())


def chosen_doublet_part(study: Study) -> xr.Dataset:
    """Figure 4: the square-root UKF along the largest doublet of 10 s, with measurement noise."""
    reading, space = study.reading, design_space(study.reading, rk4_step)
    control, model = doublets(reading), study.reading.model()
    u = simulated_speed(reading, reading.truth, control)
    udot = np.asarray(model.output("udot", reading.truth, (u,), (control,)))
    true = np.column_stack([u, udot])
    measured = true + reading.filter_noise * np.random.default_rng(NOISE_SEED).normal(size=true.shape)
    trace = run_filter(
        SquareRootUnscentedKalmanFilter(), space, jnp.asarray(control[:, None]), measured, jnp.full(u.size, STEP)
    )
    udot = rates(reading, trace.means, jnp.asarray(control[:, None]))
    return xr.Dataset(
        {
            "n": ("time", control),
            "measured": (("time", "channel"), measured),
            "true": (("time", "channel"), true),
            "u": ("time", np.asarray(trace.means)[:, 0]),
            "udot": ("time", np.asarray(udot)),
            "mean": (("time", "coefficient"), in_printed_units(reading, trace.means[:, 1:])),
            "sd": (("time", "coefficient"), in_printed_units(reading, trace.sds[:, 1:])),
        },
        {"time": stamps(), "coefficient": list(NAMES), "channel": ["u", "udot"]},
    )


def relay_part(study: Study) -> xr.Dataset:
    """Self-oscillating tests over control amplitude and oscillation amplitude, for the same 40 s, and the best one's motion."""
    reading, space = study.reading, design_space(study.reading, rk4_step)
    speed, report = reading.hull.trim["u"], study.progress("self-oscillating tests")
    family = RelayFamily(
        (("n", reading.turns),),
        "n",
        "u",
        speed,
        duration=DURATION,
        sample_time=STEP,
        start=1.0,
        active=ACTIVE["medium"],
    )
    report(0, 1)
    truth = true_state(reading)
    sweep = sweep_relay(
        space,
        family,
        np.linspace(reading.lowest, reading.highest, POINTS),
        THRESHOLDS * abs(speed),
        truth=truth,
    )
    row, column = sweep.best
    best = (sweep.amplitude[row], sweep.threshold[column])
    run = run_relay(space, family, *best, jnp.asarray(truth), jnp.zeros(family.time().size))
    report(1, 1)
    grid = ("amplitude", "threshold")
    return xr.Dataset(
        {
            "gain": (grid, sweep.gain),
            "switches": (grid, sweep.switches),
            "reached": (grid, sweep.reached),
            "n": ("time", np.asarray(run.control)[:, 0]),
            "u": ("time", np.asarray(run.state)[:, 0]),
        },
        {"amplitude": sweep.amplitude, "threshold": sweep.threshold, "time": family.time()},
        {"best_amplitude": best[0], "best_threshold": best[1]},
    )


def design_space(reading: Reading, integrator: Integrator) -> StateSpace:
    """Joint state space with the text's Q, R and P, coefficients believed at 75 % of the truth."""
    believed = true_state(reading) * [1.0, *[INITIAL_SHARE] * 3]
    variance = np.array(INITIAL_VARIANCE) * [1.0, 1.0, 1.0, (reading.thrust_print / reading.thrust_filter) ** 2]
    return discretise(
        reading.model(),
        ("u", "udot"),
        independent(believed, np.sqrt(variance)),
        np.sqrt(PROCESS_VARIANCE),
        np.full(2, reading.filter_noise),
        filter_scales(reading),
        integrator,
    )


def true_state(reading: Reading) -> np.ndarray:
    """Trim speed and true coefficients in filter units."""
    scaled = (reading.truth[n] / s for n, s in zip(NAMES, filter_scales(reading), strict=True))
    return np.array([reading.hull.trim["u"], *scaled])


def draw_figure_3(study: Study) -> "Figure":
    """Draw the entropy reduction as a surface and as filled contours, and its ridges for three manoeuvre windows."""
    from matplotlib.figure import Figure

    width, height = PAGE, 292
    figure = Figure(figsize=(width * POINT, height * POINT), dpi=72)
    sweep = study.part("sweep-short")
    figure.text(8 / width, 1 - 12 / height, f"window {ACTIVE['short']:g} s", fontsize=TEXT, color=INK)
    _surface(figure, sweep)
    contour = plain_axes(figure.add_axes((316 / width, 164 / height, 128 / width, 118 / height)))
    filled = _filled(contour, sweep["period"].values, rpm(sweep["amplitude"].values), sweep["gain"].values)
    name_axes(contour, PERIOD, AMPLITUDE)
    _bar(figure, contour, filled)
    ridges = plain_axes(figure.add_axes((316 / width, 30 / height, 128 / width, 96 / height)))
    for window, look in WINDOWS.items():
        one = study.part(f"sweep-{window}")
        ridges.plot(one["period"], one["gain"].values[-1], label=window, linewidth=1.0, markersize=2.5, **look)
        # In the order of the lines' ends, so that no two names overlap.
        ends = {name: float(study.part(f"sweep-{name}")["gain"].values[-1, -1]) for name in WINDOWS}
        ridges.annotate(
            f"window {ACTIVE[window]:g} s",
            (1.03, (0.64 + 0.15 * sorted(WINDOWS, key=ends.__getitem__).index(window))),
            xycoords="axes fraction",
            va="center",
            fontsize=TEXT,
            color=look["color"],
        )
    name_axes(ridges, PERIOD, GAIN)
    return figure


def draw_relay(study: Study) -> "Figure":
    """Draw the gain of self-oscillating tests, hatched where they do not oscillate, and the best one beside the doublets."""
    data, doublet = study.part("relay"), study.part("chosen-doublet")
    figure, grid = panels(PAGE, [86, 86], 2, between=104)
    grid[0, 0].remove()
    axes = grid[1, 0]
    low, high = axes.get_position(), grid[0, 1].get_position()
    axes.set_position((low.x0, low.y0, low.width, high.y1 - low.y0))
    amplitude, threshold = rpm(data["amplitude"].values), data["threshold"].values
    contours = _filled(axes, threshold, amplitude, data["gain"].values)
    _hatch_silent(axes, threshold, amplitude, data["switches"].values)
    best = data.attrs["best_threshold"], float(rpm(data.attrs["best_amplitude"]))
    axes.plot(
        *best,
        marker="*",
        markersize=11,
        color="#ffffff",
        markeredgecolor="#000000",
        markeredgewidth=0.8,
        linestyle="none",
        clip_on=False,
        zorder=5,
        label="best",
    )
    name_axes(axes, "oscillation amplitude of $u$ [m/s]", "control amplitude [rpm]")
    _bar(figure, axes, contours)
    for one, look, label in ((data, RELAY, "self-oscillating"), (doublet, DOUBLET, "doublets of 10 s")):
        time, n, u = one["time"].values, rpm(one["n"].values), (one["true"][:, 0] if "true" in one else one["u"]).values
        steps, keep = thin_steps(n), thin(time.size, 700)
        grid[0, 1].plot(time[steps], n[steps], label=label, **look)
        grid[1, 1].plot(time[keep], u[keep], label=label, **look)
    name_axes(grid[0, 1], y="$n$ [rpm]")
    name_axes(grid[1, 1], "time [s]", "$u$ [m/s]")
    key(figure, {"self-oscillating, best": RELAY, "doublets of 10 s": DOUBLET}, x=0.56)
    return figure


def _surface(figure: "Figure", sweep: xr.Dataset) -> None:
    axes: Any = figure.add_axes((0.02, 0.0, 0.56, 1.0), projection="3d")
    period, amplitude = np.meshgrid(sweep["period"].values, rpm(sweep["amplitude"].values))
    axes.plot_surface(
        period, amplitude, sweep["gain"].values, cmap=COLOURS, rstride=1, cstride=1, edgecolor="#ffffff", linewidth=0.2
    )
    axes.view_init(elev=28, azim=-128)
    axes.set_box_aspect((1, 1, 0.75), zoom=0.84)
    axes.set_facecolor("none")
    for axis, label in zip((axes.xaxis, axes.yaxis, axes.zaxis), (PERIOD, AMPLITUDE, GAIN), strict=True):
        axis.set_label_text(label, fontsize=TEXT, color=INK)
        axis.set_pane_color((1, 1, 1, 0))
        axis.line.set_color(MUTED)
        axis._axinfo["grid"].update(color=RULE, linewidth=0.7)
        axis.set_tick_params(labelsize=TEXT, labelcolor=INK, color=MUTED, pad=-1)
        axis.labelpad = 0
        limit_ticks(axis, 5)


def _filled(axes: "Axes", x: np.ndarray, y: np.ndarray, gain: np.ndarray) -> "ContourSet":
    from matplotlib.ticker import MaxNLocator

    levels = MaxNLocator(LEVELS).tick_values(float(np.nanmin(gain)), float(np.nanmax(gain)))
    contours = axes.contourf(x, y, gain, levels=levels, cmap=COLOURS)
    contours.set_edgecolor("face")
    axes.grid(False)
    return contours


def _bar(figure: "Figure", axes: "Axes", contours: "ContourSet") -> None:
    place = axes.get_position()
    holder = figure.add_axes((place.x1 + 0.016, place.y0, 0.016, place.height))
    bar = figure.colorbar(contours, cax=holder)
    holder.set_frame_on(False)
    for part in holder.collections:
        part.set_edgecolor("face")
    limit_ticks(holder.yaxis, 5)
    holder.tick_params(colors=MUTED, labelsize=TEXT, length=2, width=0.6, labelcolor=INK)
    bar.set_label(GAIN, fontsize=TEXT, color=INK, labelpad=3)


def _hatch_silent(axes: "Axes", x: np.ndarray, y: np.ndarray, switches: np.ndarray) -> None:
    """Hatch the designs that switch fewer than twice: their threshold is out of reach."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    dx, dy = (x[1] - x[0], y[1] - y[0]) if min(x.size, y.size) > 1 else (1.0, 1.0)
    cells = [Rectangle((x[j] - dx / 2, y[i] - dy / 2), dx, dy) for i, j in zip(*np.nonzero(switches < 2), strict=True)]
    axes.add_collection(
        PatchCollection(
            cells, facecolor="none", edgecolor="#ffffff", hatch="////", linewidth=0.0, label="fewer than two switches"
        )
    )
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
