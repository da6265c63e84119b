"""Section IV by evidence, Tables IV and V: Listing 1 over many seeds, evidences by several methods, and the odds as the true term grows."""

from collections.abc import Callable
from functools import partial
from math import sqrt
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors import Uniform
from seatrial.report.figures.style import BLUE, DOTS, INK, MUTED, ORANGE, PURPLE, limit_ticks
from seatrial.report.numbers import plain
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.tempered_smc import SMCSettings
from seatrial.selection.evidence import EvidenceSettings, smc_evidence
from seatrial.selection.importance import ImportanceSettings, importance_evidence
from seatrial.selection.verdict import Evidence
from studies.remus100.bridge import bridge_evidence
from studies.remus100.nested import nested_evidence
from studies.remus100.panels import COLUMN, PAGE, TEXT, key, name_axes, panels, symbol, with_unit
from studies.remus100.prior_monte_carlo import MIN_ESS, ListingOne, listing_one
from studies.remus100.reading import Reading
from studies.remus100.study import Item, Number, Study, Verdict, trial_settings
from studies.remus100.trial import around, paper_posterior, paper_trial, wide

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MODELS = ("M-0", "M-1")
LARGER = (-20.0, -60.0)  # True coefficients, in multiples of the larger printed one, at which the data begin to tell
WEIGHING = ImportanceSettings(draws=4096, pilot=2048)  # For each of many trials
Estimator = Callable[[Posterior, jax.Array], Evidence]
PRINTED_M0 = {4: 0.4642, 5: 0.5501}  # Printed probability of M-0
REFERENCE = "importance sampling"
UNDECIDED_MARGIN = 0.1  # A probability this near to a half prefers neither model
PRINTED_PROBABILITIES = {4: 0.4642, 5: 0.5501}  # Probability of M-0 that the paper prints in Tables IV and V
BINS = np.linspace(0, 1, 21)
# Height of a row that holds a histogram, and of a bar in it that holds every seed, in rows that hold one value.
TALL, TALLEST = 1.7, 1.2


def listing_part(study: Study, table: int) -> xr.Dataset:
    """Listing 1 as printed over many seeds, and with draws shared between the models, on the trial of Table IV or V."""
    sizes, models = study.sizes, _models(study.reading, table)
    results = {}
    for shared, repeats in ((False, sizes.listing_repeats), (True, sizes.listing_shared)):
        title = f"Listing 1 for Table {'IV' if table == 4 else 'V'}, {repeats} seeds" + (
            ", shared draws" if shared else ""
        )
        results[shared] = listing_one(
            models,
            study.random_key("listing"),
            draws=sizes.listing_draws,
            repeats=repeats,
            shared=shared,
            progress=study.progress(title),
        )
    return xr.Dataset(
        {
            "probability": (("repeat", "model"), results[False].probability),
            "shared_probability": (("shared_repeat", "model"), results[True].probability),
            "log_values": (("repeat", "model"), _column(results[False], "log_values")),
            "ess": (("repeat", "model"), _column(results[False], "ess")),
        },
        {"model": list(MODELS)},
        {"status": results[False].status},
    )


