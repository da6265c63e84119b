"""Section IV, estimation: Table III, Figures 5 and 6, and what the text says of the samplers."""

import numpy as np
import xarray as xr

from studies.remus100.compute.chains import AFAR
from studies.remus100.compute.trial import paper_posterior, paper_trial
from studies.remus100.items import Item, Number
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES
from studies.remus100.verdicts.settings import chain_settings

TABLE_3 = {"X_u": (-1.44, 0.08), "X_uabsu": (-2.81, 0.04), "T_nabsn": (6.28, 0.10)}
MAX_R_HAT = 1.01
START = {"start": "posterior mode, others about it"}


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
        "reproduced in shape" if near else "differs",
        f"the data's seed is not printed: the estimates lie within {z:.1f} standard deviations of the truth"
        + (f", the printed ones within {_printed_z(study):.1f} of theirs" if study.reading.is_paper else "")
        + f"; the standard deviations are {sds}"
        + (", and the 0.10 printed for T is reached by no input tried" if study.reading.is_paper else ""),
        tuple(numbers),
        chain_settings(study) | START,
    )


def figure_5(study: Study) -> Item:
    """The hierarchical model, drawn from the posterior that is sampled."""
    posterior = paper_posterior(study.reading, [paper_trial(study.reading, None)], None)
    wanted = {*NAMES, "sigma_u"}
    return Item(
        "figure-5",
        "Figure 5: the hierarchical model",
        "reproduced" if set(posterior.names) == wanted else "differs",
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
    return chain_figure(study, "figure-6", "Figure 6: the run of Table III", "chain-3")


def chain_figure(study: Study, key: str, title: str, part: str) -> Item:
    """One figure of traces, autocorrelation and marginals."""
    data = study.part(part)
    scores, printed = np.abs(data["geweke"].values), np.abs(data["printed_geweke"].values)
    inside, r_hat = float((scores < 2).mean()), float(data["r_hat"].max())
    moving = int(np.argmax((data["acf"] < 0.05).all("parameter").values)) or int(data.sizes["lag"])
    return Item(
        key,
        title,
        "reproduced in shape" if inside > 0.8 and r_hat < MAX_R_HAT else "differs",
        f"no number is printed: {inside:.0%} of the Geweke scores lie within 2 and R-hat is at most {r_hat:.4f}; the "
        "score as printed, with the plain "
        f"variance of the draws, reaches {printed.max():.2f} and could hardly fail, so the one drawn has the "
        "variance of the mean",
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
        "reproduced" if holds else "differs",
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
        "reproduced" if mode < half else "differs",
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
        "reproduced" if holds else "differs",
        ""
        if holds
        else f"the worst lies {worst:.1f} standard deviations away, skewness up to {skew:.2f}, excess kurtosis up to "
        f"{kurtosis:.2f}",
        (
            Number("largest distance from the truth, standard deviations", None, worst),
            *([Number("the same of the printed Table III", None, _printed_z(study))] if study.reading.is_paper else []),
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
        "reproduced" if ratio > 100 else "differs",
        "" if ratio > 100 else f"sampling takes only {ratio:.0f} times as long",
        (
            Number("one design by the square-root UKF, in a sweep [ms]", None, 1e3 * seconds),
            Number("one posterior by adaptive Metropolis [s]", None, float(chain["seconds"])),
            Number("ratio", None, ratio),
        ),
        chain_settings(study) | START,
    )


def _rows(study: Study, data: xr.Dataset, printed: dict[str, tuple[float, float]]) -> list[Number]:
    rows = []
    for name in map(str, data["parameter"].values):
        one = data.sel(parameter=name)
        mean, sd = printed.get(name, (None, None))
        ess = float(one["ess"])
        rows += [
            Number(f"{name}, mean", study.reading.printed(mean), float(one["mean"]), float(one["mcse"])),
            Number(f"{name}, sd", study.reading.printed(sd), float(one["sd"]), float(one["sd"]) / np.sqrt(2 * ess)),
            Number(f"{name}, true value", None, float(one["truth"])),
        ]
    return rows


def _worst_z(data: xr.Dataset) -> float:
    return float((np.abs(data["mean"] - data["truth"]) / data["sd"]).max())


def _printed_z(study: Study) -> float:
    return max(abs(mean - study.reading.printed_truth[name]) / sd for name, (mean, sd) in TABLE_3.items())
