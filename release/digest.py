"""Write every number of a fixed set of small campaigns, to hold two versions of the code against each other.

    python release/digest.py before.json           runs the set in outputs/digest (SEATRIAL_DATA for the real records)
    python release/digest.py --against before.json after.json

Words and numbers of results are compared by file and name. Where nothing is drawn at random numbers must agree to 1e-9; means of draws and
evidences within 4 of their joint Monte Carlo errors; what follows from draws without an error of its own is listed with its change.
"""

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "outputs" / "digest"
RELATIVE, ERRORS, FULL, SAMPLES = 1e-9, 4.0, 200, 20
"""Agreement asked for, of deterministic numbers and in Monte Carlo errors; longest array kept whole, and samples kept of others."""
DRAWN = (
    "posterior",
    "selection",
    "predictions",
    "contenders",
    "next",
    "summary",
    "sequence",
    "proposed",
    "known",
    "printed",
    "export",
)
"""What follows from draws: files whose names begin so, and what commands print."""
PASSING = {"key", "sha256_of_content", "seatrial_version", "seconds", "sha256", "created", "elapsed", "duration_s"}
CLOCK = ("[ms]", "per second", "one posterior by", "ratio")
"""What the names of numbers say that are measured on the clock, or made of such."""
_NUMBER = re.compile(r"(?<![\w.])[-+−]?(?:\d[\d ]*\d|\d)(?:\.\d+)?(?:[eE][-+]?\d+)?")


class Case(NamedTuple):
    """One campaign of the set: where its file comes from, what is made smaller in it, and the commands."""

    source: str
    smaller: dict[str, str]
    commands: tuple[str, ...]
    needs_data: bool = False


CHAINS = "\n[estimation]\nchains = 16\nwarmup = 300\ndraws = 500\n\n[selection]\nparticles = 256\nrepeats = 2\n"
CASES = {
    "template": Case(
        "src/seatrial/campaign/config/templates/remus100.toml",
        {"points = 20": "points = 5", "[truth]": CHAINS + "\n[truth]"},
        (
            *("prior {0}", "design {0}", "run {0}", "criteria {0}", "profile {0}", "tuning {0}"),
            *("export {0} --to gz --rest remus100_hall_anstee", "export {0} --to json"),
        ),
    ),
    "select_surge": Case("examples/select_surge/campaign.toml", {}, ("select {0}",)),
    "six_degrees": Case("examples/six_degrees/campaign.toml", {}, ("check {0}", "estimate {0} --by mode")),
    "ship_yaw": Case("examples/ship_yaw/campaign.toml", {}, ("check {0}", "estimate {0} --by mode"), True),
    "pool_auv": Case(
        "examples/pool_auv/campaign.toml",
        {"warmup = 2000": "warmup = 300", "draws = 12000": "draws = 500", "particles = 512": "particles = 128"},
        ("check {0}", "estimate {0} --by mode", "run {0}"),
        True,
    ),
}
EXPORTS = {
    "gz": "remus100_hall_anstee",
    "uuv": "bluerov2_heavy",
    "stonefish": "bluerov2_heavy",
    "fossen": "remus100_hall_anstee",
    "holoocean": "remus100_prestero",
    "json": "mariner",
    "csv": "remus100_longitudinal",
}
"""One export each, of a published vehicle."""