def evidence_part(study: Study, table: int) -> xr.Dataset:
    """Return the log evidences of M-0 and M-1 by several methods, and of M-0 under its wide prior by importance sampling."""
    reading, report = study.reading, study.progress(f"evidences for Table {'IV' if table == 4 else 'V'}")
    weighing = ImportanceSettings(study.sizes.importance_draws)
    estimators: dict[str, Estimator] = {
        "importance sampling": partial(importance_evidence, settings=weighing),
        "bridge sampling": partial(_bridge, draws=study.sizes.bridge_draws),
    }
    if study.sizes.smc_particles:
        smc = EvidenceSettings(smc=SMCSettings(study.sizes.smc_particles))
        estimators["tempered SMC"] = lambda model, key: smc_evidence(model, key, smc)
    if study.sizes.nested_live:
        estimators["nested sampling"] = partial(nested_evidence, live=study.sizes.nested_live)
    models, key = _models(reading, table), study.random_key(f"evidence {table}")
    results, total = [], 2 * len(estimators) + 1
    for row, estimate in enumerate(estimators.values()):
        pair = []
        for model in models:
            report(len(pair) + 2 * row, total)
            pair.append(estimate(model, jax.random.fold_in(key, row)))
        results.append(pair)
    report(total - 1, total)
    record = paper_trial(reading, doubted_value(reading, table))
    alone = importance_evidence(paper_posterior(reading, [record], wide(reading)), key, settings=weighing)
    report(total, total)
    return xr.Dataset(
        {
            "log_value": (("method", "model"), [[one.log_value for one in pair] for pair in results]),
            "error": (("method", "model"), [[one.std_error for one in pair] for pair in results]),
            "wide_log_value": ((), alone.log_value),
            "wide_error": ((), alone.std_error),
        },
        {"method": list(estimators), "model": list(MODELS)},
        {"status": [one.status for pair in results for one in pair]},
    )


def odds_part(study: Study) -> xr.Dataset:
    """Return the probability of M-0 by importance sampling over several trials, as the true term grows; priors +-200 % of a printed value.

    Beyond the printed values the prior is that of the larger printed one scaled to hold the true value.
    """
    reading, seeds = study.reading, study.sizes.data_seeds
    values = [*reading.doubted_values, *(factor * reading.doubted_values[1] for factor in LARGER)]
    report, rows, errors = study.progress("probability of M-0 over trials"), [], []
    key = study.random_key("odds")
    for done, (value, seed) in enumerate((value, seed) for value in values for seed in range(1, seeds + 1)):
        report(done, len(values) * seeds)
        record = paper_trial(reading, value, seed)
        full, reduced = (
            importance_evidence(
                paper_posterior(reading, [record], prior), jax.random.fold_in(key, done), settings=WEIGHING
            )
            for prior in (around(value), None)
        )
        rows.append(1.0 / (1.0 + np.exp(reduced.log_value - full.log_value)))
        errors.append(rows[-1] * (1 - rows[-1]) * np.hypot(full.std_error, reduced.std_error))
    report(len(values) * seeds, len(values) * seeds)
    shape = (len(values), seeds)
    return xr.Dataset(
        {
            "probability": (("value", "seed"), np.reshape(rows, shape)),
            "error": (("value", "seed"), np.reshape(errors, shape)),
        },
        {"value": values, "seed": np.arange(1, seeds + 1)},
    )


def doubted_value(reading: Reading, table: int) -> float:
    """True coefficient of the doubted term in Table IV or V."""
    return reading.doubted_values[table - 4]


