"""Running one block: TOML is loaded, Python executed, commands run one by one, seatrial itself in this process."""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from blocks import Block, commands
from toml_tables import laid_over

import seatrial

ROOT = Path(__file__).parents[1]
SHARED = "demo"
"""Campaign that the tutorial leaves, of which every page finds a copy."""
LEAST_SHARE = 0.8
"""Share of the lines that a page shows which must still be printed."""
_NUMBER = re.compile(r"[-+±]?\d[\d.,]*(e[-+]?\d+)?")
_PROGRESS = re.compile(r"compiling programs for .*|.*(: done in [\d.]+ s| after [\d.]+ s(, about .* remaining)?)$")


@dataclass
class Work:
    """What became of one block: what went wrong, commands left out or with other output, the block as it would read now, seconds."""

    problem: str = ""
    changed: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    seconds: list[tuple[float, str]] = field(default_factory=list)


def run_block(block: Block, folder: Path, namespace: dict[str, object]) -> Work:
    """Run one block in a folder; Python shares one namespace with the page's other blocks."""
    with _inside(folder), _finished_at_birth(folder / SHARED if "finished" in block.remarks else None):
        if block.language == "toml":
            return Work(_load_toml(block))
        if block.language == "python":
            code, output = _captured(lambda: exec(compile("\n".join(block.lines), block.where, "exec"), namespace))
            return Work("" if code == 0 else f"raised\n{output}")
        return _run_commands(block)


def _run_commands(block: Block) -> Work:
    work, steps = Work(), commands(block)
    left_out = block.remarks.get("except", "\n").split(":")[0]
    for index, (command, told) in enumerate(steps):
        if command.startswith(left_out):
            work.skipped.append(f"{block.where}: {block.remarks['except']}")
            continue
        begun = time.process_time()
        code, output = _run_command(command)
        work.seconds.append((time.process_time() - begun, f"{block.where}: {command}"))
        wanted = int(block.remarks.get("exit", 0)) if index == len(steps) - 1 else 0
        if code != wanted:
            work.problem = f"`{command}` ended with {code}, not {wanted}\n{output}"
            return work
        here = output.replace(f"{os.path.realpath('.')}/", "").replace(f"{Path.cwd()}/", "")
        lines = [line for line in here.rstrip().splitlines() if not _PROGRESS.match(line)]
        if told and _share_found(told, lines) < LEAST_SHARE:
            work.changed.append(f"{block.where}: `{command}` prints something else now\n" + "\n".join(lines))
        lines = excerpt(told, lines) if "excerpt" in block.remarks else lines
        most = int(block.remarks.get("first", len(lines)))
        work.lines += [*f"$ {command}".splitlines(), *lines[:most], *["..."] * (len(lines) > most)]
    return work


def _load_toml(block: Block) -> str:
    """Lay a fragment over a campaign and load it, in a copy unless it is to be kept; what went wrong, or nothing."""
    from seatrial.campaign.config.load import load_campaign
    from seatrial.core.errors import SeatrialError

    kept, base = block.remarks.get("file"), block.remarks.get("base")
    source = ROOT / base if base else Path(SHARED)
    folder = Path(kept or tempfile.mkdtemp(dir=".", prefix="toml-"))
    folder.mkdir(parents=True, exist_ok=True)
    text = "\n".join(block.lines) + "\n"
    if not kept:
        left_out = block.remarks.get("without", "").split()
        text = laid_over((source / "campaign.toml").read_text(encoding="utf-8"), text, left_out)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    try:
        load_campaign(folder)
    except SeatrialError as error:
        return str(error)
    return ""


def _run_command(command: str) -> tuple[int, str]:
    """Run one line of shell; exit code and what it prints."""
    words = shlex.split(command.replace("\\\n", " "), comments=True)
    if words[:2] == ["seatrial", "serve"]:
        return 1, "it serves until it is stopped: skip the block"
    if words[:1] == ["seatrial"]:
        return _captured(lambda: _seatrial(words[1:]))
    done = subprocess.run(["bash", "-ec", command], capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def _seatrial(arguments: list[str]) -> None:
    from seatrial.__main__ import main

    before, sys.argv = sys.argv, ["seatrial", *arguments]
    try:
        main()
    finally:
        sys.argv = before


def _captured(work: Callable[[], object]) -> tuple[int, str]:
    """Exit code and everything printed."""
    out, code = io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            work()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        except Exception:
            traceback.print_exc()
            code = 1
    return code, out.getvalue()


def _share_found(told: tuple[str, ...], lines: list[str]) -> float:
    """Share of the lines a page shows that were printed, numbers aside."""
    shown = [_masked(line) for line in told if line.strip() and line.strip() != "..."]
    there = {_masked(line) for line in lines}
    return sum(line in there for line in shown) / max(len(shown), 1)


def excerpt(told: tuple[str, ...], lines: list[str]) -> list[str]:
    """Return the lines that a page shows, numbers aside, with an ellipsis for each gap."""
    shown, kept = {_masked(line) for line in told}, []
    for line in lines:
        if _masked(line) in shown:
            kept.append(line)
        elif kept[-1:] != ["..."]:
            kept.append("...")
    return kept


def _masked(line: str) -> str:
    return " ".join(_NUMBER.sub("#", line).split())


@contextlib.contextmanager
def _finished_at_birth(demo: Path | None) -> Iterator[None]:
    """Let every new campaign be the tutorial's, finished and without a goal, so that what follows has little to compute."""
    if demo is None:
        yield
        return
    from seatrial.campaign.config import templates

    original = templates.init_campaign

    def init_campaign(folder: Path | str, template: str) -> Path:
        path = original(folder, template)
        shutil.copytree(demo, folder, dirs_exist_ok=True)
        path.write_text(laid_over(path.read_text(encoding="utf-8"), "", ("goal",)), encoding="utf-8")
        return path

    templates.init_campaign = init_campaign
    seatrial.init_campaign = init_campaign
    try:
        yield
    finally:
        templates.init_campaign = original
        del seatrial.init_campaign


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
