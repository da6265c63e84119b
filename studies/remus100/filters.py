"""Tables I and II and Figures 1, 2 and 4: four filters on the same noisy surge trials of random steps, over many seeds.

The paper shows one run of unstated input. Here the input is random steps about trim, each held for 2 s, over 15 s at 0.01 s,
from trim; noise, covariances and initial estimates are the paper's.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import inf, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import FilterTrace, run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.numerics.gaussian import independent
from seatrial.numerics.state_space import StateSpace
from seatrial.report.figures.style import (
    BLUE,
    DOTS,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    draw_dots,
    limit_ticks,
    thin,
    thin_steps,
)
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.simulate import simulate
from studies.remus100.panels import PAGE, TEXT, key, logarithmic, name_axes, panels, plain_axes, rpm, with_unit
from studies.remus100.reading import NAMES, Reading
from studies.remus100.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STEP, N_STEPS, HOLD = 0.01, 1500, 2.0
FIRST_SEED = 1000
PROCESS_VARIANCE = (1e-6, 1e-7, 1e-7, 1e-10)  # Q
# P of the tables, T in printed units (316 squared); the text has 1e5 for the drag coefficients, which hardly changes
# the estimates.
INITIAL_VARIANCE = (1.0, 1e4, 1e4, 1e5)
INITIAL_SHARE, BOUND_SHARE = 0.75, 0.5
MARKS = np.arange(1, 16) * 100  # Samples, each second, at which the filters' errors are kept
LOOKS = {
    "EKF": {"color": BLUE, "linewidth": 1.6},
    "UKF": {"color": ORANGE, "linewidth": 1.3, "linestyle": (0, (5, 2))},
    "SRUKF": {"color": PURPLE, "linewidth": 1.2, "linestyle": (0, (1.5, 1.5))},
}
CONSTRAINED = {"SRUKF": {"color": PURPLE, "linewidth": 1.0}, "SRUKF-C": {"color": BLUE, "linewidth": 1.3}}
ALONE = {"SRUKF": {"color": BLUE, "linewidth": 1.3}}
TRUE = {"color": INK, "linewidth": 0.9, "linestyle": (0, (6, 2))}
BOUND = {"color": MUTED, "linewidth": 1.0, "linestyle": (0, (1, 2))}
MEASURED = {"color": DOTS, "marker": "o", "markersize": 2, "linestyle": "none"}
SETTLING_TIME = 3.0  # Seconds after which the estimates have left the first guess and decide the frame
BINS = 10  # Samples over which clipping is averaged
BELOW, HIGH = 92, 56  # Room for the lowest row of Figure 2, and the height of its panels, in points


@dataclass(frozen=True)
class FilterTrials:
    """Trials of many seeds: control in rad/s, shape (seeds, n, 1), noisy u and udot and true ones, shape (seeds, n, 2)."""

    control: Float[np.ndarray, "seeds n 1"]
    measured: Float[np.ndarray, "seeds n 2"]
    true: Float[np.ndarray, "seeds n 2"]


class FilterRun(NamedTuple):
    """What one filter made of the trial."""

    name: str
    u: np.ndarray
    udot: np.ndarray
    mean: np.ndarray
    sd: np.ndarray


def filters_part(study: Study) -> xr.Dataset:
    """Return every filter over the same trials: estimates at the end and at each second, clipping, run times, one whole trace."""
    reading, seeds = study.reading, study.sizes.filter_seeds
    trials, space = make_trials(reading, seeds), filter_space(reading)
    report, runs = study.progress("four filters"), {}
    for done, (name, method) in enumerate(paper_filters(reading).items()):
        report(done, 4)
        runs[name] = _over_seeds(reading, method, space, trials)
    report(4, 4)
    first = xr.Dataset(
        {
            "n": ("time", trials.control[0, :, 0]),
            "measured": (("time", "channel"), trials.measured[0]),
            "true": (("time", "channel"), trials.true[0]),
        }
    )
    dataset = xr.concat(list(runs.values()), xr.IndexVariable("filter", list(runs)))
    coordinates = {
        "time": STEP * np.arange(N_STEPS),
        "coefficient": list(NAMES),
        "channel": ["u", "udot"],
        "mark": MARKS * STEP,
        "seed": FIRST_SEED + np.arange(seeds),
    }
    return dataset.merge(first).assign_coords(coordinates)


def make_trials(reading: Reading, seeds: int) -> FilterTrials:
    """Simulate and measure trials of seeds 1000, 1001, ..."""
    model, stamps, steps = reading.model(), STEP * np.arange(N_STEPS), jnp.full(N_STEPS, STEP)
    span = N_STEPS * STEP
    control, noise = [], []
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        family = Family("n", reading.turns, span, span, STEP, start=0.0, kind="random-steps", seed=seed)
        control.append(np.asarray(family.signal(reading.steps, HOLD, stamps))[:, None])
        noise.append(reading.filter_noise * np.random.default_rng([seed, 1]).normal(size=(N_STEPS, 2)))
    held, truth = np.stack(control), reading.truth
    start = jnp.array([reading.hull.trim["u"]])
    u = jax.vmap(lambda n: simulate(model, truth, n, steps, start))(jnp.asarray(held))[..., 0]
    udot = jax.vmap(jax.vmap(lambda x, n: model.output("udot", truth, (x,), (n[0],))))(u, jnp.asarray(held))
    true = np.asarray(jnp.stack([u, udot], -1))
    return FilterTrials(held, true + np.stack(noise), true)


def filter_space(reading: Reading, p: float = 1.0, q: float = 1.0, r: float = 1.0) -> StateSpace:
    """Joint state space, eqs. (15) and (16), with the paper's P, Q and R times these factors, coefficients at 75 % of the truth.

    P and Q are factors of the coefficients' and of the whole state's variances.
    """
    scales = filter_scales(reading)
    mean = [reading.hull.trim["u"], *(INITIAL_SHARE * reading.truth[n] / s for n, s in zip(NAMES, scales, strict=True))]
    variance = np.array(INITIAL_VARIANCE) * [1.0, p, p, p * (reading.thrust_print / reading.thrust_filter) ** 2]
    initial = independent(np.array(mean), np.sqrt(variance))
    noise = reading.filter_noise * sqrt(r)
    return discretise(
        reading.model(), ("u", "udot"), initial, np.sqrt(q * np.array(PROCESS_VARIANCE)), np.full(2, noise), scales
    )


def filter_scales(reading: Reading) -> tuple[float, float, float]:
    """Return the SI value of one filter unit of each coefficient."""
    return (1.0, 1.0, reading.thrust_filter)


def paper_filters(reading: Reading) -> dict[str, Filter]:
    """Return the four filters; the constrained one keeps each coefficient within 50 % of its true value."""
    centres = [reading.truth[name] / scale for name, scale in zip(NAMES, filter_scales(reading), strict=True)]
    bounds = [(c - BOUND_SHARE * abs(c), c + BOUND_SHARE * abs(c)) for c in centres]
    return {
        "EKF": ExtendedKalmanFilter(),
        "UKF": UnscentedKalmanFilter(),
        "SRUKF": SquareRootUnscentedKalmanFilter(),
        "SRUKF-C": SquareRootUnscentedKalmanFilter(bounds=((-inf, inf), *bounds)),
    }


def run_over_seeds(method: Filter, space: StateSpace, trials: FilterTrials) -> FilterTrace:
    """Traces of one filter over all trials."""
    return _run_over_seeds(method, space, jnp.asarray(trials.control), jnp.asarray(trials.measured))


def in_printed_units(reading: Reading, coefficients: Float[Array, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Return the coefficients, or their standard deviations, of a filter in the units of the tables."""
    return np.asarray(coefficients) * [1.0, 1.0, reading.thrust_filter / reading.thrust_print]