def listing_1(study: Study) -> Item:
    """Listing 1 itself: how far its answer depends on its seed."""
    numbers, shares, sizes = [], [], []
    for table in (4, 5):
        data, roman = study.part(f"listing-{table}"), "IV" if table == 4 else "V"
        p, shared = data["probability"].values[:, 0], data["shared_probability"].values[:, 0]
        shares.append(_certain(p))
        sizes.append(float(np.median(data["ess"])))
        short = (
            data["log_values"].values - study.part(f"evidence-{table}")["log_value"].sel({"method": REFERENCE}).values
        )
        share = _certain(p)
        numbers += [
            Number(
                f"Table {roman}: median effective sample size of {study.sizes.listing_draws} draws", None, sizes[-1]
            ),
            Number(
                f"Table {roman}: share of seeds with P(M-0) below .01 or above .99",
                None,
                shares[-1],
                sqrt(max(share * (1 - share), 1 / p.size) / p.size),
            ),
            Number(
                f"Table {roman}: share of seeds with P(M-0) above a half",
                None,
                float((p > 0.5).mean()),
                sqrt(0.25 / p.size),
            ),
            Number(
                f"Table {roman}: log Z too low by, mean over seeds [nat]",
                None,
                float(-short.mean()),
                float(short.std() / sqrt(short.shape[0])),
            ),
            Number(f"Table {roman}: sd of log Z over seeds [nat]", None, float(short.std(0).max())),
            Number(
                f"Table {roman}: sd over seeds of log Z of M-0 less that of M-1 [nat]",
                None,
                float(np.diff(short, axis=1).std()),
            ),
            Number(
                f"Table {roman}: P(M-0) with shared draws, mean over seeds",
                None,
                float(shared.mean()),
                float(shared.std() / sqrt(shared.size)),
            ),
            Number(f"Table {roman}: P(M-0) with shared draws, sd over seeds", None, float(shared.std(ddof=1))),
        ]
    stable = min(sizes) >= MIN_ESS
    return Item(
        "listing-1",
        "Listing 1: the Bayes factor algorithm",
        "reproduced" if stable else "contradicted",
        ""
        if stable
        else f"of {study.sizes.listing_draws} prior draws {min(sizes):.1f} are effective: over the seeds, {shares[0]:.0%} "
        f"(Table IV) and {shares[1]:.0%} (Table V) of the answers are certain, for either model at random; numbers such as the "
        "printed ones come only from draws shared by both models, and change with the seed too. No verdict can rest on it",
        tuple(numbers),
        _listing_settings(study),
    )


def table_4(study: Study) -> Item:
    """Probability of M-0 with the small true coefficient."""
    return _table(study, 4)


def table_5(study: Study) -> Item:
    """Probability of M-0 with the larger one."""
    return _table(study, 5)


def odds(study: Study) -> Item:
    """What the data do say: the probability of M-0 over trials, as the true coefficient grows."""
    data = study.part("odds")
    values, p = data["value"].values, data["probability"].values
    numbers = tuple(
        Number(
            f"P(M-0) at {study.reading.doubted} = {value:g}, mean over {p.shape[1]} trials",
            None,
            float(row.mean()),
            _spread(row),
        )
        for value, row in zip(values, p, strict=True)
    )
    decided = [f"{value:g}" for value, row in zip(values, p, strict=True) if row.mean() > 0.95]
    undecided = all(abs(row.mean() - 0.5) < UNDECIDED_MARGIN for row in p[:2])
    printed = all(
        abs(row.mean() - value) < 3 * _spread(row) for row, value in zip(p[:2], PRINTED_M0.values(), strict=True)
    )
    return Item(
        "odds",
        "What the data do say about the doubted term",
        "reproduced" if printed else "contradicted",
        ""
        if printed
        else f"at the first two values the mean probability of M-0 is {p[0].mean():.3f} and {p[1].mean():.3f}"
        + (": the data prefer neither model" if undecided else "")
        + (f"; they decide from {decided[0]} on" if decided else ""),
        numbers,
        trial_settings(study) | {"data_seeds": int(p.shape[1]), "method": REFERENCE},
    )


