"""Section IV, selection: Listing 1, Tables IV to VI, Figures 7 and 8, and what the text says of them."""

from math import sqrt

import numpy as np
import xarray as xr

from seatrial.campaign.paper.compute.evidence import doubted_value
from seatrial.campaign.paper.items import Item, Number, Verdict
from seatrial.campaign.paper.judge.estimation import chain_figure
from seatrial.campaign.paper.reading import NAMES
from seatrial.campaign.paper.study import Study
from seatrial.selection.prior_monte_carlo import MIN_ESS

PRINTED_M0 = {4: 0.4642, 5: 0.5501}
"""Printed probability of M-0."""
TABLE_6 = {
    "chain-6-full": {"X_u": (-0.97, 0.37), "X_uabsu": (-3.05, 0.19), "T_nabsn": (6.28, 0.10), "X_du3": (7.78, 9.65)},
    "chain-6-reduced": {"X_u": (-1.26, 0.07), "X_uabsu": (-2.90, 0.04), "T_nabsn": (6.28, 0.10)},
}
CRITERIA = {
    "chain-6-full": {"DIC": -13939.8, "BPIC": -13934.6, "p_D": 5.2},
    "chain-6-reduced": {"DIC": -13940.6, "BPIC": -13935.9, "p_D": 4.8},
}
MODEL = {"chain-6-full": "M-0", "chain-6-reduced": "M-1"}
REFERENCE = "importance sampling"
UNDECIDED = 0.1
"""A probability this near to a half prefers neither model."""
TIE = 0.3
"""A difference of two criteria below this decides nothing, whatever its error."""


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
        _settings(study) | {"data_seeds": int(p.shape[1]), "method": REFERENCE},
    )


def table_6(study: Study) -> Item:
    """Estimates and criteria of both models."""
    numbers = []
    for part, rows in TABLE_6.items():
        data = study.part(part)
        numbers += [number for name, printed in rows.items() for number in _estimates(study, data, part, name, printed)]
        for name in map(str, data["criterion"].values):
            row = data.sel(criterion=name)
            printed = CRITERIA[part].get(name)
            numbers.append(
                Number(
                    f"{name} of {MODEL[part]}",
                    study.reading.printed(printed),
                    float(row["criterion_value"]),
                    float(row["criterion_error"]),
                )
            )
    deltas = {name: _delta(study, name) for name in ("DIC", "BPIC", "WAIC", "PSIS-LOO")}
    printed_full, printed_reduced = CRITERIA.values()
    for name, delta in deltas.items():
        printed = printed_reduced[name] - printed_full[name] if name in printed_full else None
        numbers.append(Number(f"{name} of M-1 less that of M-0", study.reading.printed(printed), *delta))
    healthy, tighter = max(float(study.part(part)["r_hat"].max()) for part in TABLE_6) < 1.01, _tighter(study)
    ties = [name for name, (value, error) in deltas.items() if abs(value) < max(TIE, 2 * error)]
    return Item(
        "table-6",
        "Table VI: estimates and criteria of M-0 and M-1",
        "reproduced in shape" if healthy and tighter else "differs",
        "the data's seed is not printed: M-1 is "
        + (
            "tighter and nearer the truth, as printed; "
            if tighter
            else "not tighter and nearer in every drag coefficient; "
        )
        + ("" if healthy else "the chains have not converged; ")
        + (f"{', '.join(ties)} tie" if ties else "no criterion ties")
        + " (M-1 less M-0: "
        + ", ".join(f"{name} {value:+.1f} ± {error:.1f}" for name, (value, error) in deltas.items())
        + ")"
        + ("; 4.8 effective parameters cannot be had from four" if study.reading.is_paper else ""),
        tuple(numbers),
        _settings(study),
    )


def figure_7(study: Study) -> Item:
    """The run of M-0."""
    return chain_figure(study, "figure-7", "Figure 7: the run of M-0", "chain-6-full")


def figure_8(study: Study) -> Item:
    """The run of M-1."""
    return chain_figure(study, "figure-8", "Figure 8: the run of M-1", "chain-6-reduced")


def claim_extra_term(study: Study) -> Item:
    """The standard error of the extra term is nearly two orders of magnitude above its true value."""
    one = study.part("chain-6-full").sel(parameter=study.reading.doubted)
    ratio = float(one["sd"] / abs(one["truth"]))
    return Item(
        "claim-extra-term",
        "The standard error of the extra term is nearly a hundred times its value",
        "reproduced" if 30 < ratio < 300 else "differs",
        "" if 30 < ratio < 300 else f"it is {ratio:.0f} times",
        (Number("standard deviation over true value", study.reading.printed(96.5), ratio),),
        _settings(study),
    )


def claim_tighter(study: Study) -> Item:
    """Without the extra term the estimates are closer to the truth, with lower variance."""
    holds = _tighter(study)
    sds = {part: study.part(part)["sd"].sel(parameter=list(NAMES)).values for part in TABLE_6}
    errors = {
        part: np.abs((study.part(part)["mean"] - study.part(part)["truth"]).sel(parameter=list(NAMES)).values)
        for part in TABLE_6
    }
    numbers = [
        Number(f"{name} {MODEL[part]}, {what}", None, float(values[part][i]))
        for i, name in enumerate(NAMES)
        for what, values in (("sd", sds), ("distance from the truth", errors))
        for part in TABLE_6
    ]
    return Item(
        "claim-tighter",
        "The reduced model's estimates are closer and tighter",
        "reproduced" if holds else "differs",
        "" if holds else "not for every drag coefficient of this trial",
        tuple(numbers),
        _settings(study),
    )


