"""Tables and picture of docs/evidence.py: errors of estimators of evidence against what they stated."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from seatrial.report.figures.style import BAND, BLUE, DOTS, INK, ORANGE, POINT, SMALL, draw_dots, style_axes
from seatrial.selection.method_agreement import MAX_JOINT_ERRORS, MIN_DIFFERENCE

EXPECTED = float(2 * stats.norm.cdf(2) - 1)
"""Share of runs within two errors, if errors are normal and stated rightly."""
BY_CHANCE = 1e-3
"""Probability of so few runs within two errors below which chance is not believed."""
DRAWN = 40
"""Runs of a case that are drawn."""
COUNTS = ("runs", "warned", "silent", "silent within", "within")
DEFAULT = "agreement"
"""What `log_evidence` gives; only it must never be wrong without an alarm."""
SHOWN = ("importance", "smc", "bridge", "nested", "prior", "savage-dickey", DEFAULT)
_HEAD = (
    "| estimator | target, parameters | runs | warned | within 2 errors if not warned | sd of error / stated "
    "| mean error, nats | stated, median | evaluations |"
)
_HARD_HEAD = (
    "| target, parameters | estimator | runs | within 2 errors | alarm | wrong without a warning | mean error, nats "
    "| evaluations |"
)


class Run(NamedTuple):
    """One run: error and stated error, nats, NaN where none was given, and whether it warned."""

    error: float
    stated: float
    warned: bool


class Case(NamedTuple):
    """Runs of one estimator on one target, and the densities that one of them evaluated, None if not known."""

    runs: list[Run]
    evaluations: int | None


Found = Mapping[tuple[str, str], Case]
"""Cases by estimator and target."""


def numbers_of(found: Found, groups: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Return the numbers of each case, and the counts of the default over groups of targets."""
    numbers = {", ".join(name): _case_numbers(case) for name, case in found.items()}
    return {name: counts(numbers, targets) for name, targets in groups.items()} | {"cases": numbers}


def counts(cases: Mapping[str, Any], targets: Sequence[str]) -> dict[str, int]:
    """Return the counts of the default over some targets."""
    some = [cases[name] for target in targets if (name := f"{DEFAULT}, {target}") in cases]
    return {key: sum(one[key] for one in some) for key in COUNTS}


def _case_numbers(case: Case) -> dict[str, Any]:
    """Return counts, errors, nats, and what is drawn: scores of the first runs, and the places of those that warned.

    "silent" runs did not warn and stated an error; "within" are inside two errors; "wrong" see `mutes`. Means have their standard errors.
    """
    silent = _silent(case)
    z, drawn = scores(silent), case.runs[:DRAWN]
    return {
        "runs": len(case.runs),
        "warned": len(case.runs) - len(silent),
        "silent": z.size,
        "silent within": int((np.abs(z) <= 2).sum()),
        "within": sum(abs(run.error) <= 2 * run.stated for run in case.runs),
        "wrong": mutes(case),
        "spread": float(z.std(ddof=1)) if z.size > 1 else None,
        "silent mean": _mean(silent if z.size else [run for run in case.runs if np.isnan(run.stated)]),
        "mean": _mean(case.runs),
        "stated": float(np.median([run.stated for run in silent])) if z.size else None,
        "evaluations": case.evaluations,
        "scores": [round(float(score), 2) for score in scores(drawn)],
        "grey": [i for i, run in enumerate(run for run in drawn if run.stated > 0) if run.warned],
    }


def tables(numbers: Mapping[str, Any], benign: Sequence[str], hard: Sequence[str]) -> str:
    """Coverage where every estimator should be right, and loudness where it cannot."""
    cases = numbers["cases"]
    rows = [_benign_row(m, t, cases[f"{m}, {t}"]) for m in SHOWN for t in benign if f"{m}, {t}" in cases]
    hard_rows = [_hard_row(m, t, cases[f"{m}, {t}"]) for t in hard for m in SHOWN if f"{m}, {t}" in cases]
    return "\n".join([_HEAD, _rule(_HEAD), *rows, "", _HARD_HEAD, _rule(_HARD_HEAD), *hard_rows]) + "\n"


def failures(numbers: Mapping[str, Any], benign: Sequence[str]) -> list[str]:
    """Cases that contradict what is claimed, in words."""
    cases = {tuple(name.split(", ", 1)): one for name, one in numbers["cases"].items()}
    low = [f"{m} on {t}: errors are stated too small" for (m, t), one in cases.items() if t in benign and is_low(one)]
    return low + [
        f"{m} on {t}: wrong without a warning" for (m, t), one in cases.items() if m == DEFAULT and one["wrong"]
    ]


