"""Section IV by Markov chains: Tables III and VI, Figures 5 to 8, and what the text says of samplers and information criteria."""

import numpy as np
import xarray as xr

from seatrial.sampling.diagnostics import MAX_R_HAT
from studies.remus100.chains import AFAR
from studies.remus100.reading import NAMES
from studies.remus100.study import Item, Number, Study, chain_settings
from studies.remus100.trial import paper_posterior, paper_trial

TABLE_3 = {"X_u": (-1.44, 0.08), "X_uabsu": (-2.81, 0.04), "T_nabsn": (6.28, 0.10)}
START = {"start": "posterior mode, others about it"}
TABLE_6 = {
    "chain-6-full": {"X_u": (-0.97, 0.37), "X_uabsu": (-3.05, 0.19), "T_nabsn": (6.28, 0.10), "X_du3": (7.78, 9.65)},
    "chain-6-reduced": {"X_u": (-1.26, 0.07), "X_uabsu": (-2.90, 0.04), "T_nabsn": (6.28, 0.10)},
}
CRITERIA = {
    "chain-6-full": {"DIC": -13939.8, "BPIC": -13934.6, "p_D": 5.2},
    "chain-6-reduced": {"DIC": -13940.6, "BPIC": -13935.9, "p_D": 4.8},
}
MODEL = {"chain-6-full": "M-0", "chain-6-reduced": "M-1"}
TIE = 0.3  # A difference of two criteria below this decides nothing, whatever its error


def table_3(study: Study) -> Item:
    """Estimates of the surge model by adaptive Metropolis."""
    data = study.part("chain-3")
    numbers = _rows(study, data, TABLE_3)
    z = _worst_z(data)
    near = z < 3 and float(data["r_hat"].max()) < MAX_R_HAT
    sds = ", ".join(f"{float(data['sd'].sel(parameter=name)):.2f}" for name in NAMES)
    return Item(
        "table-3",
        "Table III: estimates by adaptive Metropolis",
        "not comparable" if near else "contradicted",
        f"the data's seed is not printed: the estimates lie within {z:.1f} standard deviations of the truth"
        f", the printed ones within {_printed_z(study):.1f} of theirs; the standard deviations are {sds}"
        ", and no input that was tried gives the 0.10 printed for T",
        tuple(numbers),
        chain_settings(study) | START,
    )


def figure_5(study: Study) -> Item:
    """The hierarchical model: the parameters of the posterior that is sampled, and their priors."""
    posterior = paper_posterior(study.reading, [paper_trial(study.reading, None)], None)
    wanted = {*NAMES, "sigma_u"}
    return Item(
        "figure-5",
        "Figure 5: the hierarchical model",
        "reproduced" if set(posterior.names) == wanted else "contradicted",
        "" if set(posterior.names) == wanted else f"the model holds {', '.join(posterior.names)}",
        tuple(
            Number(f"{p.name}, {end} bound of the prior [{p.unit}]", None, bound)
            for p in posterior.parameters
            for end, bound in zip(("lower", "upper"), p.prior.bounds, strict=True)
        ),
        chain_settings(study) | START,
    )


def figure_6(study: Study) -> Item:
    """Traces with Geweke scores, autocorrelation and marginals of the run of Table III."""
    return judge_chain(study, "figure-6", "Figure 6: the run of Table III", "chain-3")


