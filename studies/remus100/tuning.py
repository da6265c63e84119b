"""Section III, the remarks on P, Q and R: the square-root UKF with each of them made too large, and R from the data."""

import json

import numpy as np
import xarray as xr

from seatrial.filters.noise_from_differences import noise_from_high_pass
from seatrial.filters.run import FilterTrace
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.tuning import check_tuning
from seatrial.messages.render import sentence
from seatrial.numerics.gaussian import Gaussian
from studies.remus100.filters import (
    FIRST_SEED,
    N_STEPS,
    STEP,
    filter_space,
    in_printed_units,
    make_trials,
    run_over_seeds,
)
from studies.remus100.reading import NAMES
from studies.remus100.study import Item, Number, Study

CHANGES = {"as printed": {}, "P x 1e4": {"p": 1e4}, "Q x 1e4": {"q": 1e4}, "R x 100": {"r": 100.0}}


def tuning_part(study: Study) -> xr.Dataset:
    """Return the errors, stated standard deviations, how the data are followed, how far estimates travel, and what the check says."""
    reading, seeds = study.reading, study.sizes.tuning_seeds
    trials, truth = make_trials(reading, seeds), np.array([reading.printed_truth[name] for name in NAMES])
    report, rows, findings = study.progress("tuning of P, Q and R"), [], {}
    for done, (change, factors) in enumerate(CHANGES.items()):
        report(done, len(CHANGES))
        space = filter_space(reading, **factors)
        trace = run_over_seeds(SquareRootUnscentedKalmanFilter(), space, trials)
        means, sds = (in_printed_units(reading, x[..., 1:]) for x in (trace.means, trace.sds))
        u = np.asarray(trace.means)[..., 0]
        rows.append(
            xr.Dataset(
                {
                    "error": (("seed", "coefficient"), means[:, -1] - truth),
                    "sd": (("seed", "coefficient"), sds[:, -1]),
                    "error_at_3_s": (("seed", "coefficient"), means[:, 299] - truth),
                    "travelled": (("seed", "coefficient"), np.abs(np.diff(means, axis=1)).sum(1)),
                    "residual": ("seed", np.sqrt(np.mean((u - trials.measured[..., 0]) ** 2, 1))),
                }
            )
        )
        findings[change] = [sentence(finding) for finding in check_tuning(_one(trace), space).findings]
    report(len(CHANGES), len(CHANGES))
    stamps = STEP * np.arange(N_STEPS)
    noise = [noise_from_high_pass(stamps, trials.measured[0, :, i]) for i in range(2)]
    dataset = xr.concat(rows, xr.IndexVariable("change", list(CHANGES))).assign_coords(coefficient=list(NAMES))
    return dataset.assign(
        noise=("channel", [one.sd for one in noise]), noise_error=("channel", [one.std_error for one in noise])
    ).assign_attrs(findings=json.dumps(findings))


def claim_large_p(study: Study) -> Item:
    """Too large a P: erratic traces, worse estimates, overly large standard errors."""
    error, travelled, sd = (_rms_or_mean(study, what, "P x 1e4") for what in ("error", "travelled", "sd"))
    holds = min(error[1] / error[0], travelled[1] / travelled[0], sd[1] / sd[0]) > 1
    return _item(study, "claim-large-p", "Too large a P makes estimates erratic, worse and their errors too large", holds, {
        "rms error of X_u": error, "distance travelled by X_u": travelled, "stated sd of X_u": sd,
    }, "P x 1e4")  # fmt: skip


def claim_large_q(study: Study) -> Item:
    """Too large a Q: smaller residuals of the state, at the expense of the parameters."""
    residual, error = _rms_or_mean(study, "residual", "Q x 1e4"), _rms_or_mean(study, "error", "Q x 1e4")
    holds = residual[1] < residual[0] and error[1] > error[0]
    return _item(study, "claim-large-q", "Too large a Q follows the state closely and lets the parameters diverge", holds, {
        "rms residual of u [m/s]": residual, "rms error of X_u": error,
    }, "Q x 1e4")  # fmt: skip


def claim_large_r(study: Study) -> Item:
    """Too large an R: slow convergence."""
    early, late = _rms_or_mean(study, "error_at_3_s", "R x 100"), _rms_or_mean(study, "error", "R x 100")
    holds = early[1] > early[0] and late[1] > late[0]
    return _item(study, "claim-large-r", "Too large an R impedes convergence", holds, {
        "rms error of X_u at 3 s": early, "rms error of X_u at 15 s": late,
    }, "R x 100")  # fmt: skip


def claim_noise(study: Study) -> Item:
    """R can be estimated by a high-pass filter."""
    data, true = study.part("tuning"), study.reading.filter_noise
    sd, error = data["noise"].values, data["noise_error"].values
    holds = bool((np.abs(sd - true) < 3 * error).all())
    numbers = tuple(
        Number(f"sd of the noise of {name} by high-pass filtering, true {true:g}", None, float(x), float(e))
        for name, x, e in zip(("u", "udot"), sd, error, strict=True)
    )
    return Item(
        "claim-noise",
        "R can be had from the data by high-pass filtering",
        "reproduced" if holds else "contradicted",
        ""
        if holds
        else f"the high-pass estimates {sd[0]:.3f} and {sd[1]:.3f} miss the true {true:g} by more than three errors",
        numbers,
        {"reading": study.reading.name, "data_seed": FIRST_SEED},
    )


def _one(trace: FilterTrace) -> FilterTrace:
    """Return the first of a batch of traces."""
    final = Gaussian(*(np.asarray(part)[0] for part in trace.final))
    return FilterTrace(trace.log_likelihood[0], final, *(np.asarray(part)[0] for part in trace[2:]))


def _rms_or_mean(study: Study, what: str, change: str) -> tuple[float, float]:
    """Return the root mean square over seeds, as printed and after the change; of X_u where there are several coefficients."""
    data = study.part("tuning")[what]
    data = data.sel(coefficient="X_u") if "coefficient" in data.dims else data
    mean_square = (data**2).mean("seed")
    before, after = (float(np.sqrt(float(mean_square.sel(change=name)))) for name in ("as printed", change))
    return before, after


def _item(study: Study, key: str, title: str, holds: bool, pairs: dict[str, tuple[float, float]], change: str) -> Item:
    numbers = [
        Number(f"{what}, {when}", None, value)
        for what, pair in pairs.items()
        for when, value in zip(("as printed", change), pair, strict=True)
    ]
    findings = json.loads(study.part("tuning").attrs["findings"])[change]
    words = "; ".join(f"{what} {before:.3g} becomes {after:.3g}" for what, (before, after) in pairs.items())
    return Item(
        key,
        title,
        "reproduced" if holds else "contradicted",
        "" if holds else words,
        tuple(numbers),
        {
            "reading": study.reading.name,
            "seeds": study.sizes.tuning_seeds,
            "first_seed": FIRST_SEED,
            "change": change,
            "the tuning check says": findings,
        },
    )
