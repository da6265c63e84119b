"""Information criteria of structures in words: a table of differences, clear differences, and nested pairs."""

from collections.abc import Sequence

import numpy as np

from seatrial.core.result_table import aligned
from seatrial.selection.criterion import METHODS, SMALL_DIFFERENCE, Criteria, Difference, NestedPair, differences

WHY = (
    "DIC and BPIC decide little: a term without effect changes DIC by 1 ± 1.4 and BPIC by 2 ± 1.4, so a few units are noise. "
    "Neither penalises a wide prior. Decide by evidence (seatrial select)"
)


def criteria_lines(found: Sequence[Criteria]) -> list[str]:
    """Return a table of the differences, and the clear ones."""
    table = differences(found)
    heads = ["", *(item for name in METHODS for item in ([name, "k-hat"] if name == "PSIS-LOO" else [name])), "terms"]
    rows = []
    for i, one in enumerate(found):
        row = [one.structure.label]
        for name in METHODS:
            row.append(_cell(table[name][i]))
            if name == "PSIS-LOO":
                k_hat = one.predictive[name].k_hat if name in one.predictive else np.empty(0)
                row.append(f"{k_hat.max():.2f}" if k_hat.size else "-")
        rows.append([*row, " ".join(one.structure.terms)])
    lines = aligned((heads, *rows), left=(0, -1))
    return ["differences to the best, lower is better", *lines, *_apart(found, table), WHY]


def criteria_cautions(found: Sequence[Criteria]) -> list[str]:
    """Return missing and unreliable criteria."""
    messages = [text for one in found for text in one.refused]
    messages += [
        f"{one.structure.label}, {name}: {criterion.status}"
        for one in found
        for name, criterion in one.predictive.items()
        if criterion.status
    ]
    return list(dict.fromkeys(messages))


def pair_line(pair: NestedPair) -> str:
    """Return the Bayes factor of a nested pair, and whether the evidences give the same."""
    value = f"log Bayes factor {pair.value:+.2f} ± {pair.error:.2f}" if np.isfinite(pair.value) else "none"
    by = "" if pair.evidence is None else f"; by evidence {pair.evidence[0]:+.2f} ± {pair.evidence[1]:.2f}"
    agreed = "" if pair.evidence is None or pair.status else ", agreed" if pair.agrees else ", NOT agreed"
    status = f"; {pair.status}" if pair.status else ""
    return f"{pair.term}, {pair.larger} against {pair.smaller}: {value}{by}{agreed}{status}"


def _cell(difference: Difference) -> str:
    if not np.isfinite(difference.delta):
        return "-"
    if difference == (0.0, 0.0):
        return "best"
    return f"{difference.delta:+.1f} ± {difference.error:.1f}"


def _apart(found: Sequence[Criteria], table: dict[str, list[Difference]]) -> list[str]:
    """Return which structures are clearly worse, by which criteria."""
    if len(found) < 2:
        return ["only one structure: no comparison is possible"]
    clear = {one.structure.label: [name for name in METHODS if table[name][i].is_clear] for i, one in enumerate(found)}
    behind = [f"{label} is worse by {', '.join(names)}" for label, names in clear.items() if names]
    rest = "no criterion separates the structures" if not behind else "the others cannot be separated"
    return [f"differences above {SMALL_DIFFERENCE:g} and two standard errors: {'; '.join([*behind, rest])}"]
