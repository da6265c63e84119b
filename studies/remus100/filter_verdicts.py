"""Section III, filters: Tables I and II, Figures 1 and 2, and what the text says of them."""

from math import sqrt

import numpy as np
import xarray as xr

from studies.remus100.filters import FIRST_SEED, HOLD, STEP
from studies.remus100.reading import NAMES, RPM
from studies.remus100.study import Item, Number, Study, Verdict

TABLE_1 = {"EKF": (-1.21, -2.93, 6.28), "UKF": (-1.27, -2.91, 6.28), "SRUKF": (-1.28, -2.91, 6.28)}
TABLE_1_SD = {"EKF": (0.37, 0.18, 0.10), "UKF": (0.38, 0.18, 0.10), "SRUKF": (0.38, 0.18, 0.01)}
TABLE_2 = {"SRUKF": (-1.27, -2.91, 6.28), "SRUKF-C": (-1.24, -2.93, 6.28)}
TABLE_2_SD = {"SRUKF": (0.38, 0.18, 0.10), "SRUKF-C": (0.37, 0.18, 0.10)}
NEAR = 0.25  # Difference of two filters' estimates, in their standard deviations, that is very small


def table_1(study: Study) -> Item:
    """Three filters agree, and their standard deviations are the printed ones."""
    data = study.part("filters")
    numbers = [row for name in TABLE_1 for row in _rows(study, name, TABLE_1[name], TABLE_1_SD[name])]
    sds = _mean(data, "SRUKF", "final_sd")
    alike = bool((np.abs(np.log(sds / TABLE_1_SD["EKF"])) < np.log(2.5)).all())
    shape = _apart(data) < NEAR and alike
    return Item(
        "table-1",
        "Table I: EKF, UKF and SRUKF estimates",
        "not comparable" if shape else "contradicted",
        f"the input is not printed: with steps of {study.reading.steps / RPM:.0f} rpm held for {HOLD:g} s the three estimates lie "
        f"within {_apart(data):.2f} standard deviations; these are {sds[0]:.2f}, {sds[1]:.2f} and {sds[2]:.2f}; the standard "
        "deviations printed for T, 0.01 by the SRUKF and 0.10 by the UKF, cannot both be right, because the two are the same filter",
        tuple(numbers),
        _settings(study),
    )


def table_2(study: Study) -> Item:
    """The constrained filter is a little closer to the truth, its standard deviations the same."""
    data = study.part("filters")
    numbers = [row for name in TABLE_2 for row in _rows(study, name, TABLE_2[name], TABLE_2_SD[name])]
    sd, sd_c = (_mean(data, name, "final_sd")[0] for name in TABLE_2)
    closer = _rms(study, "SRUKF-C")[0] < _rms(study, "SRUKF")[0]
    same = abs(np.log(sd_c / sd)) < np.log(1.1)
    verdict: Verdict = "reproduced" if closer and same else "contradicted"
    because = (
        ""
        if verdict == "reproduced"
        else (
            f"the constrained filter is {'closer' if closer else 'not closer'} (rms error of X_u "
            f"{_rms(study, 'SRUKF')[0]:.2f} becomes "
            f"{_rms(study, 'SRUKF-C')[0]:.2f}), and its stated standard deviation goes from {sd:.2f} to {sd_c:.2f}"
            + ("" if same else ": points moved to the bounds reduce the stated uncertainty; the paper prints no change")
        )
    )
    return Item(
        "table-2", "Table II: SRUKF against the constrained SRUKF-C", verdict, because, tuple(numbers), _settings(study)
    )


def figure_1(study: Study) -> Item:
    """Responses, estimates and standard deviations of the three filters."""
    data, settled = study.part("filters"), {}
    for name in TABLE_1:
        sds = data["sd"].sel(filter=name).values
        settled[name] = float((sds[-1] / sds[round(1 / STEP)]).max())
    within = max(float(np.abs(data["u"].sel(filter=name).values - data["true"].values[:, 0]).max()) for name in TABLE_1)
    numbers = [Number(f"{name}, largest sd at 15 s over that at 1 s", None, value) for name, value in settled.items()]
    numbers.append(Number("largest error of any filter's u [m/s]", None, within))
    levels, follows = max(settled.values()) < 0.2, within < 5 * study.reading.filter_noise
    return Item(
        "figure-1",
        "Figure 1: responses and estimates of the three filters",
        "not comparable" if levels and follows else "contradicted",
        "seed and input are not printed: the estimates settle and the standard deviations level off as drawn"
        if levels and follows
        else f"standard deviations at 15 s are up to {max(settled.values()):.2f} of those at 1 s, and u is missed by "
        f"up to {within:.2f} m/s",
        tuple(numbers),
        _settings(study) | {"seed": FIRST_SEED},
    )


