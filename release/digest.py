"""Write every number of a fixed set of small campaigns, or judge whether two versions of the code agree.

    python release/digest.py before.json                     run the set in outputs/digest (SEATRIAL_DATA for the real records)
    python release/digest.py --against before.json after.json   compare; exits with 0 if all numbers agree, with 1 otherwise

Numbers are those of the `--json` documents, by the names that stand there, and those of exported files. Three rules judge them:

- Numbers without a choice agree to 1e-9 of their value.
- Numbers at a posterior mode agree to 1e-6 of their standard deviation, or of their value where they have none.
- Numbers from draws agree within their joint Monte Carlo errors. The errors are those of several seeds on the same records; where the
  records depend on the seed, a number must be equal, or it counts as not judged.

Words, and numbers that only the later version has, are listed and decide nothing; a number that only the earlier one has differs.
"""

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "outputs" / "digest"
RELATIVE = 1e-9
"""Agreement of numbers without a choice."""
MODE_SHARE = 1e-6
"""Agreement of numbers at a mode, in standard deviations."""
UNLIKELY, IMPOSSIBLE = 1e-3, 1e-7
"""Probabilities of a difference between draws: the share of numbers below the first is judged as a whole, one below the second alone."""
SHOWN = 30
"""Lines of each list that are printed."""
IDENTITY = (
    "label",
    "name",
    "record",
    "channel",
    "structure",
    "criterion",
    "term",
    "family",
    "signal",
    "check",
    "method",
    "task",
)
"""Keys of a JSON object that name it among others in a list."""
PASSING = {"seconds", "seatrial", "sha256", "created", "duration_s", "evaluations", "schedule", "schedules"}
"""Keys whose values depend on the clock, the machine or the place."""
_NUMBER = re.compile(r"(?<![\w.])[-+−]?(?:\d[\d ]*\d|\d)(?:\.\d+)?(?:[eE][-+]?\d+)?")


class Case(NamedTuple):
    """A campaign of the set: the source of its file, texts that make it smaller, its commands, and the seeds of its draws."""

    source: str
    smaller: dict[str, str]
    commands: tuple[str, ...]
    seeds: int = 1
    needs_data: bool = False


CHAINS = "\n[estimation]\nchains = 16\nwarmup = 300\ndraws = 500\n\n[selection]\nparticles = 256\nrepeats = 2\n"
CASES = {
    "template": Case(
        "src/seatrial/campaign/config/templates/remus100.toml",
        {"points = 20": "points = 5", "[truth]": CHAINS + "\n[truth]"},
        (
            *(
                "prior {0}",
                "design {0}",
                "simulate {0}",
                "estimate {0} --by mode",
                "run {0}",
                "estimate {0}",
                "select {0}",
            ),
            *("criteria {0}", "profile {0}", "tuning {0}", "next {0}"),
            *("export {0} --to gz --fill-from remus100_hall_anstee", "export {0} --to json"),
        ),
    ),
    "select_surge": Case("examples/select_surge/campaign.toml", {}, ("select {0}",)),
    "six_degrees": Case(
        "examples/six_degrees/campaign.toml", {}, ("import {0}", "check {0}", "estimate {0} --by mode")
    ),
    "ship_yaw": Case(
        "examples/ship_yaw/campaign.toml", {}, ("import {0}", "check {0}", "estimate {0} --by mode"), needs_data=True
    ),
    "pool_auv": Case(
        "examples/pool_auv/campaign.toml",
        {"warmup = 2000": "warmup = 300", "draws = 12000": "draws = 500", "particles = 512": "particles = 128"},
        ("import {0}", "check {0}", "estimate {0} --by mode", "estimate {0}", "select {0}", "run {0}"),
        seeds=4,
        needs_data=True,
    ),
}
EXPORTS = {
    "gz": "remus100_hall_anstee",
    "stonefish": "bluerov2_heavy",
    "fossen": "remus100_hall_anstee",
    "holoocean": "remus100_prestero",
    "json": "mariner",
    "csv": "remus100_longitudinal",
}
"""One export each, of a published vehicle."""
FIXED = ("import", "check", "vehicle", "exports", "design", "simulate", "prior", "tuning", "profile")
"""Commands without a draw that another order of computation could change."""


