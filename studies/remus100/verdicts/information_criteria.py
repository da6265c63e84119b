"""Section IV, selection by criteria: Table VI, Figures 7 and 8, and what the text says of them."""

import numpy as np
import xarray as xr

from studies.remus100.items import Item, Number
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES
from studies.remus100.verdicts.estimation import chain_figure
from studies.remus100.verdicts.settings import chain_settings

TABLE_6 = {
    "chain-6-full": {"X_u": (-0.97, 0.37), "X_uabsu": (-3.05, 0.19), "T_nabsn": (6.28, 0.10), "X_du3": (7.78, 9.65)},
    "chain-6-reduced": {"X_u": (-1.26, 0.07), "X_uabsu": (-2.90, 0.04), "T_nabsn": (6.28, 0.10)},
}
CRITERIA = {
    "chain-6-full": {"DIC": -13939.8, "BPIC": -13934.6, "p_D": 5.2},
    "chain-6-reduced": {"DIC": -13940.6, "BPIC": -13935.9, "p_D": 4.8},
}
MODEL = {"chain-6-full": "M-0", "chain-6-reduced": "M-1"}
TIE = 0.3
"""A difference of two criteria below this decides nothing, whatever its error."""


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
        chain_settings(study),
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
        "reproduced" if holds else "differs",
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
        "reproduced" if holds else "differs",
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
        "reproduced in shape" if share < 0.01 else "differs",
        f"they change by {share:.4%}, but the percentage is the wrong yardstick: their level is arbitrary (it moves "
        "with the unit of u), and "
        "only differences beside their errors mean something",
        (Number("relative change of DIC", study.reading.printed(0.8 / 13940), share),),
        chain_settings(study),
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
