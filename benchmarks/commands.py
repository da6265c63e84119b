"""How long a user waits: processor seconds, memory and programs of whole commands, with empty caches and with full ones.

`python benchmarks/commands.py` runs the loop on the template campaign twice, each time in a new folder: first with caches that are empty,
then with those that the first left. Growth with the number of structures and of samples follows, the study of the paper, quick and full,
and a click on "Run the design" in the dashboard: its session's answer, without the browser (`dashboard.py --clicks` has one).
Then the fits of records that are long or have many unknowns: ten minutes of an ROV with eight thrusters at 50 Hz, and a minute of nine
channels with 27 unknowns. `--only loop growth run click records paper-quick paper` measures some of it, and `--programs` shows instead
what these fits compile and run: instructions, seconds of compiling and running and times run, the largest first. Nothing else should run
meanwhile. Modules are compiled before, as an installer does, whatever PYTHONDONTWRITEBYTECODE says.
"""

import argparse
import compileall
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
GOALS: dict[str, tuple[float, float]] = {
    "--help": (0.35, 0.35),
    "--version": (0.35, 0.35),
    "init": (0.7, 0.7),
    "inspect": (0.7, 0.7),
    "design": (3, 7),
    "simulate": (2, 4),
    "estimate --by mode": (2.5, 8),
    "estimate": (8, 16),
    "select": (10, 20),
    "next": (5, 9),
    "run": (5, 9),
    "run, nothing left": (1.2, 1.2),
    "report, nothing left": (1.2, 1.2),
    "estimate, nothing left": (1.2, 1.2),
}
"""Processor seconds that a command may take, with caches full and empty; those of `next` and `run` are what is left of the whole loop's."""
RUN_GOALS = (15, 40)
"""Processor seconds of `make run` after set-up, which is `seatrial run` on a new template campaign, with caches full and empty."""
PAPER_GOALS = {"paper-quick": (30, 60), "paper": (210, 270)}
CLICK_GOALS = (3, 8)
"""Seconds until the study is there, and from a click to the design, with caches full and empty."""
RECORDS = {
    "thruster_rov": (600, {"estimate --by mode": (45, 85, 900)}),
    "six_degrees": (60, {"estimate --by mode": (10, 40, 1000), "estimate": (30, 80, 1200)}),
}
"""Examples that are fitted: the length of their record, s, and what each command may take: processor seconds with caches full and empty,
and MB with full ones."""
LOOP_PROGRAMS = 40
"""Programs of the whole loop, whatever the number of structures."""
MORE_TERMS = ("X_u3", "X_du2", "T_n", "X_u2")
"""Terms that are added to the template's two optional ones: each doubles the number of structures."""


class Cost(NamedTuple):
    """What one command took: processor seconds, seconds, MB at most, programs compiled and loaded."""

    cpu: float
    wall: float
    memory: float
    compiled: int
    loaded: int


def main() -> None:
    """Measure and print what was asked for, all of it where nothing was."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--programs", action="store_true", help="show the programs of the fits of records")
    options = parser.parse_args()
    chosen = options.only
    for package in ("src", "studies"):
        compileall.compile_dir(ROOT / package, quiet=1)
    with tempfile.TemporaryDirectory() as place:
        if options.programs:
            _programs(Path(place))
            return
        for name in chosen:
            PARTS[name](Path(place))


def _loop(base: Path) -> None:
    print(f"{'':24}{'goal':>6}{'CPU s':>8}{'s':>7}{'MB':>6}{'compiled':>10}{'loaded':>8}")
    for column, cache in ((1, "empty caches"), (0, "full caches")):
        folder, programs = base / cache.split()[0], 0
        print(cache)
        for name, words in _commands(folder):
            cost = _run(words, base / "cache")
            goal = GOALS[name][column]
            programs += cost.compiled + cost.loaded
            verdict = "" if cost.cpu <= goal else "  over"
            print(
                f"  {name:22}{goal:6.4g}{cost.cpu:8.2f}{cost.wall:7.2f}{cost.memory:6.0f}{cost.compiled:10}{cost.loaded:8}{verdict}"
            )
        print(f"  programs of the loop: {programs}, goal {LOOP_PROGRAMS}")


def _commands(folder: Path) -> Iterator[tuple[str, list[str]]]:
    yield "--help", ["--help"]
    yield "--version", ["--version"]
    yield "init", ["init", str(folder)]
    log = folder.with_suffix(".csv")
    rows = (f"{0.1 * i:.1f},{1.5 + 0.01 * (i % 7):.3f},{1000 + i % 50}" for i in range(1500))
    log.write_text("time [s],u [m/s],n [rpm]\n" + "\n".join(rows) + "\n")
    yield "inspect", ["inspect", str(log)]
    for words in (
        ("design",),
        ("simulate",),
        ("estimate", "--by", "mode"),
        ("estimate",),
        ("select",),
        ("next",),
        ("run",),
    ):
        yield " ".join(words), [words[0], str(folder), *words[1:]]
    for word in ("run", "report", "estimate"):
        yield f"{word}, nothing left", [word, str(folder)]


def _growth(base: Path) -> None:
    print("growth, full caches of the loop above: CPU s and programs")
    for structures, more in ((4, 0), (16, 2), (64, 4)):
        _show_growth(base, f"{structures} structures", MORE_TERMS[:more], "60 s")
    for duration in ("120 s", "240 s"):
        _show_growth(base, f"4 structures, {duration}", (), duration)


def _show_growth(base: Path, title: str, more: Sequence[str], duration: str) -> None:
    folder = base / title.replace(" ", "-").replace(",", "")
    _run(["init", str(folder)], base / "cache")
    _widen(folder / "campaign.toml", more, duration)
    for words in (("design",), ("simulate",), ("estimate", "--by", "mode")):
        first = _run([words[0], str(folder), *words[1:]], base / "cache")
        _forget(folder, words[0])
        second = _run([words[0], str(folder), *words[1:]], base / "cache")
        print(
            f"  {title:22} {' '.join(words):20}{first.cpu:8.2f} ({first.compiled} compiled, {first.loaded} loaded)"
            f"{second.cpu:8.2f} ({second.compiled}, {second.loaded})"
        )


def _widen(path: Path, more: Sequence[str], duration: str) -> None:
    text = path.read_text().replace('duration = "60 s"', f'duration = "{duration}"')
    terms = "".join(f', "{term}"' for term in more)
    text = text.replace('optional = ["X_u", "X_du3"]', f'optional = ["X_u", "X_du3"{terms}]')
    for term in more:
        half = 1e-3 if term == "T_n" else 0.3
        text += f'\n[prior.{term}]\ndistribution = "uniform"\nlower = {-half}\nupper = {half}\n'
    path.write_text(text)


def _forget(folder: Path, command: str) -> None:
    """Have a command's work to do again."""
    for name in ("answers", {"design": "design.nc", "simulate": "records"}.get(command, "none")):
        path = folder / "results" / name
        if path.exists():
            path.rename(folder / f"before-{command}-{name}")


