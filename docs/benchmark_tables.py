"""Write the tables of docs/dev/benchmark.md from results of `python -m benchmarks.public SET --out FOLDER`, of every set.

Run `python docs/benchmark_tables.py FOLDER`.
"""

import json
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "dev" / "benchmark.md"
BEGIN, END = "<!-- results: python docs/benchmark_tables.py FOLDER -->", "<!-- end of results -->"
ORDER = ("pool_auv", "kvlcc2_hsva", "kvlcc2_marin", "esso_osaka", "bluerov2_mocap", "beyond_model")
TASKS = {"run": "whole run", "short": "short stretches", "step": "one step"}


def main(folder: Path) -> None:
    """Write the tables between the two remarks of the page."""
    results = [json.loads((folder / name / "result.json").read_text()) for name in ORDER]
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    tables = "\n\n".join([count(results), *map(table, results)])
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables}\n\n{END}{after}", encoding="utf-8")


def count(results: list[dict]) -> str:
    """Return in how many channels of all sets no method is better than ours, and in how many its band is right, by task."""
    lines = [
        "| task | channels | best, or within 1 % | 90 % band right, of those that can be judged |",
        "|---|---|---|---|",
    ]
    for task, words in TASKS.items():
        channels, worse, judged, right = 0, 0, 0, 0
        for result in results:
            (ours,) = (entry["pooled"][task] for entry in result["entries"] if entry["method"] == "ours")
            channels += len(ours)
            worse += sum(line.startswith(f"ours, {task}, ") for line in result["not_beaten"])
            ranges = [(one["range_90"], one["coverage_90"]) for one in ours if one["range_90"]]
            judged += len(ranges)
            right += sum(low <= share <= high for (low, high), share in ranges)
        lines.append(f"| {words} | {channels} | {channels - worse} | {right} of {judged} |")
    return "\n".join(lines)


def table(result: dict) -> str:
    """Return one set: its title, a row for each method and channel, and the methods that are better."""
    found = result["set"]
    lines = [
        f"### {found['title']}",
        "",
        f"`{found['name']}`: {len(found['fit'])} runs fitted, {len(found['held_back'])} held back; stretches of {found['horizon_s']:g} s.",
        "",
        "| method | channel | " + " | ".join(TASKS.values()) + " | in the 90 % band, whole run | fit, s |",
        "|---|---|---|---|---|---|---|",
    ]
    for entry in result["entries"]:
        for column in range(len(result["channels"]) if not entry["failed"] else 0):
            scores = [entry["pooled"][task][column] for task in TASKS]
            if all(score["crps"] is None and not score["failed"] for score in scores):
                continue
            cells = " | ".join(map(_score, scores))
            lines.append(
                f"| {entry['method']} | {scores[0]['channel']} | {cells} | {_band(scores[0])} | {entry['seconds_fit']:.0f} |"
            )
    lines += ["", *_remarks(result)]
    return "\n".join(lines)


def _score(score: dict) -> str:
    """Share explained and CRPS."""
    return "diverges" if score["crps"] is None else f"{score['explained']:.1%}, {score['crps']:.4g}"


def _band(score: dict) -> str:
    if score["crps"] is None:
        return ""
    if score["range_90"] is None:
        return f"{score['coverage_90']:.0%}, not judged"
    low, high = score["range_90"]
    return f"{score['coverage_90']:.0%}, by chance {low:.0%} to {high:.0%}"


def _remarks(result: dict) -> list[str]:
    """Return the channels in which a method is better, and the methods without a result."""
    lines = [
        line.removeprefix("ours, ").replace(": has a CRPS of ", " (").replace(" and does not beat ", "): ")
        for line in result["not_beaten"]
    ]
    said = ["Lower CRPS than ours: " + "; ".join(lines) + "."] if lines else ["No method has a lower CRPS than ours."]
    failed = {
        entry["method"]: entry["failed"].partition("found:")[2].partition(";")[0].strip() or entry["failed"]
        for entry in result["entries"]
        if entry["failed"]
    }
    if failed:
        said += ["", "No result: " + "; ".join(f"{name} ({why})" for name, why in failed.items()) + "."]
    return said


if __name__ == "__main__":
    main(Path(sys.argv[1]))