def rates(reading: Reading, means: Float[Array, "n 4"], control: Float[Array, "n 1"]) -> Float[Array, " n"]:
    """Return the acceleration as a filter's own state and coefficients have it, m/s^2."""
    model, scales = reading.model(), filter_scales(reading)

    def rate(mean: Array, n: Array) -> Array:
        params = {name: mean[i + 1] * scale for i, (name, scale) in enumerate(zip(NAMES, scales, strict=True))}
        return model.output("udot", params, (mean[0],), (n[0],))

    return jax.vmap(rate)(means, control)


def draw_figure_1(study: Study) -> "Figure":
    """Draw the extended, unscented and square-root unscented filters along one trial of random steps."""
    data = study.part("filters")
    return _traces(study, data, _runs(data, LOOKS), LOOKS)


def draw_figure_2(study: Study) -> "Figure":
    """Draw the square-root filter with and without constraints; below, when points are clipped, and the first second."""
    data = study.part("filters")
    runs = _runs(data, CONSTRAINED)
    figure = _traces(study, data, runs, CONSTRAINED, below=BELOW)
    for axes, name in zip(figure.axes[1:9:3], map(str, data["coefficient"].values), strict=True):
        truth = study.reading.printed_truth[name]
        bounds = sorted(share * truth for share in (1 - BOUND_SHARE, 1 + BOUND_SHARE))
        low, high = axes.get_ylim()
        pad = 0.05 * (bounds[1] - bounds[0])
        axes.set_ylim(min(low, bounds[0] - pad), max(high, bounds[1] + pad))
        for bound in bounds:
            axes.axhline(bound, label="bound", zorder=2.4, **BOUND)
    left, middle, right = (axes.get_position() for axes in figure.axes[6:9])
    low, tall = 30 / figure.get_figheight() / 72, HIGH / figure.get_figheight() / 72
    _clipping(plain_axes(figure.add_axes((left.x0, low, middle.x1 - left.x0, tall))), data)
    _first_second(plain_axes(figure.add_axes((right.x0, low, right.width, tall))), data, runs)
    return figure