def _whole_run(base: Path) -> None:
    """Run the whole loop by one command on a new campaign, as `make run` does."""
    for kind, goal in (("empty caches", RUN_GOALS[1]), ("full caches", RUN_GOALS[0])):
        folder = base / f"run-{kind[:5].strip()}"
        _run(["init", str(folder)], base / "run-cache")
        cost = _run(["run", str(folder)], base / "run-cache")
        verdict = "" if cost.cpu <= goal else "  over"
        print(
            f"run, {kind}: CPU {cost.cpu:.1f} s, goal {goal}; {cost.wall:.1f} s, {cost.memory:.0f} MB, "
            f"{cost.compiled} compiled, {cost.loaded} loaded{verdict}"
        )


def _records(base: Path) -> None:
    """Fit the records of examples, each command in a folder of its own."""
    for example, (duration, commands) in RECORDS.items():
        made = base / example
        _make_record(example, duration, made)
        for name, goals in commands.items():
            for column, cache in ((1, "empty caches"), (0, "full caches")):
                folder = base / f"{example}-{name}-{cache.split()[0]}"
                shutil.copytree(made, folder)
                command, *options = name.split()
                cost = _run([command, str(folder), *options], base / f"{example}-{name}-cache")
                over = cost.cpu > goals[column] or (not column and cost.memory > goals[2])
                print(
                    f"{example}, {duration} s, {name}, {cache}: CPU {cost.cpu:.1f} s, goal {goals[column]}; {cost.wall:.1f} s, "
                    f"{cost.memory:.0f} MB, {cost.compiled} compiled, {cost.loaded} loaded{'  over' if over else ''}"
                )


def _programs(base: Path) -> None:
    """Show what the fits of records compile and run with empty caches."""
    for example, (duration, commands) in RECORDS.items():
        made = base / example
        _make_record(example, duration, made)
        for name in commands:
            folder = base / f"{example}-{name}"
            shutil.copytree(made, folder)
            command, *options = name.split()
            done = _process(["-c", _COUNTED + _MEASURED, command, str(folder), *options], base / f"{folder.name}-cache")
            rows = re.findall(
                r"program (\S+): (\d+) instructions, ([\d.]+) s compiled, (\d+) runs, ([\d.]+) s", done.stderr
            )
            print(
                f"{example}, {duration} s, {name}\n{'':24}{'instructions':>14}{'compile s':>11}{'runs':>7}{'run s':>9}"
            )
            for title, count, compiled, runs, ran in sorted(rows, key=lambda row: -float(row[2]) - float(row[4])):
                print(f"  {title:22}{count:>14}{float(compiled):11.2f}{runs:>7}{float(ran):9.2f}")


