"""Tables III and VI and Figures 6 to 8: Markov chains of the paper's length, what they look like and what they say."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from seatrial.core.normal import normal_density
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.pointwise import pointwise_log_likelihood, thin_draws
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.report.figures.style import BLUE, INK, MUTED, ORANGE, PURPLE, limit_ticks, thin
from seatrial.sampling import adaptive_metropolis
from seatrial.sampling.diagnostics import diagnose, variance_of_mean
from seatrial.sampling.names import SamplerName
from seatrial.sampling.run import ChainSettings, finish, is_finished
from seatrial.sampling.sampler import SAMPLERS, Sampler, advance_chains, start_chains
from seatrial.selection.criteria import deviance_criteria, psis_loo, waic
from studies.remus100.panels import PAGE, TEXT, key, name_axes, panels, symbol, with_unit
from studies.remus100.study import Study
from studies.remus100.trial import paper_posterior, paper_trial, wide

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LAGS = 200
KEPT_DRAWS = 5000  # Draws of each chain that are kept for figures; every number comes from all of them
AFAR = 10.0  # Nats below the mode at which a start counts as arrived
BINS, LIMIT = 50, 2.0
GEWEKE = {"color": ORANGE, "marker": "o", "markersize": 3, "linestyle": "none"}
NORMAL = {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2))}
BURN_IN = {"color": INK, "linewidth": 0.9, "linestyle": (0, (1, 1.5))}
INSIDE = {"color": ORANGE, "linewidth": 6, "alpha": 0.16}
RAW = {"color": ORANGE, "linewidth": 6, "alpha": 0.25}
DETRENDED = {"color": ORANGE, "linewidth": 1.4}
DRAWS = {"color": BLUE, "linewidth": 6, "alpha": 0.45}
TRUE = {"color": PURPLE, "linewidth": 1.5, "linestyle": (0, (1.5, 1.2))}
MEAN = {"color": BLUE, "linewidth": 1.4}
HPD = {"color": MUTED, "linewidth": 6, "alpha": 0.3}


class _Sampled(NamedTuple):
    """A finished run: draws in SI, shape (chains, draws, d), chain 0 every 100 iterations from the start, and its cost."""

    values: Float[np.ndarray, "chains draws d"]
    trace: Float[np.ndarray, "points d"]
    mode: Float[np.ndarray, " d"]
    acceptance: float
    seconds: float


def table_3_part(study: Study, sampler: SamplerName) -> xr.Dataset:
    """M-1 on the trial of a vehicle without the doubted term, by adaptive Metropolis or by Metropolis-Hastings."""
    posterior = paper_posterior(study.reading, [paper_trial(study.reading, None)], None)
    title = f"Table III, {sampler.replace('-', ' ')}"
    return _summary(study, posterior, _sample(study, posterior, SAMPLERS[sampler], title))


def table_6_part(study: Study, full: bool) -> xr.Dataset:
    """M-0 under the uninformative prior, or M-1, on the trial of the smaller doubted term, with information criteria."""
    reading = study.reading
    record = paper_trial(reading, reading.doubted_values[0])
    posterior = paper_posterior(reading, [record], wide(reading) if full else None)
    sampled = _sample(study, posterior, adaptive_metropolis, f"Table VI, M-{0 if full else 1}")
    report = study.progress(f"information criteria of M-{0 if full else 1}")
    report(0, 2)
    result = deviance_criteria(posterior, sampled.values)
    report(1, 2)
    table = pointwise_log_likelihood(posterior, thin_draws(sampled.values, study.sizes.criteria_draws))
    predictive = (waic(table), psis_loo(table))
    report(2, 2)
    named = {"DIC": result.dic, "BPIC": result.bpic, "p_D": result.p_d, "Dbar": result.mean_deviance}
    named |= {criterion.method: criterion.value for criterion in predictive}
    return _summary(study, posterior, sampled).assign(
        criterion_value=("criterion", [one.value for one in named.values()]),
        criterion_error=("criterion", [one.error for one in named.values()]),
        pointwise=(("predictive", "sample"), [one.pointwise for one in predictive]),
        k_hat=("sample", predictive[1].k_hat),
        criterion=list(named),
        predictive=[one.method for one in predictive],
    )


def starts_part(study: Study) -> xr.Dataset:
    """Return how long a chain takes to arrive from the paper's first estimates, half the truth, and from the posterior mode."""
    posterior = paper_posterior(study.reading, [paper_trial(study.reading, None)], None)
    mode = find_mode(posterior, key=study.random_key("mode"))
    half = [0.5 * study.reading.truth.get(name, study.reading.sigma) for name in posterior.names]
    first = {"half the truth": posterior.unconstrain(jnp.asarray(half)), "posterior mode": jnp.asarray(mode.z)}
    settings = ChainSettings(study.sizes.chains, 2000, 100)
    report, heights = study.progress("where chains start"), []
    for done, z in enumerate(first.values()):
        report(done, len(first))
        run = start_chains(
            adaptive_metropolis, posterior, jnp.tile(z, (settings.chains, 1)), 1e-4 * jnp.eye(posterior.dim)
        )
        height = [np.asarray(run.state.log_density)]
        while run.iteration < settings.warmup:
            run = advance_chains(adaptive_metropolis, posterior, run, study.random_key("starts"), settings)
            height.append(np.asarray(run.state.log_density))
        heights.append(np.array(height) - mode.log_density)
    report(len(first), len(first))
    return xr.Dataset(
        {"height": (("start", "iteration", "chain"), heights)},
        {"start": list(first), "iteration": 100 * np.arange(len(heights[0]))},
    )