def main() -> None:
    """Write a digest, or compare two."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("digest", type=Path, help="file to write, or to compare")
    parser.add_argument("--against", type=Path, metavar="EARLIER", help="compare with this one instead of running")
    parser.add_argument("--only", nargs="+", metavar="CASE", help=f"of {', '.join(CASES)}, exports, paper")
    options = parser.parse_args()
    if options.against:
        sys.exit(compare(json.loads(options.against.read_text()), json.loads(options.digest.read_text())))
    shutil.rmtree(PLACE, ignore_errors=True)
    numbers: dict[str, list[float]] = {}
    words: dict[str, list[str]] = {}
    for name in options.only or [*CASES, "exports", "paper"]:
        print(f"{name} ...", flush=True)
        for seed in range(CASES[name].seeds if name in CASES else 1):
            for key, value in run_case(name, seed):
                if isinstance(value, float):
                    numbers.setdefault(key, []).append(value)
                elif value not in words.setdefault(key, []):
                    words[key].append(value)
    options.digest.write_text(
        json.dumps({"numbers": numbers, "words": words}, indent=0, sort_keys=True), encoding="utf-8"
    )
    print(f"{options.digest}: {len(numbers)} numbers, {len(words)} words")


def run_case(name: str, seed: int) -> Iterator[tuple[str, float | str]]:
    """Run the commands of a case; yield `case/command/name` and a number or words.

    Args:
        name: of the case.
        seed: number of its run, which is added to the seed of its file.
    """
    folder = PLACE / f"{name}-{seed}"
    folder.mkdir(parents=True)
    if name == "exports":
        for target, vehicle in EXPORTS.items():
            yield from run_command(name, f"export {vehicle} --to {target} --out {folder / target}")
        for path in sorted(folder.rglob("*.*")):
            yield from numbers_of_text(
                f"{name}/{path.relative_to(folder).as_posix()}", path.read_text(encoding="utf-8")
            )
        return
    if name == "paper":
        subprocess.run(
            [sys.executable, "-m", "studies.remus100", folder, "--quick"], cwd=ROOT, check=True, capture_output=True
        )
        for path in sorted(folder.rglob("*.json")):
            yield from leaves(f"{name}/{path.stem}", json.loads(path.read_text(encoding="utf-8")))
        return
    case = CASES[name]
    if case.needs_data and not Path(os.environ.get("SEATRIAL_DATA", "missing")).is_dir():
        print(f"{name}: left out, set SEATRIAL_DATA to the folder of real records")
        return
    text = (ROOT / case.source).read_text(encoding="utf-8")
    for old, new in case.smaller.items():
        assert old in text, f"{case.source} has no {old}"
        text = text.replace(old, new)
    text = re.sub(r"^seed = (\d+)", lambda match: f"seed = {int(match[1]) + seed}", text, flags=re.MULTILINE)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    if (script := (ROOT / case.source).with_name("make_log.py")).is_file():
        subprocess.run([sys.executable, script, folder], check=True)
    for command in case.commands:
        yield from run_command(name, command.format(folder))


def run_command(case: str, command: str) -> Iterator[tuple[str, float | str]]:
    """Run one command with `--json`; yield its exit code and the leaves of its result."""
    called = [sys.executable, "-m", "seatrial", *command.split(), "--json"]
    done = subprocess.run(called, capture_output=True, text=True, cwd=ROOT)
    words = [word for word in command.split() if not word.startswith(str(PLACE))]
    place = f"{case}/{' '.join(words)}"
    yield f"{place}/code", float(done.returncode)
    if done.returncode not in (0, 3):
        print(done.stderr[-2000:], file=sys.stderr)
    else:
        yield from leaves(place, json.loads(done.stdout)["result"])


def leaves(place: str, node: Any) -> Iterator[tuple[str, float | str]]:
    """Yield the numbers and words of a JSON tree; an object of a list by its names, so that order and other objects do not matter."""
    if isinstance(node, Mapping):
        for name, value in node.items():
            if name not in PASSING:
                yield from leaves(f"{place}/{name}", value)
    elif isinstance(node, list):
        for i, value in enumerate(node):
            names = [str(value[key]) for key in IDENTITY if key in value] if isinstance(value, Mapping) else []
            yield from leaves(f"{place}[{' '.join(names) if names else i}]", value)
    elif isinstance(node, str):
        yield place, node.replace(str(PLACE), "")
    else:
        yield place, math.nan if node is None else float(node)


def numbers_of_text(place: str, text: str) -> Iterator[tuple[str, float | str]]:
    """Yield the lines of a text with its numbers taken out, and the numbers by their line and place."""
    for i, line in enumerate(text.splitlines()):
        yield f"{place}:{i}", " ".join(_NUMBER.sub("#", line).split())
        for k, number in enumerate(_NUMBER.findall(line)):
            yield f"{place}:{i}#{k}", float(number.replace(" ", "").replace("−", "-"))


def compare(before: dict[str, dict[str, list]], after: dict[str, dict[str, list]]) -> int:
    """Print the differences and the verdict; return 1 if a number differs that should not."""
    old, new = before["numbers"], after["numbers"]
    wrong = [f"{key}: only before" for key in sorted(old.keys() - new.keys())]
    added = sorted(new.keys() - old.keys())  # a version may report more; what it no longer reports is lost
    equal, chances, unjudged = 0, {}, []
    for key in sorted(old.keys() & new.keys()):
        one, other = np.array(old[key]), np.array(new[key])
        if _agree(key, old, new):
            equal += 1
        elif key.split("/")[1].split()[0] in FIXED or "--by mode" in key or key.endswith("/code"):
            wrong.append(f"{key}: {_shown(one)} became {_shown(other)}")
        elif min(one.size, other.size) > 1:
            chances[key] = chance_of(one, other)
        else:
            unjudged.append(f"{key}: {_shown(one)} became {_shown(other)}")
    few = sorted((chance, key) for key, chance in chances.items() if chance < UNLIKELY)
    allowed = int(stats.binom.ppf(1 - UNLIKELY, max(len(chances), 1), UNLIKELY))
    rare = [f"{key}: {_shown(old[key])} became {_shown(new[key])}, by chance {chance:.1g}" for chance, key in few]
    wrong += (
        rare
        if len(rare) > allowed
        else [line for line, (chance, _) in zip(rare, few, strict=True) if chance < IMPOSSIBLE]
    )
    changed = [
        key
        for key in before["words"].keys() | after["words"].keys()
        if before["words"].get(key) != after["words"].get(key)
    ]
    listed = {"words that changed": sorted(changed), "new": added, "not judged": unjudged, "differ": wrong}
    for title, lines in listed.items():
        print(f"{title}: {len(lines)}", *(f"  {line}" for line in lines[:SHOWN]), sep="\n")
    print(
        f"{equal} numbers are equal, {len(chances)} from draws moved ({len(few)} beyond 1 in 1 000, {allowed} allowed), "
        f"{len(unjudged)} are not judged, {len(added)} are new, {len(wrong)} differ: "
        f"{'the versions disagree' if wrong else 'the versions agree'}"
    )
    return int(bool(wrong))


def chance_of(one: np.ndarray, other: np.ndarray) -> float:
    """Return the probability of so large a difference between the means of two sets of seeds, by Student's t with a pooled variance."""
    if not (np.isfinite(one).all() and np.isfinite(other).all()):
        return 0.0
    freedom = one.size + other.size - 2
    variance = (one.var() * one.size + other.var() * other.size) / freedom
    error = math.sqrt(variance * (1 / one.size + 1 / other.size))
    return float(2 * stats.t.sf(abs(one.mean() - other.mean()) / error, freedom)) if error > 0 else 0.0


def _agree(key: str, old: Mapping[str, list], new: Mapping[str, list]) -> bool:
    """Return whether two numbers are equal to rounding, or at a mode to a share of the standard deviation beside them."""
    one, other = np.array(old[key]), np.array(new[key])
    if one.shape != other.shape:
        return False
    share, beside = RELATIVE, f"{key.rpartition('/')[0]}/sd"
    scale = np.maximum(abs(one), abs(other))
    if "--by mode" in key:
        share, scale = MODE_SHARE, np.array(old[beside]) if key.endswith("/value") and beside in old else scale
    same = np.isnan(one) & np.isnan(other)
    return bool((same | (abs(one - other) <= share * scale)).all())


def _shown(values: Any) -> str:
    return ", ".join(f"{value:.10g}" for value in values)


if __name__ == "__main__":
    main()
