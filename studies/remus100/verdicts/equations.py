"""Section II and the equations of all sections: each one used, beside an independent computation of the same number."""

import numpy as np

from studies.remus100.compute.equations import DRAWS_SEED
from studies.remus100.items import Item, Number
from studies.remus100.study import Study

EXACT, SAMPLED = 1e-9, 0.02
"""Relative differences allowed: to rounding, and where the independent number is itself a sample of 200 000."""
REASONS = {
    "equations-2": "in (3) a bracket is missing, and (4) and (5) lack the division by m - X_udot: the sums of "
    "forces are as printed, "
    "the Jacobians of the filter are those of du/dt",
    "equations-3": "(6) has a p too many, (7), (9) and (10) lack the minus sign of an entropy, so that (8) as "
    "printed is a gain only by "
    "two wrongs; with H = -E[log p] throughout, the gain is H(prior) - H(posterior), never negative",
    "equations-4": "(26) and (27) are DIC = D(mean) + 2 p_D = Dbar + p_D, and (28) holds the prior odds too: its "
    "columns BF are posterior "
    "probabilities",
}
TITLES = {
    "equations-2": "Vehicle and Jacobians, eqs. (1) to (5)",
    "equations-3": "Entropy and information gain, eqs. (6) to (14)",
    "equations-4": "Hierarchical model and criteria, eqs. (17) to (28)",
}
ROWS = {"equations-2": ("(1), (3)", "(4)", "(5)"), "equations-3": ("(6), (7), (9), (10)", "(13), (14)", "(8), (11)")}


def equations_2(study: Study) -> Item:
    """Eqs. (1) to (5)."""
    return _item(study, "equations-2", [])


def equations_3(study: Study) -> Item:
    """Eqs. (6) to (14)."""
    return _item(study, "equations-3", [])


def equations_4(study: Study) -> Item:
    """Eqs. (17) to (28), the criteria by the identities that hold between them."""
    data = study.part("chain-6-reduced")["criterion_value"]
    dic, bpic, p_d, mean = (float(data.sel(criterion=name)) for name in ("DIC", "BPIC", "p_D", "Dbar"))
    odds = study.part("evidence-4")["log_value"].sel({"method": "importance sampling"}).values
    extra = [
        ("(22) to (27)", "DIC - Dbar - p_D", dic - mean - p_d, 0.0),
        ("(22) to (27)", "BPIC - DIC - p_D", bpic - dic - p_d, 0.0),
        ("(24)", "p_D of Table VI, BPIC - DIC as printed", -13934.6 + 13939.8, 5.2),
        ("(28)", "P(M-0) + P(M-1)", float(np.sum(np.exp(odds - np.logaddexp(*odds)))), 1.0),
    ]
    return _item(study, "equations-4", extra)


def vehicle(study: Study) -> Item:
    """The longitudinal vehicle, its linearisation, and the surge model as its restriction."""
    data = study.part("vehicle")
    time, speed = data["time"].values, data["full"].values[:, 0]
    linear = float(np.abs(speed - data["linear"].values[:, 0]).max())
    alone = float(np.abs(speed - data["surge"].values).max())
    change = float(abs(data["surge"].values[-1] - data["surge"].values[0]))
    growing = data["eigenvalues"].values[data["eigenvalues"].values[:, 0] > 1e-6]
    unstable = (
        "; the published coefficients make level flight unstable without control (growth rate "
        f"{growing[:, 0].max():.2f} 1/s), which "
        "the paper does not mention"
        if growing.size
        else ""
    )
    numbers = (
        Number("trim speed of the longitudinal vehicle [m/s]", None, float(data["trim"].values[0])),
        Number("trim speed of the surge model [m/s]", None, float(data.attrs["surge_trim"])),
        Number(f"change of speed {time[-1]:.0f} s after n rose by 50 rpm, surge model [m/s]", None, change),
        Number("largest difference of the linearised model from the non-linear one [m/s]", None, linear),
        Number("largest difference of the surge model from the longitudinal one [m/s]", None, alone),
        *(
            Number(f"A, row {s}, column u [1/s]", None, float(a))
            for s, a in zip(data["state"].values, data["a"].values[:, 0], strict=True)
        ),
    )
    return Item(
        "vehicle",
        "Longitudinal vehicle, its linearisation, and the surge model as its restriction",
        "reproduced in shape" if max(linear, alone) < 0.25 * change else "differs",
        f"no number is printed to compare with: linearised, speed follows the non-linear model within {linear:.1e} "
        "m/s, and the surge model "
        f"within {alone:.1e} m/s, of a change of {change:.2f} m/s{unstable}",
        numbers,
        {"vehicle": "remus100_longitudinal", "step_rpm": 50, "duration_s": round(float(time[-1]), 2)},
    )


def _item(study: Study, key: str, extra: list[tuple[str, str, float, float]]) -> Item:
    data = study.part("equations")
    rows = zip(
        data["equation"].values, data["what"].values, data["ours"].values, data["independent"].values, strict=True
    )
    known = ROWS.get(key)
    taken = [row for row in rows if (row[0] in known if known else row[0].startswith(("(17)", "(18)")))] + extra
    apart = [
        f"{equation} {what} is {ours:.10g} here and {other:.10g} independently"
        for equation, what, ours, other in taken
        if not abs(ours - other) <= (SAMPLED if "draws" in what else EXACT) * max(1.0, abs(other))
    ]
    numbers = [
        Number(f"{equation} {what}, {whose}", None, float(value))
        for equation, what, ours, other in taken
        for whose, value in (("here", ours), ("independently", other))
    ]
    return Item(
        key,
        TITLES[key],
        "cannot hold" if apart else "reproduced in shape",
        "; ".join(apart) or REASONS[key],
        tuple(numbers),
        {"reading": study.reading.name, "sampled_with_seed": DRAWS_SEED, "data_seed": 1},
    )
