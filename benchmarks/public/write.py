"""A result of the benchmark on disk: `result.json` with all of it, `table.csv` with a row for each number's place, `page.html` to read."""

import csv
import io
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from benchmarks.public.run import Entry, Result
from benchmarks.public.scores import PooledScore
from benchmarks.public.tasks import TASKS
from seatrial import __version__
from seatrial.core.files import write_json, write_text
from seatrial.core.visible import visible

COLUMNS = (
    "set",
    "method",
    "task",
    "channel",
    "unit",
    "runs",
    "diverging",
    "samples",
    "effective_samples",
    "explained",
    "crps",
    "log_score",
    "coverage_50",
    "coverage_90",
    "range_90_low",
    "range_90_high",
    "band_holds",
    "seconds_fit",
    "seconds_predict",
    "failed",
)
"""Of `table.csv`."""


def write_result(result: Result, folder: Path) -> tuple[Path, Path, Path]:
    """Write all three files into a folder, each whole or not at all; returns their paths."""
    paths = folder / "result.json", folder / "table.csv", folder / "page.html"
    write_json(paths[0], result.as_json())
    write_text(paths[1], as_csv(result))
    write_text(paths[2], as_page(result))
    return paths


def as_csv(result: Result) -> str:
    """Return the scores pooled over held-back runs, a line for each method, task and channel; of a method that failed one line."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry in result.entries:
        if entry.failed:
            writer.writerow([result.set.name, entry.method, *[""] * (len(COLUMNS) - 3), entry.failed])
        for task, scores in entry.pooled.items():
            for score in scores:
                low, high = score.range_90 or (None, None)
                writer.writerow(
                    [
                        result.set.name,
                        entry.method,
                        task,
                        score.channel,
                        result.channels[score.channel],
                        score.runs,
                        score.failed,
                        score.samples,
                        *map(
                            _number,
                            (
                                score.effective,
                                score.explained,
                                score.crps,
                                score.log_score,
                                score.coverage_50,
                                score.coverage_90,
                                low,
                                high,
                            ),
                        ),
                        "" if score.holds is None else str(score.holds).lower(),
                        _number(entry.seconds_fit),
                        _number(entry.seconds_predict),
                        "",
                    ]
                )
    return stream.getvalue()


def as_page(result: Result) -> str:
    """Return one self-contained page."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("page.html").render(
        found=result.set,
        channels=result.channels,
        entries=result.entries,
        tasks=[(task, rows_of(result, task.name)) for task in TASKS],
        beaten=result.beaten(),
        coefficients=coefficient_lines(result),
        version=__version__,
    )
    return visible(page)


def rows_of(result: Result, task: str) -> list[tuple[str, bool, list[list[str]]]]:
    """Return, of each method that did a task, its name, whether it is ours, and the cells of each channel as they are shown."""
    return [
        (entry.method, entry.is_ours, [_cells(entry, score, column) for column, score in enumerate(entry.pooled[task])])
        for entry in result.entries
        if not entry.failed
    ]


def lines(result: Result) -> list[str]:
    """Return the table as the command prints it."""
    sentences = [
        f"{result.set.title}: fitted to {', '.join(result.set.fit)}; held back {', '.join(result.set.held_back)}"
    ]
    width = max(len(entry.method) for entry in result.entries)
    for task in TASKS:
        horizon = f" of {result.set.horizon:g} s" if task.name == "short" else ""
        sentences += [
            "",
            f"{task.words}{horizon}",
            f"  {'':<{width}} channel   explained      CRPS   log score  in 50 %  in 90 %  by chance",
        ]
        for method, _, channels in rows_of(result, task.name):
            for cells in channels:
                sentences.append(
                    f"  {method:<{width}} {cells[0]:<8} {cells[1]:>10} {cells[2]:>9} {cells[3]:>11} {cells[4]:>8} {cells[5]:>8}  {cells[6]}"
                )
    sentences += [
        "",
        *(
            f"{entry.method}: {entry.seconds_fit:.1f} s to fit, {entry.seconds_predict:.1f} s to predict"
            + (f"; {entry.note}" if entry.note else "")
            for entry in result.entries
            if not entry.failed
        ),
    ]
    sentences += [f"{entry.method}: no result: {entry.failed}" for entry in result.entries if entry.failed]
    return sentences + coefficient_lines(result)


def coefficient_lines(result: Result) -> list[str]:
    """Return each known coefficient as a method found it, in words."""
    units = result.coefficient_units
    found = []
    for method, name, value, sd, known in result.coefficients():
        spread = "" if sd is None else f" ± {sd:.2g}"
        away = "" if not sd else f", {abs(value - known) / sd:.1f} standard deviations away"
        found.append(f"{method}: {name} {value:.4g}{spread} {units.get(name, '')}, known {known:g}{away}")
    return found


def _cells(entry: Entry, score: PooledScore, column: int) -> list[str]:
    """Channel, share explained, CRPS, log score, the two coverages, and the range of the last."""
    if score.crps is None:
        why = f"diverges in {score.failed} of {score.failed + score.runs} runs" if score.failed else "not predicted"
        return [score.channel, why, "", "", "", "", ""]
    chance = (
        "cannot be judged"
        if score.range_90 is None
        else "{:.0%} to {:.0%}".format(*score.range_90) + ("" if score.holds else ", outside")
    )
    explained = "" if score.explained is None else f"{score.explained:.1%}"
    return [
        score.channel,
        explained,
        f"{score.crps:.3g}",
        f"{score.log_score:.2f}",
        f"{score.coverage_50:.0%}",
        f"{score.coverage_90:.0%}",
        chance,
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