def chain_figure(part: str) -> Callable[[Study], "Figure"]:
    """Figure of the chain kept under this name."""

    def draw(study: Study) -> "Figure":
        return draw_chain(study, study.part(part))

    return draw


def draw_chain(study: Study, data: xr.Dataset) -> "Figure":
    """Draw one row of three panels for each parameter."""
    names = [str(name) for name in data["parameter"].values]
    figure, grid = panels(PAGE, [74] * len(names), 3, left=46, right=12, top=38, between=57, gap=31, share_x=False)
    for row, name in enumerate(names):
        one = data.sel(parameter=name)
        right = _trace(grid[row, 0], one, study.sizes.burn_in)
        axes = grid[row, 1]
        lag = one["lag"].values
        axes.fill_between(lag, 0, one["raw_acf"].values, color=ORANGE, alpha=0.25, linewidth=0, label="raw")
        heights = np.stack([np.zeros(lag.size), one["acf"].values, np.full(lag.size, np.nan)], -1).ravel()
        axes.plot(np.repeat(lag, 3), heights, color=ORANGE, linewidth=0.7, label="detrended")
        axes.set(xlim=(float(lag[0]), float(lag[-1])), ylim=(min(-0.1, float(one["acf"].min())), 1.05))
        _posterior(grid[row, 2], one)
        last = row == len(names) - 1
        name_axes(grid[row, 0], "iteration [1000]" if last else "", f"{symbol(name)} / true")
        name_axes(grid[row, 1], "lag [iterations]" if last else "", "autocorr.")
        name_axes(grid[row, 2], with_unit(study.reading, name), "density")
        name_axes(right, y="z")
    key(
        figure,
        {
            "trace": {"color": BLUE, "linewidth": 0.8},
            "end of burn-in": BURN_IN,
            "Geweke score z": GEWEKE,
            "z within ± 2": INSIDE,
            "raw autocorr.": RAW,
            "detrended": DETRENDED,
            "draws": DRAWS,
            "95 % HPD": HPD,
            "normal": NORMAL,
            "mean": MEAN,
            "true": TRUE,
        },
        columns=6,
    )
    return figure