def claim_criteria_favour(study: Study) -> Item:
    """DIC and BPIC favour the reduced model."""
    deltas = {name: _delta(study, name) for name in ("DIC", "BPIC", "WAIC", "PSIS-LOO")}
    clear = [name for name in ("DIC", "BPIC") if deltas[name][0] < -2 * deltas[name][1]]
    holds = len(clear) == 2
    return Item(
        "claim-criteria-favour",
        "DIC and BPIC favour the reduced model",
        "reproduced" if holds else "differs",
        ""
        if holds
        else f"DIC differs by {deltas['DIC'][0]:+.2f} ± {deltas['DIC'][1]:.2f} and BPIC by {deltas['BPIC'][0]:+.2f} "
        f"± {deltas['BPIC'][1]:.2f} (M-1 less M-0): "
        + ("only BPIC, which counts each parameter twice, leans to M-1" if clear == ["BPIC"] else _leaning(deltas)),
        tuple(Number(f"{name} of M-1 less that of M-0", None, *delta) for name, delta in deltas.items()),
        _settings(study),
    )


def claim_criteria_insensitive(study: Study) -> Item:
    """The criteria change by less than 1 %, and so are less useful."""
    share = abs(_delta(study, "DIC")[0]) / abs(_criterion(study, "chain-6-reduced", "DIC"))
    return Item(
        "claim-criteria-insensitive",
        "DIC and BPIC change by less than 1 % and decide little",
        "reproduced in shape" if share < 0.01 else "differs",
        f"they change by {share:.4%}, but the percentage is the wrong yardstick: their level is arbitrary (it moves "
        "with the unit of u), and "
        "only differences beside their errors mean something",
        (Number("relative change of DIC", study.reading.printed(0.8 / 13940), share),),
        _settings(study),
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


def _estimates(study: Study, data: xr.Dataset, part: str, name: str, printed: tuple[float, float]) -> list[Number]:
    one = data.sel(parameter=study.reading.doubted if name == "X_du3" else name)
    return [
        Number(
            f"{name} {MODEL[part]}, mean", study.reading.printed(printed[0]), float(one["mean"]), float(one["mcse"])
        ),
        Number(
            f"{name} {MODEL[part]}, sd",
            study.reading.printed(printed[1]),
            float(one["sd"]),
            float(one["sd"] / np.sqrt(2 * one["ess"])),
        ),
    ]


def _criterion(study: Study, part: str, name: str, what: str = "criterion_value") -> float:
    return float(study.part(part)[what].sel(criterion=name))


def _delta(study: Study, name: str) -> tuple[float, float]:
    """Criterion of M-1 less that of M-0, with its Monte Carlo error."""
    values, errors = (
        [_criterion(study, part, name, what) for part in TABLE_6] for what in ("criterion_value", "criterion_error")
    )
    return values[1] - values[0], float(np.hypot(errors[0], errors[1]))


def _leaning(deltas: dict[str, tuple[float, float]]) -> str:
    """Which model DIC and BPIC favour beyond twice their errors, in words."""
    toward = {name: "M-1" if value < 0 else "M-0" for name, (value, error) in deltas.items() if abs(value) > 2 * error}
    said = [f"{name} favours {toward[name]}" for name in ("DIC", "BPIC") if name in toward]
    return " and ".join(said) or "a tie within Monte Carlo error"


def _tighter(study: Study) -> bool:
    """Whether both drag coefficients of M-1 are nearer the truth, and of smaller standard deviation, than those of M-0."""
    full, reduced = (study.part(part).sel(parameter=list(NAMES[:2])) for part in TABLE_6)
    nearer = np.abs(reduced["mean"] - reduced["truth"]) < np.abs(full["mean"] - full["truth"])
    return bool((nearer & (reduced["sd"] < full["sd"])).all())


def _certain(p: np.ndarray) -> float:
    return float(((p < 0.01) | (p > 0.99)).mean())


def _share_error(p: np.ndarray) -> float:
    share = _certain(p)
    return sqrt(max(share * (1 - share), 1 / p.size) / p.size)


def _spread(row: np.ndarray) -> float:
    return float(row.std(ddof=1) / sqrt(row.size)) if row.size > 1 else 0.0


def _settings(study: Study) -> dict:
    sizes = study.sizes
    return {
        "reading": study.reading.name,
        "chains": sizes.chains,
        "burn_in": sizes.burn_in,
        "draws": sizes.draws,
        "data_seed": 1,
        "sigma": study.reading.sigma,
        "seed": study.seed,
    }


def _listing_settings(study: Study) -> dict:
    sizes = study.sizes
    return {
        "reading": study.reading.name,
        "listing_seeds": sizes.listing_repeats,
        "listing_draws": sizes.listing_draws,
        "listing_seeds_shared": sizes.listing_shared,
        "data_seed": 1,
        "sigma": study.reading.sigma,
        "seed": study.seed,
    }
