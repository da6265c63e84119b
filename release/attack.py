"""Attacks, seeded and resumable, before a release: `python release/attack.py [--quick] [--only KIND] [--seed N]`.

Every case is a success or a clear refusal; all others are counted and told, with the line that repeats them. Cases run in a worker
process, which is ended when a case takes too long and begun anew after the case at which it died. What is done is kept in outputs/attack.
"""

import argparse
import json
import os
import selectors
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "release"), str(ROOT)]

from attacks import bombs, campaigns, folders, logs, options, streams  # noqa: E402
from attacks.outcome import FAILED, FINE, MOST_MEMORY, Outcome, Watchman, mirror  # noqa: E402

STATE = ROOT / "outputs" / "attack"
BATCH = 200
"""Cases that one worker runs at most."""
KEEP = 20.0
"""Seconds after which what is done is written down."""


class Kind(NamedTuple):
    """One kind of attack.

    Attributes:
        case: (number, random, empty place, watchman) to what came of it.
        count: cases before a release.
        quick: cases of a quick slice.
        limit: seconds of processor time that one case may take.
        words: what it is.
        label: of a case by its number, for one that cannot tell it any more.
        one_in: cases of which one is tried as users would, with readers in processes of their own, which take most of the time; the
            others are tried so only where they fail without.
    """

    case: Callable[[int, Random, Path, Watchman], Outcome]
    count: int
    quick: int
    limit: float
    words: str
    label: Callable[[int], str] = lambda number: ""
    one_in: int = 1


KINDS = {
    "logs": Kind(logs.damaged_log, 100_000, 400, 30, "logs of every format, damaged", logs.label, one_in=20),
    "campaigns": Kind(campaigns.damaged_campaign, 10_000, 100, 30, "campaign files and what they name, damaged"),
    "streams": Kind(streams.damaged_stream, 2000, 20, 30, "live streams, damaged"),
    "options": Kind(options.odd_options, 2000, 50, 30, "campaigns begun by odd options and answers"),
    "bombs": Kind(
        bombs.bomb,
        len(bombs.BOMBS),
        len(bombs.BOMBS),
        120,
        "files that grow when they are unpacked",
        lambda number: list(bombs.BOMBS)[number],
    ),
    "results": Kind(folders.damaged_result, folders.RESULTS, 4, 300, "results damaged, then the campaign run again"),
    "keys": Kind(
        folders.changed_key, len(folders.CHANGES), 2, 300, "keys changed in a finished campaign, then run again"
    ),
    "kills": Kind(folders.kill, 200, 1, 600, "commands killed, then run again"),
    "clocks": Kind(folders.clock, len(folders.CLOCKS), 1, 300, "clocks that jump"),
    "pairs": Kind(folders.pair, 8, 1, 600, "two processes on one campaign"),
    "disks": Kind(folders.disk, 24, 2, 300, "disks that are full or not to be written to"),
}
MIRROR = Kind(mirror, 5, 5, 30, "the attack itself: one case of each outcome")