def _sample(study: Study, posterior: Posterior, sampler: Sampler, title: str) -> _Sampled:
    """Burn in and sample; chain 0 starts at the posterior mode, the others at draws of the normal approximation."""
    sizes = study.sizes
    settings = ChainSettings(sizes.chains, sizes.burn_in, sizes.draws)
    mode_key, start_key, key = jax.random.split(study.random_key(title), 3)
    mode = find_mode(posterior, key=mode_key)
    starts = jax.random.multivariate_normal(start_key, mode.z, mode.cov, (sizes.chains,)).at[0].set(mode.z)
    run = start_chains(sampler, posterior, starts, jnp.asarray(mode.cov))
    report, total = study.progress(f"{title}, {sizes.chains} chains"), sizes.burn_in + sizes.draws
    trace, first, begun = [np.asarray(starts[0])], 0.0, time.perf_counter()
    while not is_finished(run, settings):
        run = advance_chains(sampler, posterior, run, key, settings)
        first = first or time.perf_counter() - begun
        trace.append(np.asarray(run.state.z[0]))
        report(run.iteration, total)
    seconds = time.perf_counter() - begun - first
    draws = finish(run)
    values, shown = (np.asarray(posterior.constrain(jnp.asarray(z))) for z in (draws.z, np.array(trace)))
    return _Sampled(values, shown, mode.values, draws.acceptance, seconds)


class GewekeScores(NamedTuple):
    """Scores of successive early segments of a chain.

    Attributes:
        start: index of each segment's first draw, shape (intervals,).
        score: its score, in standard deviations, shape (intervals,); infinite or NaN where nothing moves.
    """

    start: Int[np.ndarray, " intervals"]
    score: Float[np.ndarray, " intervals"]


def geweke_scores(
    chain: Float[np.ndarray, " n"], variance: Callable[[np.ndarray], float], intervals: int = 20
) -> GewekeScores:
    """Return the scores of early tenths of a chain against its second half, as the paper draws them over the traces.

    With V the variance of a mean each is standard normal where the chain is stationary, so that 95 % lie within 2; segments that overlap
    share their luck. With V the variance of the draws, as the paper prints it, they cannot fail: it neither shrinks with the number of
    draws nor grows with their correlation. A chain that drifts by two posterior standard deviations scores about -1, where the
    variance of the mean gives -10 after a thousand draws.

    Args:
        chain: draws of one parameter, a hundred or more.
        variance: V of some draws.
        intervals: segments, evenly spread from the first draw to where the second half begins.
    """
    n = chain.size
    length, end = int(0.1 * n), n - int(0.5 * n)
    late = chain[end:]
    start = np.linspace(0, end - length, intervals).astype(int)
    early = [chain[i : i + length] for i in start]
    spread = np.array([variance(draws) for draws in early]) + variance(late)
    difference = np.array([draws.mean() for draws in early]) - late.mean()
    with np.errstate(divide="ignore", invalid="ignore"):
        return GewekeScores(start, difference / np.sqrt(spread))