def figure_2(study: Study) -> Item:
    """The constrained filter beside the plain one: clipping over time and the first second."""
    early = _early_clipping(study)
    return Item(
        "figure-2",
        "Figure 2: SRUKF and SRUKF-C",
        "not comparable" if early > 0.8 else "contradicted",
        f"seed and input are not printed: {early:.0%} of the clipping falls in the first 5 s",
        (Number("share of clipping in the first 5 s", None, early),),
        _settings(study) | {"seed": FIRST_SEED},
    )


def claim_filters_equal(study: Study) -> Item:
    """ "The difference in the final estimates is very small for all three filters."""
    apart = _apart(study.part("filters"))
    return _claim(
        "claim-filters-equal",
        "The final estimates of the three filters hardly differ",
        apart < NEAR,
        f"they differ by {apart:.2f} of a standard deviation",
        [Number("root mean square difference, in standard deviations", None, apart)],
        study,
    )


def claim_ekf_faster(study: Study) -> Item:
    """The EKF is faster, by its Jacobian."""
    seconds = {name: float(study.part("filters")["seconds"].sel(filter=name)) for name in TABLE_1}
    return _claim(
        "claim-ekf-faster",
        "The EKF is the fastest of the three",
        seconds["EKF"] == min(seconds.values()),
        "another filter was as fast",
        [
            Number(f"{name}, time of one 15 s trial, all run side by side [ms]", None, 1e3 * value)
            for name, value in seconds.items()
        ],
        study,
    )


def claim_ekf_better(study: Study) -> Item:
    """The EKF gives marginally better results and converges more rapidly."""
    data = study.part("filters")["relative_error"]
    early = {name: _median_error(data, name, 3.0) for name in ("EKF", "SRUKF")}
    late = {name: _median_error(data, name, 15.0) for name in ("EKF", "SRUKF")}
    worse = sum(values["EKF"][0] >= values["SRUKF"][0] - 2 * values["EKF"][1] for values in (early, late))
    numbers = [
        Number(f"{name}, median relative error of X_u at {seconds} s", None, *values[name])
        for seconds, values in ((3, early), (15, late))
        for name in values
    ]
    return _claim(
        "claim-ekf-better",
        "The EKF converges faster and ends closer",
        worse == 0,
        f"over {study.sizes.filter_seeds} seeds the median error of X_u at 3 s is {early['EKF'][0]:.2f} for the EKF "
        f"and {early['SRUKF'][0]:.2f} "
        f"for the SRUKF, at 15 s {late['EKF'][0]:.3f} and {late['SRUKF'][0]:.3f}: no advantage beyond the spread of "
        "one seed",
        numbers,
        study,
    )


def claim_stability(study: Study) -> Item:
    """The SRUKF maintains numerical stability where others may not."""
    data = study.part("filters")
    failures = {name: int(data["failures"].sel(filter=name)) for name in TABLE_1}
    return _claim(
        "claim-stability",
        "The SRUKF stays numerically stable",
        failures["SRUKF"] == 0 and max(failures.values()) > 0,
        f"it lost a positive covariance at {failures['SRUKF']} samples"
        if failures["SRUKF"]
        else "the EKF and the UKF do too: in double precision the covariance of all three stayed positive definite "
        f"in {study.sizes.filter_seeds} trials, so no advantage shows here",
        [Number(f"{name}, samples without a positive covariance", None, value) for name, value in failures.items()],
        study,
        otherwise="not comparable" if failures["SRUKF"] == 0 else "contradicted",
    )


def claim_clipping(study: Study) -> Item:
    """Most of the clipping occurs in the first 5 s."""
    early = _early_clipping(study)
    return _claim(
        "claim-clipping",
        "Most sigma points are clipped in the first 5 s",
        early > 0.5,
        f"only {early:.0%} are",
        [Number("share of clipping in the first 5 s", None, early)],
        study,
    )