def judge_chain(study: Study, key: str, title: str, part: str) -> Item:
    """One figure of traces, autocorrelation and marginals."""
    data = study.part(part)
    scores, printed = np.abs(data["geweke"].values), np.abs(data["printed_geweke"].values)
    inside, r_hat = float((scores < 2).mean()), float(data["r_hat"].max())
    moving = int(np.argmax((data["acf"] < 0.05).all("parameter").values)) or int(data.sizes["lag"])
    return Item(
        key,
        title,
        "not comparable",
        f"no number is printed: {inside:.0%} of the Geweke scores lie within 2 and R-hat is at most {r_hat:.4f}; the "
        f"printed score, with the variance of the draws, reaches {printed.max():.2f} at most and can hardly fail, so the figure "
        "shows the score with the variance of the mean",
        (
            Number("share of Geweke scores within 2, variance of the mean", None, inside),
            Number("largest Geweke score, variance of the mean", None, float(scores.max())),
            Number("largest Geweke score as printed", None, float(printed.max())),
            Number("largest R-hat", None, r_hat),
            Number("smallest effective sample size", None, float(data["ess"].min())),
            Number("acceptance", None, float(data["acceptance"])),
            Number("lag at which every detrended autocorrelation is below 0.05", None, moving),
        ),
        chain_settings(study) | START,
    )


def claim_sampler(study: Study) -> Item:
    """Adaptive Metropolis gives similar results, vastly quicker, and works better on correlated variables."""
    ours, rival = study.part("chain-3"), study.part("chain-3-metropolis")
    rates = {name: float(d["ess"].min() / d["seconds"]) for name, d in (("AM", ours), ("MH", rival))}
    gap = np.abs(ours["mean"] - rival["mean"]) / np.hypot(ours["mcse"], rival["mcse"])
    similar, quicker = float(gap.max()) < 4, rates["AM"] / rates["MH"]
    cov = ours["covariance"].values
    correlation = cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1])
    numbers = [
        Number("correlation of X_u and X_uabsu", None, float(correlation)),
        Number("AM over MH, effective samples per second", None, quicker),
    ]
    for name, data in (("AM", ours), ("MH", rival)):
        numbers += [
            Number(f"{name}, effective samples per second, worst parameter", None, rates[name]),
            Number(f"{name}, largest R-hat", None, float(data["r_hat"].max())),
            Number(f"{name}, mean of X_u", None, float(data["mean"][0]), float(data["mcse"][0])),
        ]
    holds = similar and quicker > 10
    return Item(
        "claim-sampler",
        "Adaptive Metropolis agrees with Metropolis-Hastings and is vastly quicker",
        "reproduced" if holds else "contradicted",
        ""
        if holds
        else f"it is {quicker:.0f} times quicker in effective samples, and the means differ by at most "
        f"{float(gap.max()):.1f} Monte Carlo errors",
        tuple(numbers),
        chain_settings(study) | START,
    )


def claim_start(study: Study) -> Item:
    """Starting at the posterior mode helps, and a burn-in is still of use."""
    near = study.part("starts")["height"] > -AFAR
    arrived = near.argmax("iteration").where(near.any("iteration"), near.sizes["iteration"] - 1).astype(int)
    steps = {str(name): float(near["iteration"][arrived.sel(start=name).values].max()) for name in near["start"].values}
    half, mode = steps.values()
    return Item(
        "claim-start",
        "Seeding with the posterior mode improves the start",
        "reproduced" if mode < half else "contradicted",
        "" if mode < half else "chains from half the truth arrive as soon",
        tuple(
            Number(f"iterations until within {AFAR:g} nats of the mode, from {name}", None, value)
            for name, value in steps.items()
        ),
        chain_settings(study) | START,
    )


def claim_near_normal(study: Study) -> Item:
    """Posterior estimates within three standard deviations of the truth, nearly normal."""
    data, worst = study.part("chain-3"), _worst_z(study.part("chain-3"))
    draws = data["draws"].values.reshape(-1, data.sizes["parameter"])
    z = (draws - draws.mean(0)) / draws.std(0)
    skew, kurtosis = np.abs((z**3).mean(0)).max(), np.abs((z**4).mean(0) - 3).max()
    holds = worst < 3 and skew < 0.2 and kurtosis < 0.4
    return Item(
        "claim-near-normal",
        "Estimates lie within three standard deviations of the truth, nearly normal",
        "reproduced" if holds else "contradicted",
        ""
        if holds
        else f"the worst lies {worst:.1f} standard deviations away, skewness up to {skew:.2f}, excess kurtosis up to "
        f"{kurtosis:.2f}",
        (
            Number("largest distance from the truth, standard deviations", None, worst),
            Number("the same of the printed Table III", None, _printed_z(study)),
            Number("largest skewness", None, float(skew)),
            Number("largest excess kurtosis", None, float(kurtosis)),
        ),
        chain_settings(study) | START,
    )