def _summary(study: Study, posterior: Posterior, sampled: _Sampled) -> xr.Dataset:
    from arviz_stats.base.array import array_stats

    reading, names = study.reading, posterior.names
    scale = np.array([reading.print_scales.get(name, 1.0) for name in names])
    values = sampled.values / scale
    health, flat = diagnose(values), values.reshape(-1, len(names))
    hpd = np.array([array_stats.hdi(flat[:, i], prob=0.95) for i in range(len(names))])
    one = values[0]
    scores = [geweke_scores(one[:, i], variance_of_mean) for i in range(len(names))]
    every = max(1, values.shape[1] // KEPT_DRAWS)
    true = {**reading.truth, reading.doubted: reading.doubted_values[0], "sigma_u": reading.sigma}
    columns = {
        "mean": flat.mean(0),
        "sd": flat.std(0, ddof=1),
        "hpd_low": hpd[:, 0],
        "hpd_high": hpd[:, 1],
        "r_hat": health.r_hat,
        "ess": health.ess_bulk,
        "ess_tail": health.ess_tail,
        "mcse": health.mcse,
        "mode": sampled.mode / scale,
        "truth": np.array([true[name] for name in names]) / scale,
    }
    # The draws as they are, their mean left in: near 1 at every lag unless the mean is near 0.
    return xr.Dataset(
        {
            **{name: ("parameter", column) for name, column in columns.items()},
            "draws": (("chain", "draw", "parameter"), values[:, every - 1 :: every]),
            "trace": (("iteration", "parameter"), sampled.trace / scale),
            "raw_acf": (
                ("lag", "parameter"),
                np.stack(
                    [(np.array([x[lag:] @ x[: x.size - lag] for lag in range(LAGS + 1)]) / (x @ x)) for x in one.T], -1
                ),
            ),
            "acf": (
                ("lag", "parameter"),
                np.stack([array_stats.autocorr(_detrended(x))[: LAGS + 1] for x in one.T], -1),
            ),
            "geweke": (("interval", "parameter"), np.stack([score.score for score in scores], -1)),
            "printed_geweke": (
                ("interval", "parameter"),
                np.stack([geweke_scores(x, lambda draws: float(draws.var())).score for x in one.T], -1),
            ),
            "geweke_start": ("interval", scores[0].start),
            "covariance": (("parameter", "other"), np.cov(flat, rowvar=False)),
            "acceptance": ((), sampled.acceptance),
            "seconds": ((), sampled.seconds),
        },
        {"parameter": list(names), "iteration": 100 * np.arange(len(sampled.trace)), "lag": np.arange(LAGS + 1)},
        {"labels": [parameter.label for parameter in posterior.parameters]},
    )


def _detrended(x: np.ndarray) -> np.ndarray:
    at = np.arange(x.size)
    return x - np.polyval(np.polyfit(at, x, 1), at)


def _trace(axes: "Axes", one: xr.Dataset, burn_in: int) -> "Axes":
    """Draw the trace over all iterations; return the right axis, of the scores over the first half of the kept ones."""
    iteration, keep = one["iteration"].values / 1000, thin(one.sizes["iteration"], 600)
    values = one["trace"].values / float(one["truth"])
    axes.plot(iteration[keep], values[keep], color=BLUE, linewidth=0.5, alpha=0.85, label="trace")
    axes.axvline(burn_in / 1000, label="end of burn-in", **BURN_IN)
    axes.set_xlim(float(iteration[0]), float(iteration[-1]))
    right = axes.twinx()
    for name, spine in right.spines.items():
        spine.set_visible(name == "right")
        spine.set_color(MUTED)
        spine.set_linewidth(0.8)
    score = one["geweke"].values
    at = (burn_in + one["geweke_start"].values) / 1000
    reach = max(4.0, 1.15 * float(np.nanmax(np.abs(score))))
    end = (burn_in / 1000 + float(iteration[-1])) / 2
    right.fill_between([burn_in / 1000, end], -LIMIT, LIMIT, color=ORANGE, alpha=0.16, linewidth=0, label="± 2")
    right.plot(at, score, label="Geweke", zorder=4, **GEWEKE)
    right.set_ylim(-reach, reach)
    right.tick_params(colors=MUTED, labelsize=TEXT, length=3, width=0.8, labelcolor=INK, pad=2)
    limit_ticks(right.yaxis, 4)
    return right


def _posterior(axes: "Axes", one: xr.Dataset) -> None:
    draws = one["draws"].values.ravel()
    mean, sd, truth = (float(one[name]) for name in ("mean", "sd", "truth"))
    low, high = min(mean - 4 * sd, truth - 0.3 * sd), max(mean + 4 * sd, truth + 0.3 * sd)
    counts, edges = np.histogram(draws, bins=BINS, range=(low, high))
    axes.axvspan(float(one["hpd_low"]), float(one["hpd_high"]), color=MUTED, alpha=0.16, linewidth=0, label="95 % HPD")
    axes.stairs(counts / (draws.size * np.diff(edges)), edges, fill=True, color=BLUE, alpha=0.45, label="draws")
    grid = np.linspace(low, high, 120)
    axes.plot(grid, normal_density(grid, mean, sd), label="normal", **NORMAL)
    axes.axvline(truth, label="true", zorder=4, **TRUE)
    axes.axvline(mean, label="mean", zorder=3, **MEAN)
    axes.set(xlim=(low, high), yticks=[])
    axes.set_ylim(bottom=0)
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    limit_ticks(axes.xaxis, 4)
