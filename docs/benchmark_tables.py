"""Write the tables of docs/dev/benchmark.md from results of `python -m benchmarks.public SET --out FOLDER`, of every set.

`python docs/benchmark_tables.py FOLDER` takes the numbers from the results into docs/dev/benchmark.json, and makes the tables from these.
"""

import json
import sys
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import study_numbers

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmarks.public.run import FEWEST_RUNS, TIE, UNLIKELY, chance_of

COMMAND = "python docs/benchmark_tables.py FOLDER"
ORDER = ("pool_auv", "kvlcc2_hsva", "kvlcc2_marin", "esso_osaka", "bluerov2_mocap", "beyond_model")
SIMULATED = "beyond_model"
TASKS = {"run": "whole run", "short": "short stretches", "step": "one step"}
OURS = "ours"


def main(folder: Path) -> None:
    """Keep the numbers, and write the tables between the two remarks of the page."""
    results = [json.loads((folder / name / "result.json").read_text()) for name in ORDER]
    sets = {name: set_numbers(result) for name, result in zip(ORDER, results, strict=True)}
    study_numbers.keep("benchmark", numbers := {"bands": band_counts(results), **counted(sets)})
    study_numbers.show("benchmark", tables(numbers), COMMAND)


def band_counts(results: Sequence[dict]) -> dict[str, dict[str, int]]:
    """Return by task how many 90 % bands of ours can be judged, and how many are right: inside the range of chance."""
    found = {}
    for task in TASKS:
        ours = [entry["pooled"][task] for result in results for entry in result["entries"] if entry["method"] == OURS]
        ranges = [(one["range_90"], one["coverage_90"]) for channels in ours for one in channels if one["range_90"]]
        found[task] = {"judged": len(ranges), "right": sum(low <= share <= high for (low, high), share in ranges)}
    return found