def claim_transient(study: Study) -> Item:
    """Clipping makes du/dt erratic during the first second."""
    error = {name: float(study.part("filters")["early_udot_error"].sel(filter=name).mean()) for name in TABLE_2}
    return _claim(
        "claim-transient",
        "Clipping makes du/dt erratic in the first second",
        error["SRUKF-C"] > error["SRUKF"],
        f"in the first second the error of du/dt is {error['SRUKF-C']:.3f} m/s^2 with clipping and "
        f"{error['SRUKF']:.3f} without: bounds on the "
        "coefficients also bound the acceleration they explain; the paper saw the opposite in one run, whose "
        "input is not printed",
        [
            Number(f"{name}, rms error of du/dt in the first second [m/s^2]", None, value)
            for name, value in error.items()
        ],
        study,
    )


def claim_only_square_root(study: Study) -> Item:
    """Clipping is feasible only in square-root form, since the covariance would become singular."""
    smallest = float(study.part("filters")["smallest_sd"].sel(filter="SRUKF-C"))
    positive = smallest > 0
    return Item(
        "claim-only-square-root",
        "Only the square-root form can be constrained",
        "contradicted" if positive else "reproduced",
        "P = sum of weighted squares + Q is positive definite for any points if the weights (alpha = 1) and Q are "
        "positive; both forms compute the same P, and its smallest standard deviation under clipping was "
        f"{smallest:.1e}"
        if positive
        else f"a standard deviation fell to {smallest:.1e} under clipping, though P is positive definite in exact numbers",
        (Number("smallest standard deviation under clipping, filter units", None, smallest),),
        _settings(study),
    )


def _claim(
    key: str,
    title: str,
    holds: bool,
    because: str,
    numbers: list[Number],
    study: Study,
    otherwise: Verdict = "contradicted",
) -> Item:
    verdict: Verdict = "reproduced" if holds else otherwise
    return Item(key, title, verdict, "" if holds else because, tuple(numbers), _settings(study))


def _rows(study: Study, name: str, printed: tuple[float, ...], printed_sd: tuple[float, ...]) -> list[Number]:
    data, rows = study.part("filters").sel(filter=name), []
    final, sds, errors = data["final_mean"].values, data["final_sd"].values, _rms(study, name)
    count = final.shape[0]
    for i, term in enumerate(NAMES):
        rows += [
            Number(
                f"{name} {term}, mean over seeds",
                printed[i],
                float(final[:, i].mean()),
                float(final[:, i].std(ddof=1)) / sqrt(count),
            ),
            Number(
                f"{name} {term}, stated sd",
                printed_sd[i],
                float(sds[:, i].mean()),
                float(sds[:, i].std(ddof=1)) / sqrt(count),
            ),
            Number(f"{name} {term}, rms error", None, float(errors[i]), float(errors[i]) / sqrt(2 * count)),
        ]
    return [
        *rows,
        Number(f"{name}, time of one 15 s trial, all run side by side [ms]", None, 1e3 * float(data["seconds"])),
    ]


def _apart(data: xr.Dataset) -> float:
    """Return the largest root mean square difference of a final estimate from the SRUKF's, in standard deviations."""
    final, sds = data["final_mean"], _mean(data, "SRUKF", "final_sd")
    reference = final.sel(filter="SRUKF").values
    return max(float((np.sqrt(np.mean((final.sel(filter=n).values - reference) ** 2, 0)) / sds).max()) for n in TABLE_1)


def _mean(data: xr.Dataset, name: str, what: str) -> np.ndarray:
    return data[what].sel(filter=name).values.mean(0)


def _rms(study: Study, name: str) -> np.ndarray:
    """Return the root mean square error of the final estimates over the seeds, printed units."""
    final = study.part("filters")["final_mean"].sel(filter=name).values
    return np.sqrt(np.mean((final - np.array([study.reading.printed_truth[term] for term in NAMES])) ** 2, 0))


def _early_clipping(study: Study) -> float:
    clipped = study.part("filters")["clipped"].sel(filter="SRUKF-C").values
    return float(clipped[: round(5 / STEP)].sum() / max(clipped.sum(), 1.0))


def _median_error(error: xr.DataArray, name: str, seconds: float) -> tuple[float, float]:
    """Median over the seeds of the relative error of X_u, and its standard error by the normal approximation."""
    values = error.sel(filter=name, coefficient="X_u").sel(mark=seconds, method="nearest").values
    spread = np.subtract(*np.quantile(values, [0.75, 0.25])) / 1.349
    return float(np.median(values)), float(1.2533 * spread / sqrt(values.size))


def _settings(study: Study) -> dict:
    return {
        "reading": study.reading.name,
        "seeds": study.sizes.filter_seeds,
        "first_seed": FIRST_SEED,
        "steps_rpm": round(study.reading.steps / RPM, 6),
        "hold_s": HOLD,
    }
