"""Write the table of verdicts on the paper, and take its pictures: `python -m studies.remus100 DIR; python docs/paper_verdicts.py DIR`."""

import json
import shutil
import sys
from collections import Counter
from pathlib import Path

from seatrial.core.files import write_text

PAGE = Path(__file__).parent / "dev" / "paper_verdicts.md"
PICTURES = ("figure-3", "relay", "listing-1", "odds", "iteration")


def page(study: dict) -> str:
    """Counts, and each item with its verdict and the reason."""
    counts = Counter(item["verdict"] for item in study["items"])
    sizes = study["sizes"]
    lines = [
        "# Replication: every verdict",
        "",
        "The paper is *Experiment Design, Bayesian Estimation and Model Selection of an Autonomous Underwater Vehicle*.",
        "",
        "- *Reproduced*: the numbers or the statement hold here too.",
        "- *Not comparable*: numbers, inputs or seeds are not printed, a formula is misprinted, the paper shows no "
        "result, or the trial cannot show the stated advantage.",
        "- *Contradicted*: the result differs from the printed one, or cannot be as printed.",
        "",
        f"`python docs/paper_verdicts.py` writes this page from the results of `python -m studies.remus100` (version "
        f"{study['seatrial_version']}, reading {study['reading']}, seed {study['seed']}). The study has "
        f"{sizes['filter_seeds']} seeds of the filters, {sizes['chains']} chains of {sizes['draws']:,} draws, and "
        f"{sizes['listing_repeats']} repeats of Listing 1 with {sizes['listing_draws']:,} draws each.",
        "",
        f"{len(study['items'])} items: "
        + ", ".join(f"{number} {verdict}" for verdict, number in counts.most_common())
        + ".",
        "",
        "| item | verdict | reason |",
        "|---|---|---|",
    ]
    lines += [f"| {item['title']} | {item['verdict']} | {_cell(item['because'])} |" for item in study["items"]]
    return "\n".join([*lines, ""])


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    study = Path(sys.argv[1])
    write_text(PAGE, page(json.loads((study / "paper.json").read_text(encoding="utf-8"))))
    for name in PICTURES:
        shutil.copy(study / "figures" / f"{name}.svg", PAGE.parents[1] / "explanation" / f"paper-{name}.svg")
