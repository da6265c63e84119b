"""Section IV, selection by evidence: Listing 1, Tables IV and V, and what the data do say."""

from math import sqrt

import numpy as np
import xarray as xr

from seatrial.selection.prior_monte_carlo import MIN_ESS
from studies.remus100.compute.evidence import doubted_value
from studies.remus100.items import Item, Number, Verdict
from studies.remus100.study import Study
from studies.remus100.verdicts.settings import trial_settings

PRINTED_M0 = {4: 0.4642, 5: 0.5501}
"""Printed probability of M-0."""
REFERENCE = "importance sampling"
UNDECIDED = 0.1
"""A probability this near to a half prefers neither model."""


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
        numbers += [
            Number(
                f"Table {roman}: median effective sample size of {study.sizes.listing_draws} draws", None, sizes[-1]
            ),
            Number(
                f"Table {roman}: share of seeds with P(M-0) below .01 or above .99", None, shares[-1], _share_error(p)
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
        "reproduced" if stable else "cannot hold",
        ""
        if stable
        else f"of {study.sizes.listing_draws} prior draws {min(sizes):.1f} count: with another seed {shares[0]:.0%} "
        f"(Table IV) and {shares[1]:.0%} (Table V) of "
        "its answers are certain, for one model or the other like a coin; only draws shared by both models give "
        "numbers such as the printed "
        "ones, and they too change with the seed. No verdict may rest on it",
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
    told = [f"{value:g}" for value, row in zip(values, p, strict=True) if row.mean() > 0.95]
    undecided = all(abs(row.mean() - 0.5) < UNDECIDED for row in p[:2])
    printed = study.reading.is_paper and all(
        abs(row.mean() - value) < 3 * _spread(row) for row, value in zip(p[:2], PRINTED_M0.values(), strict=True)
    )
    return Item(
        "odds",
        "What the data do say about the doubted term",
        "reproduced" if printed else "cannot hold" if undecided else "differs",
        ""
        if printed
        else f"at the first two values the mean probability of M-0 is {p[0].mean():.3f} and {p[1].mean():.3f}"
        + (": the data prefer neither model" if undecided else "")
        + (f"; they tell from {told[0]} on" if told else ""),
        numbers,
        trial_settings(study) | {"data_seeds": int(p.shape[1]), "method": REFERENCE},
    )


def _table(study: Study, table: int) -> Item:
    reading, data, listing = study.reading, study.part(f"evidence-{table}"), study.part(f"listing-{table}")
    printed = reading.printed(PRINTED_M0[table])
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
    worst = _disagreement(data)
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
        "reproduced" if ess >= MIN_ESS and (printed is None or abs(p - printed) < 3 * error + 0.02) else "cannot hold"
    )
    roman = "IV" if table == 4 else "V"
    preferred = "neither model" if abs(p - 0.5) < UNDECIDED else "M-0" if p > 0.5 else "M-1"
    because = (
        (f"the printed {printed} is" if printed is not None else "an answer of Listing 1 is")
        + f" one draw that here rests on {ess:.1f} effective draws; {len(data['method'])} methods that share no code "
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


def probability(log_values: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """P(M-0) at equal prior probabilities from (M-0, M-1), and its Monte Carlo error."""
    p = float(1.0 / (1.0 + np.exp(log_values[1] - log_values[0])))
    return p, p * (1 - p) * float(np.hypot(errors[0], errors[1]))


def _disagreement(data: xr.Dataset) -> float:
    """Largest difference of two methods' log evidences of one model, in units of their joint error."""
    values, errors = data["log_value"].values, data["error"].values
    return max(
        float((np.abs(values[i] - values[j]) / np.hypot(errors[i], errors[j])).max())
        for i in range(len(values))
        for j in range(i)
    )


def _certain(p: np.ndarray) -> float:
    return float(((p < 0.01) | (p > 0.99)).mean())


def _share_error(p: np.ndarray) -> float:
    share = _certain(p)
    return sqrt(max(share * (1 - share), 1 / p.size) / p.size)


def _spread(row: np.ndarray) -> float:
    return float(row.std(ddof=1) / sqrt(row.size)) if row.size > 1 else 0.0


def _listing_settings(study: Study) -> dict:
    sizes = study.sizes
    return trial_settings(study) | {
        "listing_seeds": sizes.listing_repeats,
        "listing_draws": sizes.listing_draws,
        "listing_seeds_shared": sizes.listing_shared,
    }