def main() -> None:
    """Write a digest, or compare two."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("digest", type=Path, help="the file to write, or to compare")
    parser.add_argument("--against", type=Path, metavar="EARLIER", help="compare with this one instead of running")
    parser.add_argument("--only", nargs="+", metavar="CASE", help=f"of {', '.join(CASES)}, exports, paper")
    chosen = parser.parse_args()
    if chosen.against:
        sys.exit(compare(json.loads(chosen.against.read_text()), json.loads(chosen.digest.read_text())))
    shutil.rmtree(PLACE, ignore_errors=True)
    found = {}
    for name in chosen.only or [*CASES, "exports", "paper"]:
        print(f"{name} ...", flush=True)
        found |= run_case(name)
    chosen.digest.write_text(json.dumps(found, indent=0, sort_keys=True), encoding="utf-8")
    print(f"{chosen.digest}: {len(found)} entries")


def run_case(name: str) -> dict[str, Any]:
    """Run the commands of a case and return what they printed and wrote.

    Returns:
        `case/file/name` -> words, a number, or a mean and its error.
    """
    folder = PLACE / name
    folder.mkdir(parents=True)
    if name == "exports":
        commands = [f"export {vehicle} --to {target} --out {folder / target}" for target, vehicle in EXPORTS.items()]
    elif name == "paper":
        commands = [f"paper {folder} --quick"]
    else:
        case = CASES[name]
        if case.needs_data and not Path(os.environ.get("SEATRIAL_DATA", "missing")).is_dir():
            print(f"{name}: left out, set SEATRIAL_DATA to the folder of real records")
            return {}
        text = (ROOT / case.source).read_text(encoding="utf-8")
        for old, new in case.smaller.items():
            assert old in text, f"{case.source} has no {old}"
            text = text.replace(old, new)
        (folder / "campaign.toml").write_text(text, encoding="utf-8")
        if (script := (ROOT / case.source).with_name("make_log.py")).is_file():
            subprocess.run([sys.executable, script, folder], check=True)
        commands = [command.format(folder) for command in case.commands]
    found = dict(entry for command in commands for entry in _printed(name, command))
    for path in sorted(folder.rglob("*")):
        if (
            path.is_file()
            and path.suffix not in (".html", ".svg", ".pdf", ".png", ".npz")
            and path.name != "campaign.toml"
        ):
            place = f"{name}/{path.relative_to(folder).as_posix().removeprefix('results/')}"
            found |= dict(_content(place, path))
    return found


def compare(before: dict[str, Any], after: dict[str, Any]) -> int:
    """Print what differs; return 1 if anything does that should not."""
    wrong, moved, equal = [], {}, 0
    clocks = _timed(before) | _timed(after)
    for key in sorted(before.keys() | after.keys()):
        if "/seconds/" in key or key in clocks:
            continue
        one, other = before.get(key), after.get(key)
        if one == other or _is_close(one, other):
            equal += 1
        elif isinstance(one, list) and isinstance(other, list):
            apart = abs(one[0] - other[0]) / (math.hypot(one[1], other[1]) or math.inf)
            if not apart <= ERRORS:
                wrong.append(f"{key}: {one[0]:.10g} ± {one[1]:.2g} became {other[0]:.10g} ± {other[1]:.2g}")
        elif isinstance(one, float) and isinstance(other, float) and _is_drawn(key):
            moved[key] = (one, other)
        else:
            wrong.append(f"{key}: {_short(one)} became {_short(other)}")
    print(*wrong, sep="\n")
    changes = sorted(moved.items(), key=lambda item: -abs(item[1][0] - item[1][1]) / max(map(abs, item[1])))
    for key, (one, other) in changes[:SAMPLES]:
        print(f"follows from draws: {key}: {one:.6g} became {other:.6g}")
    print(f"{equal} equal, {len(moved)} that follow from draws moved, {len(wrong)} differ")
    return int(bool(wrong))


def _printed(name: str, command: str) -> Iterator[tuple[str, Any]]:
    """Yield words and numbers of what a command prints, and its exit code."""
    module = ["studies.remus100"] if command.startswith("paper") else ["seatrial", command.split()[0]]
    done = subprocess.run(
        [sys.executable, "-m", *module, *command.split()[1:]], capture_output=True, text=True, cwd=ROOT
    )
    place = f"{name}/printed/{command.split()[0]} {' '.join(command.split()[2:])}".replace(f"{PLACE}/", "").strip()
    yield f"{place}/code", done.returncode
    if done.returncode not in (0, 3):
        print(done.stderr[-2000:], file=sys.stderr)
    yield from _text(place, done.stdout.replace(str(PLACE), ""))


def _content(place: str, path: Path) -> Iterator[tuple[str, Any]]:
    """Yield what a file holds."""
    if path.suffix == ".json":
        yield from _tree(place, json.loads(path.read_text(encoding="utf-8")))
    elif path.suffix == ".nc":
        with h5py.File(path) as file:
            arrays = {}
            file.visititems(
                lambda item, node: arrays.update({item: node[()]}) if isinstance(node, h5py.Dataset) else None
            )
        for item, array in arrays.items():
            yield from _array(f"{place}/{item}", np.asarray(array))
    else:
        yield from _text(place, path.read_text(encoding="utf-8", errors="replace"))


def _array(place: str, array: np.ndarray) -> Iterator[tuple[str, Any]]:
    """Yield an array whole, its parameters' means with their Monte Carlo errors where it holds draws, or evenly spaced samples of it."""
    if array.dtype.kind not in "fiub":
        yield place, [str(value) for value in array.ravel()[:FULL]]
    elif place.split("/")[1] == "posterior" and array.ndim >= 2 and array.shape[0] * array.shape[1] > FULL:
        draws = array.reshape(array.shape[0], array.shape[1], -1).astype(float)
        for column in range(draws.shape[2]):
            chains = draws[:, :, column].mean(axis=1)
            yield f"{place}/{column}", [float(chains.mean()), float(chains.std(ddof=1) / math.sqrt(len(chains)))]
    else:
        flat = array.ravel().astype(float)
        at = range(flat.size) if flat.size <= FULL else np.linspace(0, flat.size - 1, SAMPLES).astype(int)
        yield from ((f"{place}/{i}", float(flat[i])) for i in at)