def draw_figure_4(study: Study) -> "Figure":
    """Draw the square-root filter along the largest doublets of 10 s, with the long quiet tail."""
    data = study.part("chosen-doublet")
    run = FilterRun("SRUKF", data["u"].values, data["udot"].values, data["mean"].values, data["sd"].values)
    return _traces(study, data, [run], ALONE)


@partial(jax.jit, static_argnums=0)
def _run_over_seeds(method: Filter, space: StateSpace, control: Array, measured: Array) -> FilterTrace:
    steps = jnp.full(N_STEPS, STEP)
    return jax.vmap(lambda c, y: run_filter(method, space, c, y, steps))(control, measured)


def _over_seeds(reading: Reading, method: Filter, space: StateSpace, trials: FilterTrials) -> xr.Dataset:
    trace = run_over_seeds(method, space, trials)
    means, sds = (in_printed_units(reading, x[..., 1:]) for x in (trace.means, trace.sds))
    truth = np.array([reading.printed_truth[name] for name in NAMES])
    udot = np.asarray(jax.vmap(partial(rates, reading))(trace.means, jnp.asarray(trials.control)))
    early = slice(0, round(1.0 / STEP))
    return xr.Dataset(
        {
            "final_mean": (("seed", "coefficient"), means[:, -1]),
            "final_sd": (("seed", "coefficient"), sds[:, -1]),
            "relative_error": (("seed", "mark", "coefficient"), np.abs(means[:, MARKS - 1] / truth - 1)),
            "clipped": ("time", np.asarray(trace.clipped).sum(0)),
            "early_udot_error": ("seed", np.sqrt(np.mean((udot - trials.true[..., 1])[:, early] ** 2, 1))),
            "failures": ((), int(np.asarray(trace.failures).sum())),
            "smallest_sd": ((), float(np.asarray(trace.sds).min())),
            "mean": (("time", "coefficient"), means[0]),
            "sd": (("time", "coefficient"), sds[0]),
            "u": ("time", np.asarray(trace.means)[0, :, 0]),
            "udot": ("time", udot[0]),
            "seconds": ((), _seconds(method, space, trials)),
        }
    )


def _seconds(method: Filter, space: StateSpace, trials: FilterTrials) -> float:
    """Wall-clock time of one 15 s trial among the others, all run side by side, compiled beforehand: the smallest of five."""
    times = []
    for _ in range(5):
        begun = time.perf_counter()
        jax.block_until_ready(run_over_seeds(method, space, trials))
        times.append(time.perf_counter() - begun)
    return min(times) / trials.control.shape[0]


def _runs(data: xr.Dataset, names: Mapping[str, Any]) -> list[FilterRun]:
    chosen = {name: data.sel(filter=name) for name in names}
    return [
        FilterRun(name, *(one[part].values for part in ("u", "udot", "mean", "sd"))) for name, one in chosen.items()
    ]


