"""Section III, the remarks on tuning: what P, Q and R do when they are too large, and R from the data."""

import json

import numpy as np

from studies.remus100.compute.filters import FIRST_SEED
from studies.remus100.items import Item, Number
from studies.remus100.study import Study


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
        "reproduced" if holds else "differs",
        ""
        if holds
        else f"the high-pass estimates {sd[0]:.3f} and {sd[1]:.3f} miss the true {true:g} by more than three errors",
        numbers,
        {"reading": study.reading.name, "data_seed": FIRST_SEED},
    )


def _rms_or_mean(study: Study, what: str, change: str) -> tuple[float, float]:
    """Root mean square over seeds, as printed and after the change; of X_u where there are several coefficients."""
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
    said = json.loads(study.part("tuning").attrs["findings"])[change]
    words = "; ".join(f"{what} {before:.3g} becomes {after:.3g}" for what, (before, after) in pairs.items())
    return Item(
        key,
        title,
        "reproduced" if holds else "differs",
        "" if holds else words,
        tuple(numbers),
        {
            "reading": study.reading.name,
            "seeds": study.sizes.tuning_seeds,
            "first_seed": FIRST_SEED,
            "change": change,
            "the tuning check says": said,
        },
    )
