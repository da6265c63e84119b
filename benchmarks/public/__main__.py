"""The command line of the benchmark: `python -m benchmarks.public SET --data FOLDER [--methods NAMES]`."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.cli.answer import Exit, echo
from seatrial.cli.running import Quiet, run_app, watched

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
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
    from benchmarks.public.methods import METHODS
    from benchmarks.public.set_file import read_set, set_names

    for name in set_names():
        one = read_set(name)
        echo(f"{name}: {one.title}; {len(one.fit)} runs to fit, {len(one.held_back)} held back")
        echo(f"  {one.vehicle}")
        echo(f"  {one.source['where']}, {one.source['version']}; licence: {one.source['licence']}")
        echo(f"  {one.source['get']}")
    echo("methods:")
    for method in METHODS.values():
        echo(f"  {method.name}: {method.words}{', slow, by name only' * method.is_slow}")
    return Exit.OK


def _run(name: str | None, data: Path | None, out: Path, methods: str | None, reporter: Any) -> Exit:
    from benchmarks.public.methods import choose
    from benchmarks.public.run import run_set
    from benchmarks.public.set_file import read_set, set_names
    from benchmarks.public.write import lines, write_result
    from seatrial.core.errors import InputError

    if name is None:
        raise InputError(
            "benchmark",
            found="no set",
            expected="one of " + ", ".join(set_names()) + ", or a set file",
            remedy="`python -m benchmarks.public --list` describes each",
        )
    record_set, chosen = (
        read_set(name),
        choose(None if methods is None else [one.strip() for one in methods.split(",")]),
    )
    variable = os.environ.get("SEATRIAL_DATA")
    result = run_set(record_set, chosen, data or (Path(variable) if variable else None), out, reporter)
    paths = write_result(result, out / record_set.name)
    echo("\n".join(lines(result)))
    for text in result.beaten():
        echo(f"not beaten: {text}")
    echo("results: " + ", ".join(map(str, paths)))
    return Exit.OK


if __name__ == "__main__":
    run_app(app)
