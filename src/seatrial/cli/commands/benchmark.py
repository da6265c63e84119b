"""The benchmark: public records, methods that predict them, and one table."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.cli.answer import Exit, current_answer
from seatrial.cli.running import Quiet, watched


def benchmark(
    found: Annotated[
        str | None, typer.Argument(metavar="SET", help="Name of a set, or a set file of your own, which ends in .toml.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of the set's files; SEATRIAL_DATA if not given.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where results are written.")] = Path("benchmark"),
    methods: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Methods to run, with commas between; all but slow ones if not given."),
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List sets and methods, and say where to get the records.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Compare methods on held-back runs of public records."""

    def work(reporter: Any) -> Exit:
        if list_:
            return _listed()
        return _run(found, data, out, methods, reporter)

    watched(quiet, work)


def _listed() -> Exit:
    from seatrial.benchmark.methods import METHODS
    from seatrial.benchmark.set_file import read_set, set_names

    answer = current_answer()
    sets = {name: read_set(name) for name in set_names()}
    for name, one in sets.items():
        answer.say(f"{name}: {one.title}; {len(one.fit)} runs to fit, {len(one.held_back)} held back")
        answer.say(f"  {one.vehicle}")
        answer.say(f"  {one.source['where']}, {one.source['version']}; licence: {one.source['licence']}")
        answer.say(f"  {one.source['get']}")
    answer.say("methods:")
    for method in METHODS.values():
        answer.say(f"  {method.name}: {method.words}{', slow, by name only' * method.is_slow}")
    rows = [
        {"name": name, "title": one.title, **{key: one.source[key] for key in ("licence", "get")}}
        for name, one in sets.items()
    ]
    answer.give(sets=rows, methods=list(METHODS))
    return Exit.OK


def _run(name: str | None, data: Path | None, out: Path, methods: str | None, reporter: Any) -> Exit:
    from seatrial.benchmark.methods import choose
    from seatrial.benchmark.run import run_set
    from seatrial.benchmark.set_file import read_set, set_names
    from seatrial.benchmark.write import lines, write_result
    from seatrial.core.errors import InputError

    if name is None:
        raise InputError(
            "seatrial benchmark",
            found="no set",
            expected="one of " + ", ".join(set_names()) + ", or a set file",
            remedy="`seatrial benchmark --list` describes each",
        )
    record_set, chosen = (
        read_set(name),
        choose(None if methods is None else [one.strip() for one in methods.split(",")]),
    )
    variable = os.environ.get("SEATRIAL_DATA")
    result = run_set(record_set, chosen, data or (Path(variable) if variable else None), out, reporter)
    paths = write_result(result, out / record_set.name)
    answer = current_answer()
    answer.say("\n".join(lines(result)))
    for text in result.beaten():
        answer.say(f"not beaten: {text}")
    answer.say("results: " + ", ".join(map(str, paths)))
    keys = ("channel", "runs", "explained", "crps", "log_score", "coverage_90")
    rows = [
        {
            "method": entry.method,
            "task": task,
            "unit": result.channels[score.channel],
            "diverging": score.failed,
            **{key: getattr(score, key) for key in keys},
        }
        for entry in result.entries
        for task, channel_scores in entry.pooled.items()
        for score in channel_scores
    ]
    answer.give(set=result.set.name, scores=rows, not_beaten=result.beaten())
    for path in paths:
        answer.name_file(path.name, path)
    return Exit.OK