def counted(sets: dict[str, dict]) -> dict[str, Any]:
    """Return the sets, and in how many channels no method is better than ours, of all sets and of the measured ones, by task."""
    kinds = {"all": list(sets), "measured": [name for name in sets if name != SIMULATED]}
    counts: dict[str, dict[str, Any]] = {}
    for kind, names in kinds.items():
        keys = [f"{task}, {channel}" for name in names for task in TASKS for channel in sets[name]["units"]]
        beaten = [key for name in names for key in sets[name]["better"]]
        best = {
            task: sum(key.startswith(task) for key in keys) - sum(key.startswith(task) for key in beaten)
            for task in TASKS
        }
        counts[kind] = {"channels": len(keys) // len(TASKS), "best": best}
    return {"channels": counts, "sets": sets}


def set_numbers(result: dict) -> dict[str, Any]:
    """Return what the page shows of one set.

    Of every method, channel and task: share explained and CRPS, none if it diverges; of whole runs the share inside the 90 % band, and the
    range of that share by chance if it can be judged. "better" has the methods whose CRPS is lower than ours by more than a hundredth, the
    best first, with the probability of so much by chance if enough runs tell.
    """
    about, entries = result["set"], {entry["method"]: entry for entry in result["entries"]}
    methods: dict[str, dict] = {}
    for name, entry in entries.items():
        methods[name] = {"fit, s": entry["seconds_fit"], "failed": _why(entry["failed"]), "channels": {}}
        for column, channel in enumerate([] if entry["failed"] else result["channels"]):
            scores = {task: entry["pooled"][task][column] for task in TASKS}
            if any(score["crps"] is not None or score["failed"] for score in scores.values()):
                shown = {task: [score["explained"], score["crps"]] for task, score in scores.items()}
                band = {"inside": scores["run"]["coverage_90"], "by chance": scores["run"]["range_90"]}
                methods[name]["channels"][channel] = shown | band
    better = {}
    for task, channel in product(TASKS, result["channels"]):
        crps = {name: one["channels"][channel][task][1] for name, one in methods.items() if channel in one["channels"]}
        own = crps.pop(OURS)
        lower = [name for name, score in crps.items() if score is not None and (own is None or score < own * (1 - TIE))]
        if lower:
            lower.sort(key=lambda name: crps[name])
            better[f"{task}, {channel}"] = {
                name: _by_chance(entries[OURS], entries[name], task, channel) for name in lower
            }
    return {
        "title": about["title"],
        "fitted": len(about["fit"]),
        "held back": len(about["held_back"]),
        "horizon, s": about["horizon_s"],
        "units": result["channels"],
        "methods": methods,
        "better": better,
    }


def tables(numbers: dict[str, Any]) -> str:
    """Return the counts, and a table of each set."""
    return "\n\n".join([_counts(numbers), *(_set(name, one) for name, one in numbers["sets"].items())]) + "\n"


def _counts(numbers: dict[str, Any]) -> str:
    lines = [
        "| task | channels | best, or within 1 % | 90 % band right, of those that can be judged |",
        "|---|---|---|---|",
    ]
    channels = numbers["channels"]["all"]
    for task, words in TASKS.items():
        band = numbers["bands"][task]
        lines.append(
            f"| {words} | {channels['channels']} | {channels['best'][task]} | {band['right']} of {band['judged']} |"
        )
    return "\n".join(lines)


def _set(name: str, numbers: dict[str, Any]) -> str:
    """Return one set: its title, a row for each method and channel, and the methods that are better."""
    lines = [
        f"### {numbers['title']}",
        "",
        f"`{name}`: {numbers['fitted']} runs fitted, {numbers['held back']} held back; stretches of {numbers['horizon, s']:g} s.",
        "",
        "| method | channel | " + " | ".join(TASKS.values()) + " | in the 90 % band, whole run | fit, s |",
        "|---|---|---|---|---|---|---|",
    ]
    for method, entry in numbers["methods"].items():
        for channel, scores in entry["channels"].items():
            cells = " | ".join(_score(*scores[task]) for task in TASKS)
            lines.append(f"| {method} | {channel} | {cells} | {_band(scores)} | {entry['fit, s']:.0f} |")
    better = [_better(key, others, numbers) for key, others in numbers["better"].items()]
    lines += ["", f"Lower CRPS than ours: {'; '.join(better)}." if better else "No method has a lower CRPS than ours."]
    if failed := [f"{method} ({entry['failed']})" for method, entry in numbers["methods"].items() if entry["failed"]]:
        lines += ["", f"No result: {'; '.join(failed)}."]
    return "\n".join(lines)


def _score(explained: float, crps: float | None) -> str:
    """Share explained and CRPS."""
    return "diverges" if crps is None else f"{explained:.1%}, {crps:.4g}"


def _band(scores: dict[str, Any]) -> str:
    if scores["run"][1] is None:
        return ""
    if scores["by chance"] is None:
        return f"{scores['inside']:.0%}, not judged"
    low, high = scores["by chance"]
    return f"{scores['inside']:.0%}, by chance {low:.0%} to {high:.0%}"


def _better(key: str, others: dict[str, float | None], numbers: dict[str, Any]) -> str:
    """Return the methods that are better in one task and channel, with their CRPS."""
    task, channel = key.split(", ")
    crps = {
        name: entry["channels"].get(channel, {task: [None, None]})[task][1]
        for name, entry in numbers["methods"].items()
    }
    own = "diverges" if crps[OURS] is None else f"{crps[OURS]:.4g} {numbers['units'][channel]}"
    return f"{key} ({own}): " + ", ".join(f"{name} ({crps[name]:.4g}{_chance(p)})" for name, p in others.items())


def _chance(p: float | None) -> str:
    if p is None:
        return ""
    return f", p = {p:.2g}" if p < UNLIKELY else f", which may be chance: p = {p:.2g}"


def _by_chance(ours: dict, other: dict, task: str, channel: str) -> float | None:
    """Return how likely chance alone makes the other so much better; None if too few runs tell."""
    pairs = [
        (own["crps"] - one["crps"], one["samples"])
        for own, one in zip(ours["runs"][task], other["runs"][task], strict=True)
        if one["channel"] == channel and own["crps"] is not None and one["crps"] is not None
    ]
    return chance_of(*np.array(pairs).T) if len(pairs) >= FEWEST_RUNS else None


def _why(failed: str) -> str:
    """Return the reason for no result in few words."""
    return failed.partition("found:")[2].partition(";")[0].strip() or failed


if __name__ == "__main__":
    main(Path(sys.argv[1]))