def _make_record(example: str, duration: int, folder: Path) -> None:
    """Simulate the log of an example over so many seconds, and import it."""
    (script,) = (ROOT / "examples" / example).glob("make_*.py")
    folder.mkdir()
    shutil.copy(script.with_name("campaign.toml"), folder)
    code = f"import {script.stem} as made; from pathlib import Path; made.DURATION = {duration}; made.main(Path({str(folder)!r}))"
    subprocess.run([sys.executable, "-c", code], cwd=script.parent, check=True)
    _run(["import", str(folder)], folder.with_name(f"{example}-import-cache"))


def _click(base: Path) -> None:
    """Have a session of the dashboard make the design of a new campaign, with empty caches and with those that were left."""
    from seatrial.dashboard.session import Session

    for kind, goal in (("empty caches", CLICK_GOALS[1]), ("full caches", CLICK_GOALS[0])):
        folder = base / f"click-{kind[:5].strip()}"
        _run(["init", str(folder)], base / "click-cache")
        os.environ |= _environment(base / "click-cache")
        session = Session()
        began = time.monotonic()
        session.start(["design", str(folder)], folder / "log")
        code = session.code(None)
        wall = time.monotonic() - began
        session.close()
        session.process.wait()
        if code:
            raise SystemExit(f"seatrial design {folder} in a session ended with {code}")
        print(f"click to design, {kind}: {wall:.2f} s, goal {goal}{'' if wall <= goal else '  over'}")


def _paper(name: str, base: Path) -> None:
    """Reproduce the paper, with empty caches and with those that were left."""
    warm, cold = PAPER_GOALS[name]
    for kind, goal in (("empty caches", cold), ("full caches", warm)):
        options = ["--quick"] if name == "paper-quick" else []
        words = ["-m", "studies.remus100", str(base / f"{name}-{kind[:5].strip()}"), *options]
        cost = _measure(words, base / f"{name}-cache")
        verdict = "" if cost.wall <= goal else "  over"
        print(f"{name}, {kind}: {cost.wall:.1f} s, goal {goal}; CPU {cost.cpu:.1f} s{verdict}")


PARTS: dict[str, Callable[[Path], None]] = {
    "loop": _loop,
    "growth": _growth,
    "run": _whole_run,
    "click": _click,
    "records": _records,
    "paper-quick": partial(_paper, "paper-quick"),
    "paper": partial(_paper, "paper"),
}
"""What can be measured, each below a folder; growth takes the caches that the loop left."""


def _environment(cache: Path) -> dict[str, str]:
    return {"XDG_CACHE_HOME": str(cache), "PYTHONDONTWRITEBYTECODE": ""}


def _run(words: Sequence[str], cache: Path) -> Cost:
    """Run a command in a process of its own."""
    return _measure(["-c", _MEASURED, *words], cache)


def _measure(words: Sequence[str], cache: Path) -> Cost:
    """Run Python in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = os.times().elapsed
    done = _process(words, cache)
    wall = os.times().elapsed - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    peak = re.search(r"peak memory (\d+) kB", done.stderr)
    return Cost(
        after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        wall,
        int(peak.group(1)) / 1024 if peak else float("nan"),
        len(re.findall("Finished XLA compilation of", done.stderr)),
        len(re.findall("Loaded program ", done.stderr)),
    )


def _process(words: Sequence[str], cache: Path) -> subprocess.CompletedProcess:
    environment = os.environ | _environment(cache) | {"JAX_LOG_COMPILES": "1"}
    done = subprocess.run(
        [sys.executable, *words], env=environment, capture_output=True, text=True, check=False, cwd=ROOT
    )
    if done.returncode not in (0, 3):
        raise SystemExit(f"{' '.join(words[-4:])} ended with {done.returncode}:\n{done.stderr[-2000:]}")
    return done


_COUNTED = """
import atexit, sys, time
from seatrial.compiled import engine
engine.configure()
import jax
rows = {}
def compile(self, *given, of=jax.stages.Lowered.compile, **named):
    began = time.process_time()
    ready = of(self, *given, **named)
    seconds, text = time.process_time() - began, ready.as_text()
    rows[id(ready)] = [text.split()[1].strip(",").removeprefix("jit_"), text.count(" = "), seconds, 0, 0.0, ready]
    return ready
def call(self, *given, of=jax.stages.Compiled.__call__, **named):
    began = time.process_time()
    result = jax.block_until_ready(of(self, *given, **named))
    if id(self) in rows:
        rows[id(self)][3] += 1
        rows[id(self)][4] += time.process_time() - began
    return result
def show():
    for name, count, compiled, runs, ran, _ in rows.values():
        print(f"program {name}: {count} instructions, {compiled:.3f} s compiled, {runs} runs, {ran:.3f} s", file=sys.stderr)
jax.stages.Lowered.compile, jax.stages.Compiled.__call__ = compile, call
atexit.register(show)
"""
"""Counts each program that is compiled, and its runs; processor seconds."""
_MEASURED = """
import atexit, resource, sys
atexit.register(lambda: print("peak memory", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, "kB", file=sys.stderr))
from seatrial.cli.main import main
main()
"""

if __name__ == "__main__":
    main()
