"""Write the table of verdicts on the paper, and take its pictures: `python -m studies.remus100 DIR; python docs/paper_verdicts.py DIR`.

The items go to docs/dev/paper_verdicts.json, and from there into docs/dev/paper_verdicts.md.
"""

import json
import shutil
import sys
from collections import Counter
from pathlib import Path

import study_numbers

PICTURES = ("figure-3", "relay", "listing-1", "odds", "iteration")
VERDICTS = ("reproduced", "not comparable", "contradicted")


def main(folder: Path) -> None:
    """Keep counts and items of a study, write the page, and copy the pictures."""
    study = json.loads((folder / "paper.json").read_text(encoding="utf-8"))
    study_numbers.keep("paper_verdicts", numbers := numbers_of(study))
    study_numbers.show("paper_verdicts", tables(numbers))
    for name in PICTURES:
        shutil.copy(folder / "figures" / f"{name}.svg", study_numbers.DEV.parent / "explanation" / f"paper-{name}.svg")


def numbers_of(study: dict) -> dict:
    """Return what the study is, its counts, and its items."""
    count = Counter(item["verdict"] for item in study["items"])
    counts = {"items": len(study["items"]), **{verdict: count[verdict] for verdict in VERDICTS}}
    items = [{key: item[key] for key in ("title", "verdict", "because")} for item in study["items"]]
    return (
        {"counts": counts}
        | {key: study[key] for key in ("seatrial_version", "reading", "seed", "sizes")}
        | {"items": items}
    )


def tables(numbers: dict) -> str:
    """Counts, and each item with its verdict and the reason."""
    sizes, counts = numbers["sizes"], numbers["counts"]
    lines = [
        f"Version {numbers['seatrial_version']}, reading {numbers['reading']}, seed {numbers['seed']}. The study has "
        f"{sizes['filter_seeds']} seeds of the filters, {sizes['chains']} chains of {sizes['draws']:,} draws, and "
        f"{sizes['listing_repeats']} repeats of Listing 1 with {sizes['listing_draws']:,} draws each.",
        "",
        f"{counts['items']} items: " + ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS) + ".",
        "",
        "| item | verdict | reason |",
        "|---|---|---|",
    ]
    lines += [f"| {item['title']} | {item['verdict']} | {_cell(item['because'])} |" for item in numbers["items"]]
    return "\n".join([*lines, ""])


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
