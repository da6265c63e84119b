"""The benchmark: public records, methods that predict them, and one table."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.apps.running import Exit, Quiet, watched


def benchmark(
    found: Annotated[
        str | None, typer.Argument(metavar="SET", help="Name of a set, or a set file of your own, which ends in .toml.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of the set's files; SEATRIAL_DATA if not given.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where results are written.")] = Path("benchmark"),
    methods: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Methods to run, with commas between; all if not given.")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List sets and methods, and say where the records are to be had.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Fit every method to some runs of public records and score it on the others."""

    def work(reporter: Any) -> Exit:
        if list_:
            return _listed()
        return _run(found, data, out, methods, reporter)

    watched(quiet, work)


def _listed() -> Exit:
    from seatrial.benchmark.methods import METHODS
    from seatrial.benchmark.set_file import read_set, set_names

    for name in set_names():
        one = read_set(name)
        typer.echo(f"{name}: {one.title}; {len(one.fit)} runs to fit, {len(one.held_back)} held back")
        typer.echo(f"  {one.vehicle}")
        typer.echo(f"  {one.source['where']}, {one.source['version']}; licence: {one.source['licence']}")
        typer.echo(f"  {one.source['get']}")
    typer.echo("methods:")
    for method in METHODS.values():
        typer.echo(f"  {method.name}: {method.words}")
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
            remedy="`seatrial benchmark --list` tells what each is",
        )
    found, chosen = read_set(name), choose(None if methods is None else [one.strip() for one in methods.split(",")])
    variable = os.environ.get("SEATRIAL_DATA")
    result = run_set(found, chosen, data or (Path(variable) if variable else None), out, reporter)
    paths = write_result(result, out / found.name)
    typer.echo("\n".join(lines(result)))
    for text in result.beaten():
        typer.echo(f"not beaten: {text}")
    typer.echo("results: " + ", ".join(map(str, paths)))
    return Exit.OK