def main(arguments: list[str] | None = None) -> int:
    """Run the attacks; the exit status is 1 where any case failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=[*KINDS, "mirror"], action="append", help="this kind; may be repeated")
    parser.add_argument("--quick", action="store_true", help="a slice of each, for a first look")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="cases of each kind, in place of those before a release")
    parser.add_argument("--case", type=int, help="repeat one case of --only, and print what came of it")
    parser.add_argument("--fresh", action="store_true", help="forget what is done")
    parser.add_argument("--state", type=Path, default=STATE)
    parser.add_argument("--work", nargs=2, type=int, metavar=("FIRST", "END"), help=argparse.SUPPRESS)
    parser.add_argument("--together", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    chosen = options.only or list(KINDS)
    if options.work is not None or options.case is not None:
        first, end = options.work or (options.case, options.case + 1)
        return work(chosen[0], options.seed, first, end, options.state, options.together)
    failures = 0
    for name in chosen:
        kind = _kind(name)
        count = options.count or (kind.quick if options.quick else kind.count)
        failures += attack(name, options.seed, count, options.state, options.fresh)
    return int(failures > 0)


def attack(name: str, seed: int, count: int, state: Path, fresh: bool = False) -> int:
    """Run the cases of one kind that are not done; returns how many have failed."""
    kind, path = _kind(name), state / f"{name}-{seed}.json"
    done = {} if fresh or not path.is_file() else json.loads(path.read_text(encoding="utf-8"))
    counts, findings, at = Counter(done.get("counts", {})), done.get("findings", {}), done.get("next", 0)
    kept = time.monotonic()
    while at < count:
        end = min(at + BATCH, count)
        for number, outcome in watched(name, seed, at, end, state):
            counts[outcome.what] += 1
            at = number + 1
            if outcome.what in FAILED:
                same = findings.setdefault(
                    f"{outcome.what}: {_general(outcome.line)}", {"cases": 0, "first": number, "line": outcome.line}
                )
                same["cases"] += 1
                if same["cases"] == 1:
                    print(f"  {outcome.what}, {name} case {number}: {outcome.line[:400]}", flush=True)
            if at == end or time.monotonic() - kept > KEEP:
                _keep(path, {"kind": name, "seed": seed, "next": at, "counts": counts, "findings": findings})
                kept = time.monotonic()
    failed = sum(counts[what] for what in FAILED)
    told = ", ".join(f"{counts[what]} {what}" for what in (*FINE, *FAILED) if counts[what])
    for key, found in findings.items():
        print(
            f"  {found['cases']} times {key.partition(':')[0]}, first in `--only {name} --seed {seed} --case {found['first']}`",
            flush=True,
        )
    print(f"{name}: {sum(counts.values())} cases ({kind.words}): {told}", flush=True)
    return failed


def watched(name: str, seed: int, first: int, end: int, state: Path) -> Iterator[tuple[int, Outcome]]:
    """Run cases in workers, one after another; yields what came of each, also where a worker hangs or dies."""
    if _kind(name).one_in == 1:
        yield from _in_workers(name, seed, first, end, state, together=False)
        return
    for number, outcome in _in_workers(name, seed, first, end, state, together=True):
        if outcome.what in FAILED:
            ((_, outcome),) = _in_workers(name, seed, number, number + 1, state, together=False)
        yield number, outcome


def _in_workers(
    name: str, seed: int, first: int, end: int, state: Path, together: bool
) -> Iterator[tuple[int, Outcome]]:
    """Run cases in workers; `together` where those may read what would otherwise be read in a process of its own."""
    kind = _kind(name)
    while first < end:
        begun = first
        command = [sys.executable, __file__, "--only", name, "--seed", str(seed), "--state", str(state)]
        command += ["--work", str(first), str(end), *["--together"] * together]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)]),
            "JAX_PLATFORMS": "cpu",
        }
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment, start_new_session=True
        )
        stream = process.stdout
        assert stream is not None
        try:
            while first < end:
                if not _speaks(process, kind.limit):
                    raise _LostError("hang", f"no end in {kind.limit:g} s of processor time")
                line = stream.readline()
                if not line:
                    code = process.wait()
                    raise _LostError("abort", f"signal {-code}" if code < 0 else f"exit status {code}")
                number, what, text = json.loads(line)
                if what == "bloated" and number > begun:
                    break  # of this case or of those before it? It is tried again by itself
                first = number + 1
                yield number, Outcome(what, text)
                if what == "bloated":
                    break
        except _LostError as lost:
            what, text = lost.args
            yield first, Outcome(what, f"{kind.label(first)}: {text}")
            first += 1
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            shutil.rmtree(state / "places" / f"{name}-{process.pid}", ignore_errors=True)


def _kind(name: str) -> Kind:
    return MIRROR if name == "mirror" else KINDS[name]


class _LostError(Exception):
    """A worker that hangs or has died."""


def _speaks(process: subprocess.Popen, limit: float) -> bool:
    """Wait for a line of a worker, or its end; false where it works, or waits ten times as long, without one.

    A worker's first line waits for imports and compilation, which have a minute.
    """
    start, used = time.monotonic(), _processor_time(process.pid)
    with selectors.DefaultSelector() as waiting:
        assert process.stdout is not None
        waiting.register(process.stdout, selectors.EVENT_READ)
        while not waiting.select(1.0):
            late = time.monotonic() - start > 10 * limit + 300
            if late or _processor_time(process.pid) - used > limit + 60:
                return False
    return True


def _processor_time(pid: int) -> float:
    """Seconds that a process and its ended children have worked."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def _peak_memory() -> int:
    """Return the most bytes that this process has held; `getrusage` would begin with those of the process that started it."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def work(name: str, seed: int, first: int, end: int, state: Path, together: bool = False) -> int:
    """Run cases in this process, a line of JSON for each."""
    from seatrial.core import processes as apart

    kind, watchman = _kind(name), Watchman()
    out = os.fdopen(os.dup(1), "w")
    place = state / "places" / f"{name}-{os.getpid()}"
    for number in range(first, end):
        one = place / str(number)
        shutil.rmtree(one, ignore_errors=True)
        one.parent.mkdir(parents=True, exist_ok=True)
        start = time.process_time()
        apart._is_apart = together and number % kind.one_in > 0
        outcome = kind.case(number, Random(f"{seed} {name} {number}"), one, watchman)
        spent = time.process_time() - start
        if spent > kind.limit and number > first:
            outcome = Outcome("hang", f"{spent:.0f} s; then {outcome.what} {outcome.line}")
        if (peak := _peak_memory()) > MOST_MEMORY:
            outcome = Outcome("bloated", f"{peak / 1e9:.1f} GB; {outcome.line}")
        shutil.rmtree(one, ignore_errors=True)
        print(json.dumps([number, *outcome]), file=out, flush=True)
        if outcome.what == "bloated":
            break
    shutil.rmtree(place, ignore_errors=True)
    return 0


def _general(line: str) -> str:
    """A line without its numbers, by which the same failure is known again."""
    return "".join("#" if c.isdigit() else c for c in line)[-160:]


def _keep(path: Path, content: dict) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1), encoding="utf-8")
    os.replace(part, path)


if __name__ == "__main__":
    sys.exit(main())