def claim_single_pass(study: Study) -> Item:
    """Sampling is costly inside an outer loop: a single-pass filter judges a design far sooner."""
    chain, sweep = study.part("chain-3"), study.part("sweep-medium")
    seconds = float(sweep["seconds"]) / sweep["gain"].size
    ratio = float(chain["seconds"]) / seconds
    return Item(
        "claim-single-pass",
        "A filter judges a design far sooner than sampling does",
        "reproduced" if ratio > 100 else "contradicted",
        "" if ratio > 100 else f"sampling takes only {ratio:.0f} times as long",
        (
            Number("one design by the square-root UKF, in a sweep [ms]", None, 1e3 * seconds),
            Number("one posterior by adaptive Metropolis [s]", None, float(chain["seconds"])),
            Number("ratio", None, ratio),
        ),
        chain_settings(study) | START,
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
                    printed,
                    float(row["criterion_value"]),
                    float(row["criterion_error"]),
                )
            )
    deltas = {name: _delta(study, name) for name in ("DIC", "BPIC", "WAIC", "PSIS-LOO")}
    printed_full, printed_reduced = CRITERIA.values()
    for name, delta in deltas.items():
        printed = printed_reduced[name] - printed_full[name] if name in printed_full else None
        numbers.append(Number(f"{name} of M-1 less that of M-0", printed, *delta))
    healthy, tighter = max(float(study.part(part)["r_hat"].max()) for part in TABLE_6) < MAX_R_HAT, _tighter(study)
    ties = [name for name, (value, error) in deltas.items() if abs(value) < max(TIE, 2 * error)]
    return Item(
        "table-6",
        "Table VI: estimates and criteria of M-0 and M-1",
        "contradicted" if healthy and not tighter else "not comparable",
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
        + "); a model of four parameters cannot have 4.8 effective ones",
        tuple(numbers),
        chain_settings(study),
    )


def figure_7(study: Study) -> Item:
    """The run of M-0."""
    return judge_chain(study, "figure-7", "Figure 7: the run of M-0", "chain-6-full")


def figure_8(study: Study) -> Item:
    """The run of M-1."""
    return judge_chain(study, "figure-8", "Figure 8: the run of M-1", "chain-6-reduced")


def claim_extra_term(study: Study) -> Item:
    """The standard error of the extra term is nearly two orders of magnitude above its true value."""
    one = study.part("chain-6-full").sel(parameter=study.reading.doubted)
    ratio = float(one["sd"] / abs(one["truth"]))
    return Item(
        "claim-extra-term",
        "The standard error of the extra term is nearly a hundred times its value",
        "reproduced" if 30 < ratio < 300 else "contradicted",
        "" if 30 < ratio < 300 else f"it is {ratio:.0f} times",
        (Number("standard deviation over true value", 96.5, ratio),),
        chain_settings(study),
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
        "reproduced" if holds else "contradicted",
        "" if holds else "not for every drag coefficient of this trial",
        tuple(numbers),
        chain_settings(study),
    )


def claim_criteria_favour(study: Study) -> Item:
    """DIC and BPIC favour the reduced model."""
    deltas = {name: _delta(study, name) for name in ("DIC", "BPIC", "WAIC", "PSIS-LOO")}
    clear = [name for name in ("DIC", "BPIC") if deltas[name][0] < -2 * deltas[name][1]]
    holds = len(clear) == 2
    return Item(
        "claim-criteria-favour",
        "DIC and BPIC favour the reduced model",
        "reproduced" if holds else "contradicted",
        ""
        if holds
        else f"DIC differs by {deltas['DIC'][0]:+.2f} ± {deltas['DIC'][1]:.2f} and BPIC by {deltas['BPIC'][0]:+.2f} "
        f"± {deltas['BPIC'][1]:.2f} (M-1 less M-0): "
        + ("only BPIC, which counts each parameter twice, leans to M-1" if clear == ["BPIC"] else _leaning(deltas)),
        tuple(Number(f"{name} of M-1 less that of M-0", None, *delta) for name, delta in deltas.items()),
        chain_settings(study),
    )