def probability(log_values: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """P(M-0) at equal prior probabilities from (M-0, M-1), and its Monte Carlo error."""
    p = float(1.0 / (1.0 + np.exp(log_values[1] - log_values[0])))
    return p, p * (1 - p) * float(np.hypot(errors[0], errors[1]))


def draw_listing_1(study: Study) -> "Figure":
    """Draw how the answer of Listing 1 varies from seed to seed, for both tables, over the answers of four other methods."""
    figure, (row,) = panels(PAGE, [200], 2, left=112, top=8, between=16, share_x=False)
    for axes, table in zip(row, (4, 5), strict=True):
        _answers(axes, study, table)
        value = study.reading.doubted_values[table - 4]
        name_axes(axes, f"probability of M-0, true {symbol(study.reading.doubted)} = {plain(value)}")
    row[1].tick_params(labelleft=False)
    return figure


def draw_odds(study: Study) -> "Figure":
    """Draw the probability of M-0 on several trials, one dot for each, against the true value of the doubted term."""
    data = study.part("odds")
    figure, ((axes,),) = panels(COLUMN, [120], 1, top=20)
    p = data["probability"].values
    at = np.arange(p.shape[0])
    spread = np.linspace(-0.16, 0.16, p.shape[1]) if p.shape[1] > 1 else np.zeros(1)
    axes.axhline(0.5, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), label="undecided")
    for row, x in enumerate(at):
        axes.plot(x + spread, p[row], marker="o", markersize=3, color=DOTS, linestyle="none", label="trials")
    axes.plot(at, p.mean(1), marker="D", markersize=5, color=BLUE, linestyle="none", label="mean", zorder=4)
    axes.set_xticks(at, [plain(value) for value in data["value"].values])
    axes.set(xlim=(-0.5, at[-1] + 0.5), ylim=(-0.05, 1.05))
    axes.grid(False, axis="x")
    limit_ticks(axes.yaxis, 5)
    name_axes(axes, with_unit(study.reading, study.reading.doubted, "true "), "probability of M-0")
    key(
        figure,
        {
            "a trial": {"color": DOTS, "marker": "o", "markersize": 3, "linestyle": "none"},
            "mean": {"color": BLUE, "marker": "D", "markersize": 4, "linestyle": "none"},
        },
    )
    return figure


def _models(reading: Reading, table: int) -> list[Posterior]:
    """M-0 and M-1 on the trial of a table."""
    value = doubted_value(reading, table)
    record = paper_trial(reading, value)
    priors: tuple[Uniform | None, ...] = (around(value), None)
    return [paper_posterior(reading, [record], prior) for prior in priors]


def _column(listing: ListingOne, name: str) -> np.ndarray:
    return np.array([evidence.diagnostics[name] for evidence in listing.evidences]).T


