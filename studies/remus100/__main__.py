"""The command line of the study: `python -m studies.remus100 [DIR] [--quick] [--only ITEMS]`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.cli.running import Exit, Quiet, run_app, watched

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
def paper(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="[DIR]", help="Folder of results; if not given, paper-A, paper-A-quick and so on."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Items to reproduce, such as table-3,figure-6; all if not given. An unknown one lists them."),
    ] = None,
    reading: Annotated[
        str, typer.Option(help="How the paper's unprinted units are read: A (rev/s) or B (rad/s).")
    ] = "A",
    quick: Annotated[bool, typer.Option("--quick", help="Smaller samples: a look in one to two minutes.")] = False,
    quiet: Quiet = False,
) -> None:
    """Reproduce, check and judge every table, figure and claim of the paper seatrial starts from."""

    def work(reporter: Any) -> Exit:
        from studies.remus100.page import write_paper
        from studies.remus100.registry import chosen_items
        from studies.remus100.run import check_folder, choose_reading, run_paper
        from studies.remus100.study import FULL, QUICK

        chosen = choose_reading(reading)
        items = chosen_items(only or [])
        place = folder or Path("-".join(["paper", chosen.name, *(["quick"] if quick else [])]))
        check_folder(place, chosen)
        study, judged = run_paper(place, chosen, QUICK if quick else FULL, items, reporter)
        width = max(len(item.key) for item in judged)
        for item in judged:
            typer.echo(f"{item.key:<{width}}  {item.words}")
        if quick:
            typer.echo("smaller samples (--quick): Monte Carlo errors are several times those of the full study")
        typer.echo(f"report: {write_paper(study, judged)}")
        return Exit.OK

    watched(quiet, work)


if __name__ == "__main__":
    run_app(app)
