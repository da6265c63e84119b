"""Run every code block of the README and of the documentation: `python docs/run_blocks.py [PAGE ...]`.

The blocks of one page run in order in one temporary folder, all pages in this process, so that nothing starts or compiles twice.
Commands must end with 0 or the code that a remark states (see `blocks.py`). What a page says that a command prints is compared
loosely: numbers may differ, and four lines in five must be there. `--refresh` writes what was printed into the pages instead. The
first page, the tutorial, leaves the folder `demo`, of which every other page finds a copy.
"""

import argparse
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from block_work import ROOT, SHARED, run_block
from blocks import read_blocks
from generate.reference import write_pages
from generate.results import differences

import seatrial

DOCS = Path(__file__).parent
TUTORIAL = DOCS / "tutorial" / "first_decision.md"


@dataclass
class Tally:
    """What became of all blocks."""

    ran: int = 0
    skipped: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    seconds: list[tuple[float, str]] = field(default_factory=list)


def pages() -> list[Path]:
    """The tutorial, the README, and every other page, those of the reference written first; decisions and vehicles have no blocks,
    and `notebooks.py` runs the notebooks."""
    write_pages(DOCS)
    others = sorted(
        path
        for path in DOCS.rglob("*.md")
        if "_build" not in path.parts
        and path.parent.name not in ("decisions", "vehicles", "notebooks")
        and path != TUTORIAL
    )
    return [TUTORIAL, ROOT / "README.md", *others]


def run_pages(chosen: list[Path], refresh: bool = False, demo: Path | None = None) -> Tally:
    """Run the tutorial and the chosen pages, each in a folder of its own.

    Args:
        chosen: pages.
        refresh: whether to write what was printed into them.
        demo: a folder that the tutorial left, to be copied instead of running it.
    """
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        shared = demo or Path(name) / "0" / SHARED
        for number, page in enumerate([*[TUTORIAL] * (demo is None), *(page for page in chosen if page != TUTORIAL)]):
            begun, folder = time.monotonic(), Path(name) / str(number)
            folder.mkdir()
            if page != TUTORIAL:
                shutil.copytree(shared, folder / SHARED)
            run_page(page, folder, refresh and page in chosen, tally)
            print(f"{time.monotonic() - begun:6.1f} s  {page.relative_to(ROOT)}", flush=True)
            if tally.failed and page == TUTORIAL:
                return tally
        tally.failed += [f"docs/generate/results.py: {text}" for text in differences(shared / "results")]
    return tally


def run_page(page: Path, folder: Path, refresh: bool, tally: Tally) -> None:
    """Run one page's blocks in a folder; the first that fails is the last."""
    printed: dict[int, list[str]] = {}
    namespace: dict[str, object] = {"__name__": "__main__"}
    try:
        blocks = read_blocks(page)
    except ValueError as error:
        tally.failed.append(str(error))
        return
    for block in blocks:
        if block.remarks.get("skip"):
            tally.skipped.append(f"{block.where}: {block.remarks['skip']}")
            continue
        tally.ran += 1
        work = run_block(block, folder, namespace)
        tally.seconds += work.seconds
        tally.changed += work.changed
        tally.skipped += work.skipped
        if work.problem:
            tally.failed.append(f"{block.where}: {work.problem}")
            return
        if block.language == "console":
            printed[block.line] = work.lines
    if refresh and printed:
        _refresh(page, printed)
        for picture in (folder / SHARED).glob("*.svg") if page == TUTORIAL else ():
            shutil.copy(picture, page.parent)


def _refresh(page: Path, printed: dict[int, list[str]]) -> None:
    """Write what was printed into a page's console blocks."""
    lines = page.read_text(encoding="utf-8").splitlines()
    for start, text in sorted(printed.items(), reverse=True):
        stop = next(i for i in range(start, len(lines)) if lines[i].strip() == "```")
        lines[start:stop] = text
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Run pages, say what became of their blocks, and end with 1 if any failed or prints something else."""
    parser = argparse.ArgumentParser(description="Run the code blocks of the documentation.")
    parser.add_argument("pages", nargs="*", type=Path, help="pages; all if none")
    parser.add_argument("--refresh", action="store_true", help="write what commands print into the pages")
    parser.add_argument("--slowest", type=int, default=0, help="name so many of the slowest commands")
    parser.add_argument("--demo", type=Path, help="a folder `demo` that the tutorial left, instead of running it")
    options = parser.parse_args()
    seatrial.configure()
    tally = run_pages([page.resolve() for page in options.pages] or pages(), options.refresh, options.demo)
    for seconds, text in sorted(tally.seconds, reverse=True)[: options.slowest]:
        print(f"{seconds:6.1f} s of processor  {text}")
    for text in tally.skipped:
        print(f"skipped {text}")
    for text in (*tally.failed, *([] if options.refresh else tally.changed)):
        print(f"FAILED {text}")
    counts = (tally.ran, len(tally.skipped), len(tally.failed), len(tally.changed))
    print("{} blocks run, {} skipped, {} failed, {} commands print something else".format(*counts))
    sys.exit(bool(tally.failed or (tally.changed and not options.refresh)))


if __name__ == "__main__":
    main()
