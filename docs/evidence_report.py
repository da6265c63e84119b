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
DEFAULT = "agreement"
"""What `log_evidence` gives; only it must never be wrong without an alarm."""
SHOWN = ("importance", "smc", "bridge", "nested", "prior", "savage-dickey", DEFAULT)
_HEAD = (
    "| estimator | target, parameters | runs | warned | within 2 errors if not warned | sd of error / stated "
    "| mean error, nats | stated, median | evaluations |"
)
_HARD_HEAD = (
    "| target, parameters | estimator | runs | within 2 errors | alarm | wrong without a warning | mean error, nats "
    "| evaluations | s |"
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


def numbers_of(found: Found) -> dict[str, Any]:
    """Return what is kept of the cases: errors to five digits, None where there is none, and the places of runs that warned."""
    return {
        ", ".join(name): {
            "evaluations": case.evaluations,
            "errors": [_short(run.error) for run in case.runs],
            "stated": [_short(run.stated) for run in case.runs],
            "warned": [i for i, run in enumerate(case.runs) if run.warned],
        }
        for name, case in found.items()
    }


def found_of(numbers: Mapping[str, Any]) -> Found:
    """Return the cases of which these numbers are kept."""
    found = {}
    for name, kept in numbers.items():
        if name != "commit":
            errors, stated = (np.array(kept[what], float).tolist() for what in ("errors", "stated"))
            runs = [Run(error, sd, i in kept["warned"]) for i, (error, sd) in enumerate(zip(errors, stated, strict=True))]
            method, target = name.split(", ", 1)
            found[method, target] = Case(runs, kept["evaluations"])
    return found


def tables(found: Found, benign: Sequence[str], hard: Sequence[str]) -> str:
    """Coverage where every estimator should be right, and loudness where it cannot."""
    rows = [_benign_row(m, t, found[m, t]) for m in SHOWN for t in benign if (m, t) in found]
    hard_rows = [_hard_row(m, t, found[m, t]) for t in hard for m in SHOWN if (m, t) in found]
    return "\n".join([_HEAD, _rule(_HEAD), *rows, "", _HARD_HEAD, _rule(_HARD_HEAD), *hard_rows]) + "\n"


def failures(found: Found, benign: Sequence[str]) -> list[str]:
    """Cases that contradict what is claimed, in words."""
    low = [f"{m} on {t}: errors are stated too small" for (m, t), case in found.items() if t in benign and is_low(case)]
    return low + [
        f"{m} on {t}: wrong without a warning" for (m, t), case in found.items() if m == DEFAULT and mutes(case)
    ]


def is_low(case: Case) -> bool:
    """Whether fewer of the runs that did not complain are within two errors than chance explains."""
    z = scores(_silent(case))
    return z.size > 0 and float(stats.binom(z.size, EXPECTED).cdf((np.abs(z) <= 2).sum())) < BY_CHANCE


def mutes(case: Case) -> int:
    """Runs that did not complain and are wrong by more than what is an alarm between two methods: 3 errors, and 0.1 nat."""
    return sum(
        not abs(run.error) <= max(MAX_JOINT_ERRORS * np.nan_to_num(run.stated), MIN_DIFFERENCE) for run in _silent(case)
    )


def scores(runs: Sequence[Run]) -> np.ndarray:
    """Errors in units of what was stated, of the runs that stated one."""
    return np.array([run.error / run.stated for run in runs if run.stated > 0])


def score_figure(found: Found, targets: Sequence[str], columns: int = 4) -> Figure:
    """Draw, for each estimator, the scores of its first 40 runs by target; the band is two stated errors, grey runs complained.

    Args:
        found: cases.
        targets: rows of every panel.
        columns: panels side by side.
    """
    methods = [m for m in SHOWN if any(scores(found[m, t].runs).size for t in targets if (m, t) in found)]
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
                runs = found[method, target].runs[:DRAWN] if (method, target) in found else []
                z = np.clip(scores([run for run in runs if run.warned == loud]), -6, 6)
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


def _benign_row(method: str, target: str, case: Case) -> str:
    silent = _silent(case)
    z = scores(silent)
    share = spread = stated = "–"
    if z.size:
        chance = np.sqrt(EXPECTED * (1 - EXPECTED) / z.size)
        share = f"{np.mean(np.abs(z) <= 2):.3f} ± {chance:.3f}{' **low**' if is_low(case) else ''}"
        stated = f"{np.median([run.stated for run in silent]):.2g}"
        spread = f"{z.std(ddof=1):.2f}" if z.size > 1 else "–"
    mean = _mean(silent if z.size else [run for run in case.runs if np.isnan(run.stated)])
    return _row(method, target, len(case.runs), len(case.runs) - len(silent), share, spread, mean, stated, _count(case))


def _hard_row(method: str, target: str, case: Case) -> str:
    within = np.mean([abs(run.error) <= 2 * run.stated for run in case.runs])
    loud = np.mean([run.warned for run in case.runs])
    cells = [target, method, len(case.runs), f"{within:.0%}", f"{loud:.0%}", mutes(case), _mean(case.runs)]
    return _row(*cells, _count(case))


def _silent(case: Case) -> list[Run]:
    return [run for run in case.runs if not run.warned]


def _mean(runs: Sequence[Run]) -> str:
    """Mean error and its own standard error."""
    errors = np.array([run.error for run in runs if np.isfinite(run.error)])
    return f"{errors.mean():+.2g} ± {errors.std(ddof=1) / np.sqrt(errors.size):.1g}" if errors.size > 1 else "–"


def _count(case: Case) -> str:
    """Evaluations of one run."""
    return f"{case.evaluations:,}".replace(",", " ") if case.evaluations else "–"


def _short(x: float) -> float | None:
    return float(f"{x:.5g}") if np.isfinite(x) else None


def _row(*cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _rule(head: str) -> str:
    return "|" + "---|" * (head.count("|") - 1)