def is_low(numbers: Mapping[str, Any]) -> bool:
    """Whether fewer of the runs that did not complain are within two errors than chance explains."""
    silent, within = numbers["silent"], numbers["silent within"]
    return silent > 0 and float(stats.binom(silent, EXPECTED).cdf(within)) < BY_CHANCE


def mutes(case: Case) -> int:
    """Runs that did not complain and are wrong by more than what is an alarm between two methods: 3 errors, and 0.1 nat."""
    return sum(
        not abs(run.error) <= max(MAX_JOINT_ERRORS * np.nan_to_num(run.stated), MIN_DIFFERENCE) for run in _silent(case)
    )


def scores(runs: Sequence[Run]) -> np.ndarray:
    """Errors in units of what was stated, of the runs that stated one."""
    return np.array([run.error / run.stated for run in runs if run.stated > 0])


def score_figure(cases: Mapping[str, Any], targets: Sequence[str], columns: int = 4) -> Figure:
    """Draw, for each estimator, the scores of its first 40 runs by target; the band is two stated errors, grey runs complained.

    Args:
        cases: numbers by name.
        targets: rows of every panel.
        columns: panels side by side.
    """
    methods = [m for m in SHOWN if any(cases.get(f"{m}, {t}", {}).get("scores") for t in targets)]
    width, row, label, top, bottom = 640.0, 13.0, 118.0, 26.0, 40.0
    panel, high = (width - label - 8) / columns - 10, row * len(targets)
    height = -(-len(methods) // columns) * (high + top) + bottom
    figure = Figure(figsize=(width * POINT, height * POINT), dpi=72)
    for i, method in enumerate(methods):
        x, y = label + i % columns * (panel + 10), height - (i // columns + 1) * (high + top)
        axes = style_axes(figure.add_axes((x / width, y / height, panel / width, high / height)))
        axes.axvspan(-2, 2, color=BLUE, alpha=BAND, linewidth=0)
        for k, target in enumerate(targets):
            for loud in (False, True):
                case = cases.get(f"{method}, {target}", {"scores": [], "grey": []})
                z = np.clip([z for i, z in enumerate(case["scores"]) if (i in case["grey"]) == loud], -6, 6)
                at, far = k + np.linspace(-0.3, 0.3, z.size), np.abs(z) > 2
                for pick, color in ((far, DOTS if loud else ORANGE), (~far, DOTS if loud else BLUE)):
                    draw_dots(axes, z[pick], at[pick], color=color, size=2.0)
        axes.set_xlim(-6.4, 6.4)
        axes.set_ylim(len(targets) - 0.4, -0.6)
        axes.set_yticks(range(len(targets)), targets if i % columns == 0 else [""] * len(targets))
        axes.set_xticks([-4, -2, 0, 2, 4])
        axes.tick_params(labelbottom=i + columns >= len(methods))
        axes.set_title(method, fontsize=SMALL, color=INK, pad=3, loc="left")
    words = "error / stated error; beyond 6 drawn at 6; grey: the run complained"
    figure.text(0.5, 8 / height, words, fontsize=SMALL + 1, color=INK, ha="center")
    return figure


def _benign_row(method: str, target: str, one: Mapping[str, Any]) -> str:
    share = spread = stated = "–"
    if silent := one["silent"]:
        chance = np.sqrt(EXPECTED * (1 - EXPECTED) / silent)
        share = f"{one['silent within'] / silent:.3f} ± {chance:.3f}{' **low**' if is_low(one) else ''}"
        stated = f"{one['stated']:.2g}"
        spread = f"{one['spread']:.2f}" if one["spread"] is not None else "–"
    mean = _mean_words(one["silent mean"])
    return _row(method, target, one["runs"], one["warned"], share, spread, mean, stated, _count(one["evaluations"]))


def _hard_row(method: str, target: str, one: Mapping[str, Any]) -> str:
    shares = (f"{one[key] / one['runs']:.0%}" for key in ("within", "warned"))
    return _row(
        target, method, one["runs"], *shares, one["wrong"], _mean_words(one["mean"]), _count(one["evaluations"])
    )


def _silent(case: Case) -> list[Run]:
    return [run for run in case.runs if not run.warned]


def _mean(runs: Sequence[Run]) -> list[float] | None:
    """Mean error and its own standard error."""
    errors = np.array([run.error for run in runs if np.isfinite(run.error)])
    return [float(errors.mean()), float(errors.std(ddof=1) / np.sqrt(errors.size))] if errors.size > 1 else None


def _mean_words(mean: Sequence[float] | None) -> str:
    return f"{mean[0]:+.2g} ± {mean[1]:.1g}" if mean else "–"


def _count(evaluations: int | None) -> str:
    return f"{evaluations:,}".replace(",", " ") if evaluations else "–"


def _row(*cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _rule(head: str) -> str:
    return "|" + "---|" * (head.count("|") - 1)