def _tree(place: str, node: Any) -> Iterator[tuple[str, Any]]:
    """Yield the leaves of a JSON tree; a value beside its `std_error` as a pair."""
    if isinstance(node, dict):
        error = node.get("std_error", node.get("error"))
        for name, value in node.items():
            if name in PASSING:
                continue
            if name in ("log_value", "log_evidence", "value") and isinstance(error, float) and isinstance(value, float):
                yield f"{place}/{name}", [value, error]
            else:
                yield from _tree(f"{place}/{name}", value)
    elif isinstance(node, list):
        for i, value in enumerate(node):
            yield from _tree(f"{place}/{i}", value)
    elif isinstance(node, str):
        yield from _text(place, node)
    else:
        yield place, float(node) if isinstance(node, int | float) and not isinstance(node, bool) else node


def _text(place: str, text: str) -> Iterator[tuple[str, Any]]:
    """Yield the words of a text with its numbers taken out, and the numbers; of a long table evenly spaced lines."""
    lines = re.sub(r"\b[0-9a-f]{64}\b", "KEY", text).splitlines()
    if len(lines) > FULL:
        lines = [lines[i] for i in np.linspace(0, len(lines) - 1, SAMPLES).astype(int)]
    for number, line in enumerate(lines):
        yield f"{place}/{number}", " ".join(_NUMBER.sub("#", line).split())
        for i, found in enumerate(_NUMBER.findall(line)):
            yield f"{place}/{number}#{i}", float(found.replace(" ", "").replace("−", "-"))


def _timed(digest: dict[str, Any]) -> set[str]:
    """Return the numbers of the study's items that a clock gives."""
    numbers = {match[0] for key in digest if (match := re.match(r".*/items/\d+/numbers/\d+", key))}
    clocks = {one for one in numbers if any(word in str(digest.get(f"{one}/name/0")) for word in CLOCK)}
    return {key for key in digest if key.rpartition("/")[0] in clocks}


def _is_drawn(key: str) -> bool:
    return any(part.startswith(DRAWN) for part in key.split("/")[1:])


def _is_close(one: Any, other: Any) -> bool:
    if not (isinstance(one, float) and isinstance(other, float)):
        return False
    return abs(one - other) <= RELATIVE * max(abs(one), abs(other)) or (math.isnan(one) and math.isnan(other))


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) < 100 else text[:97] + "..."


if __name__ == "__main__":
    main()
