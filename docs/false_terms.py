"""How many useless terms are taken for needed? `python docs/false_terms.py [--sets N]` counts them under both priors of structures.

Regressions with white noise, a few terms of 3 standard errors or none, and useless ones; all subsets in closed form under the g-prior that
is worth one row, as BIC is. Writes docs/dev/false_terms.json, and from it the table in docs/dev/false_terms.md.
"""

import argparse
from itertools import product
from typing import Any, NamedTuple, get_args

import numpy as np
import study_numbers

from seatrial.selection.structure_prior import StructurePrior, log_prior_by_size
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.conjugate import unit_information
from seatrial.selection.subsets.gram import gram

SETS, ROWS, SIZE = 200, 100, 3.0
"""Data sets, rows of each, and true coefficients in standard errors."""
USELESS, NEEDED = (5, 10, 20), (0, 2)
"""Numbers of terms."""
PRIORS = get_args(StructurePrior)


class Count(NamedTuple):
    """Mean over data sets with its standard error.

    Attributes:
        false: useless terms in the most probable structure.
        found: needed terms in it.
    """

    false: tuple[float, float]
    found: tuple[float, float]


def main() -> None:
    """Count, keep the numbers and show them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=SETS, help="data sets of each row")
    sets = parser.parse_args().sets
    rows = [
        {
            "useless": useless,
            "needed": needed,
            **{by: one._asdict() for by, one in count(useless, needed, sets).items()},
        }
        for needed, useless in product(NEEDED, USELESS)
    ]
    study_numbers.keep("false_terms", {"sets": sets, "rows": rows})
    study_numbers.show("false_terms", tables(study_numbers.kept("false_terms")))


def count(useless: int, needed: int, sets: int) -> dict[str, Count]:
    """Count terms of the most probable structure, by the prior of structures."""
    random, k = np.random.default_rng([useless, needed]), useless + needed
    names, of_prior = tuple(f"t{i}" for i in range(k)), {by: log_prior_by_size(by, k) for by in PRIORS}
    chosen: dict[str, list[np.ndarray]] = {by: [] for by in PRIORS}
    for _ in range(sets):
        regressors = random.normal(size=(ROWS, k))
        signal = regressors[:, :needed].sum(1) * SIZE / np.sqrt(ROWS)
        stats = gram(regressors, signal + random.normal(size=ROWS))
        for by, log_prior in of_prior.items():
            best = all_subsets(stats, unit_information(stats, 1.0), names, log_prior=log_prior, top=1)
            chosen[by].append(np.isin(np.arange(k), best.numbers(0)))
    return {
        by: Count(_mean(np.array(rows)[:, needed:]), _mean(np.array(rows)[:, :needed])) for by, rows in chosen.items()
    }


def _mean(rows: np.ndarray) -> tuple[float, float]:
    numbers = rows.sum(1)
    return float(numbers.mean()), float(numbers.std(ddof=1) / np.sqrt(len(numbers)))


def tables(results: dict[str, Any]) -> str:
    """Return the table of the page."""
    lines = [
        f"Mean of {results['sets']} data sets ± its standard error:",
        "",
        "| needed terms | useless terms | useless in the best, equal | multiplicity | needed in the best, equal | multiplicity |",
        "|---|---|---|---|---|---|",
    ]
    for row in results["rows"]:
        pairs = [row[by][which] for which in ("false", "found") for by in PRIORS]
        cells = ["{:.2f} ± {:.2f}".format(*pair) for pair in pairs[: 4 if row["needed"] else 2]]
        lines.append(f"| {row['needed']} | {row['useless']} | " + " | ".join([*cells, "–", "–"][:4]) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