def _bridge(posterior: Posterior, key: jax.Array, draws: int) -> Evidence:
    """Bridge sampling from adaptive Metropolis draws, so many of each of 32 chains."""
    mode_key, start_key, chain_key, key = jax.random.split(key, 4)
    mode = find_mode(posterior, key=mode_key)
    settings = ChainSettings(warmup=max(200, draws // 4), draws=draws)
    noise = jax.random.normal(start_key, (settings.chains, posterior.dim))
    starts = jnp.asarray(mode.z) + noise @ jnp.linalg.cholesky(jnp.asarray(mode.cov)).T
    sampled = sample(SAMPLERS["adaptive-metropolis"], posterior, starts, jnp.asarray(mode.cov), chain_key, settings)
    return bridge_evidence(posterior, sampled.z, key)


def _table(study: Study, table: int) -> Item:
    reading, data, listing = study.reading, study.part(f"evidence-{table}"), study.part(f"listing-{table}")
    printed = PRINTED_M0[table]
    numbers = []
    for method in map(str, data["method"].values):
        one = data.sel({"method": method})
        numbers.append(Number(f"P(M-0), {method}", printed, *probability(one["log_value"].values, one["error"].values)))
        numbers += [
            Number(
                f"log Z of {model}, {method}",
                None,
                float(one["log_value"].sel(model=model)),
                float(one["error"].sel(model=model)),
            )
            for model in map(str, data["model"].values)
        ]
    reference = data.sel({"method": REFERENCE})
    p, error = probability(reference["log_value"].values, reference["error"].values)
    values, errors = data["log_value"].values, data["error"].values
    worst = max(
        float((np.abs(values[i] - values[j]) / np.hypot(errors[i], errors[j])).max())
        for i in range(len(values))
        for j in range(i)
    )
    ess = float(np.median(listing["ess"]))
    numbers += [
        Number(
            "log Z of M-0 under its wide prior, importance sampling",
            None,
            float(data["wide_log_value"]),
            float(data["wide_error"]),
        ),
        Number("largest disagreement of two methods, in their errors", None, worst),
        Number("P(M-0) by Listing 1, mean over seeds", printed, float(listing["probability"][:, 0].mean())),
    ]
    settled: Verdict = (
        "reproduced" if ess >= MIN_ESS and (printed is None or abs(p - printed) < 3 * error + 0.02) else "contradicted"
    )
    roman = "IV" if table == 4 else "V"
    preferred = "neither model" if abs(p - 0.5) < UNDECIDED_MARGIN else "M-0" if p > 0.5 else "M-1"
    because = (
        (f"the printed {printed} is" if printed is not None else "an answer of Listing 1 is")
        + f" one draw that here rests on {ess:.1f} effective draws; {len(data['method'])} methods of integration "
        f"agree within {worst:.1f} of their errors on P(M-0) = {p:.3f} ± {error:.3f}: the data prefer {preferred}"
    )
    return Item(
        f"table-{table}",
        f"Table {roman}: Bayes factor at {reading.doubted} = {doubted_value(reading, table):g}",
        settled,
        "" if settled == "reproduced" else because,
        tuple(numbers),
        _listing_settings(study)
        | {reading.doubted: doubted_value(reading, table), "nested_live": study.sizes.nested_live},
    )


def _certain(p: np.ndarray) -> float:
    return float(((p < 0.01) | (p > 0.99)).mean())


def _spread(row: np.ndarray) -> float:
    return float(row.std(ddof=1) / sqrt(row.size)) if row.size > 1 else 0.0


def _listing_settings(study: Study) -> dict:
    sizes = study.sizes
    return trial_settings(study) | {
        "listing_seeds": sizes.listing_repeats,
        "listing_draws": sizes.listing_draws,
        "listing_seeds_shared": sizes.listing_shared,
    }


def _answers(axes: "Axes", study: Study, table: int) -> None:
    listing, evidence = study.part(f"listing-{table}"), study.part(f"evidence-{table}")
    ticks, y = [], 0.0
    for name, title, colour in (
        ("probability", "independent draws", ORANGE),
        ("shared_probability", "shared draws", PURPLE),
    ):
        p = listing[name].sel(model="M-0").values
        share = np.histogram(p, BINS)[0] / p.size
        y -= TALL
        axes.stairs(y + TALLEST * share, BINS, baseline=y, fill=True, color=colour, alpha=0.6, label=title)
        axes.axhline(y, color=MUTED, linewidth=0.6)
        for edge, inside, nearby in ((0.0, p < BINS[1], share[:3]), (1.0, p > BINS[-2], share[-3:])):
            if inside.any():
                axes.annotate(
                    f"{100 * inside.mean():.0f} %",
                    (edge, y + TALLEST * nearby.max()),
                    xytext=(-3 if edge else 3, 2),
                    textcoords="offset points",
                    ha="right" if edge else "left",
                    fontsize=TEXT,
                    color=INK,
                )
        ticks.append((y + 0.45, f"Listing 1, {p.size} seeds,\n{title}"))
    printed = PRINTED_PROBABILITIES[table]
    y -= 1
    axes.plot(printed, y, marker="D", markersize=5, color=INK, linestyle="none", label="printed")
    ticks.append((y, "as printed"))
    for row, method in enumerate(map(str, evidence["method"].values)):
        p, error = probability(evidence["log_value"].values[row], evidence["error"].values[row])
        y -= 1
        axes.errorbar(
            p, y, xerr=[[min(error, p)], [min(error, 1 - p)]], color=BLUE, marker="o", markersize=4, label=method
        )
        ticks.append((y, method))
    axes.set(xlim=(-0.02, 1.02), ylim=(y - 0.7, 0))
    axes.set_yticks([at for at, _ in ticks], [text for _, text in ticks])
    axes.grid(False, axis="y")