def claim_criteria_insensitive(study: Study) -> Item:
    """The criteria change by less than 1 %, and so are less useful."""
    share = abs(_delta(study, "DIC")[0]) / abs(_criterion(study, "chain-6-reduced", "DIC"))
    return Item(
        "claim-criteria-insensitive",
        "DIC and BPIC change by less than 1 % and decide little",
        "reproduced" if share < 0.01 else "contradicted",
        f"they change by {share:.4%}, but a percentage is the wrong measure: the level of both is arbitrary (it changes "
        "with the unit of u), and only differences compared with their errors have a meaning",
        (Number("relative change of DIC", 0.8 / 13940, share),),
        chain_settings(study),
    )


def _rows(study: Study, data: xr.Dataset, printed: dict[str, tuple[float, float]]) -> list[Number]:
    rows = []
    for name in map(str, data["parameter"].values):
        one = data.sel(parameter=name)
        mean, sd = printed.get(name, (None, None))
        ess = float(one["ess"])
        rows += [
            Number(f"{name}, mean", mean, float(one["mean"]), float(one["mcse"])),
            Number(f"{name}, sd", sd, float(one["sd"]), float(one["sd"]) / np.sqrt(2 * ess)),
            Number(f"{name}, true value", None, float(one["truth"])),
        ]
    return rows


def _worst_z(data: xr.Dataset) -> float:
    return float((np.abs(data["mean"] - data["truth"]) / data["sd"]).max())


def _printed_z(study: Study) -> float:
    return max(abs(mean - study.reading.printed_truth[name]) / sd for name, (mean, sd) in TABLE_3.items())


def _estimates(study: Study, data: xr.Dataset, part: str, name: str, printed: tuple[float, float]) -> list[Number]:
    one = data.sel(parameter=name)
    return [
        Number(f"{name} {MODEL[part]}, mean", printed[0], float(one["mean"]), float(one["mcse"])),
        Number(
            f"{name} {MODEL[part]}, sd",
            printed[1],
            float(one["sd"]),
            float(one["sd"] / np.sqrt(2 * one["ess"])),
        ),
    ]


def _criterion(study: Study, part: str, name: str, what: str = "criterion_value") -> float:
    return float(study.part(part)[what].sel(criterion=name))


def _delta(study: Study, name: str) -> tuple[float, float]:
    """Return the criterion of M-1 less that of M-0, with its Monte Carlo error."""
    values, errors = (
        [_criterion(study, part, name, what) for part in TABLE_6] for what in ("criterion_value", "criterion_error")
    )
    return values[1] - values[0], float(np.hypot(errors[0], errors[1]))


def _leaning(deltas: dict[str, tuple[float, float]]) -> str:
    """Return which model DIC and BPIC favour beyond twice their errors, in words."""
    toward = {name: "M-1" if value < 0 else "M-0" for name, (value, error) in deltas.items() if abs(value) > 2 * error}
    favours = [f"{name} favours {toward[name]}" for name in ("DIC", "BPIC") if name in toward]
    return " and ".join(favours) or "a tie within Monte Carlo error"


def _tighter(study: Study) -> bool:
    """Return whether both drag coefficients of M-1 are nearer the truth, and of smaller standard deviation, than those of M-0."""
    full, reduced = (study.part(part).sel(parameter=list(NAMES[:2])) for part in TABLE_6)
    nearer = np.abs(reduced["mean"] - reduced["truth"]) < np.abs(full["mean"] - full["truth"])
    return bool((nearer & (reduced["sd"] < full["sd"])).all())