def _traces(
    study: Study, data: xr.Dataset, runs: list[FilterRun], looks: Mapping[str, Mapping[str, Any]], below: float = 0
) -> "Figure":
    """Draw a column of response, one of estimates and one of their standard deviations; `below` is room left free, points."""
    figure, grid = panels(PAGE, [84, 84, 84], 3, left=46, between=57, bottom=30 + below)
    time = data["time"].values
    keep = thin(time.size, 500)
    _response(grid[:, 0], data, runs, looks)
    for row, name in enumerate(map(str, data["coefficient"].values)):
        truth = study.reading.printed_truth[name]
        for run in runs:
            for axes, values in zip(grid[row, 1:], (run.mean, run.sd), strict=True):
                axes.plot(time[keep], values[keep, row], label=run.name, **looks[run.name])
        grid[row, 1].axhline(truth, label="true", zorder=2.5, **TRUE)
        settled = np.concatenate([run.mean[time >= min(SETTLING_TIME, time[-1] / 2), row] for run in runs])
        low, high = min(settled.min(), truth), max(settled.max(), truth)
        pad = 0.08 * ((high - low) or abs(truth))
        grid[row, 1].set_ylim(low - pad, high + pad)
        logarithmic(grid[row, 2])
        label = with_unit(study.reading, name).replace(" [", "\n[")
        name_axes(grid[row, 1], y=label)
        name_axes(grid[row, 2], y=f"sd of {label}")
    for axes in grid[2]:
        axes.set_xlim(float(time[0]), float(2 * time[-1] - time[-2]))
        limit_ticks(axes.xaxis, 4)
        name_axes(axes, "time [s]")
    bounds = {"bounds": BOUND} if below else {}
    key(figure, {"measured": MEASURED, "true": TRUE} | {run.name: looks[run.name] for run in runs} | bounds)
    return figure


def _response(
    column: "np.ndarray", data: xr.Dataset, runs: list[FilterRun], looks: Mapping[str, Mapping[str, Any]]
) -> None:
    time, n = data["time"].values, rpm(data["n"].values)
    steps, dots, keep = thin_steps(n), thin(time.size, 400), thin(time.size, 500)
    column[0].plot(time[steps], n[steps], color=MUTED, linewidth=1.2, label="n")
    column[0].margins(y=0.1)
    for axes, channel in zip(column[1:], ("u", "udot"), strict=True):
        measured, true = (data[part].sel(channel=channel).values for part in ("measured", "true"))
        draw_dots(axes, time[dots], measured[dots], label="measured", size=1.4)
        for run in runs:
            values = run.u if channel == "u" else run.udot
            axes.plot(time[keep], values[keep], label=run.name, **looks[run.name])
        axes.plot(time[keep], true[keep], label="true", zorder=3, **TRUE)
        pad = 0.1 * float(np.ptp(measured))
        axes.set_ylim(measured.min() - pad, measured.max() + pad)
    for axes, label in zip(column, ("$n$ [rpm]", "$u$ [m/s]", r"$\dot{u}$ [m/s²]"), strict=True):
        name_axes(axes, y=label)


def _clipping(axes: "Axes", data: xr.Dataset) -> None:
    """Draw how many of the constrained filter's points are clipped, on average over the trials."""
    clipped = data["clipped"].sel(filter="SRUKF-C").values / data.sizes["seed"]
    count = clipped.size // BINS * BINS
    edges = np.append(data["time"].values[:count:BINS], data["time"].values[count - 1])
    axes.stairs(clipped[:count].reshape(-1, BINS).mean(1), edges, fill=True, color=BLUE, alpha=0.6, label="clipped")
    early = clipped[data["time"].values < 5.0].sum() / max(clipped.sum(), 1e-300)
    axes.annotate(
        f"{100 * early:.0f} % of the clipping in the first 5 s",
        (0.99, 0.85),
        xycoords="axes fraction",
        ha="right",
        va="top",
        fontsize=TEXT,
        color=INK,
    )
    axes.set_xlim(float(edges[0]), float(edges[-1]))
    limit_ticks(axes.xaxis, 4)
    limit_ticks(axes.yaxis, 3)
    name_axes(axes, "time [s]", "clipped points\na step")


def _first_second(axes: "Axes", data: xr.Dataset, runs: list[FilterRun]) -> None:
    """Draw the acceleration that the filters believe in during the first second, where clipping is densest."""
    time = data["time"].values
    early = time <= 1.0
    for run in runs:
        axes.plot(time[early], run.udot[early], label=run.name, **CONSTRAINED[run.name])
    axes.plot(time[early], data["true"].sel(channel="udot").values[early], label="true", zorder=3, **TRUE)
    limit_ticks(axes.yaxis, 3)
    name_axes(axes, "time [s]", "$\\dot{u}$\n[m/s²]")
