"""The study of the paper."""

from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.apps.running import Exit, Quiet, watched


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
    vehicle: Annotated[
        Path | None, typer.Option(help="TOML file of another surge vehicle to make the same study of.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Smaller samples: a look in one to two minutes.")] = False,
    quiet: Quiet = False,
) -> None:
    """Reproduce, check and judge every table, figure and claim of the paper seatrial starts from."""

    def work(watch: Any) -> Exit:
        from seatrial.campaign.paper.registry import chosen_items
        from seatrial.campaign.paper.run import check_folder, choose_vehicle, run_paper
        from seatrial.campaign.paper.study import FULL, QUICK
        from seatrial.report.paper.cards import verdict_words
        from seatrial.report.paper.page import write_paper

        chosen = choose_vehicle(reading, vehicle)
        items = chosen_items(only or [], chosen.is_paper)
        place = folder or Path("-".join(["paper", chosen.name, *(["quick"] if quick else [])]))
        check_folder(place, chosen)
        study, judged = run_paper(place, chosen, QUICK if quick else FULL, items, watch)
        width = max(len(item.key) for item in judged)
        for item in judged:
            verdict = verdict_words(item.verdict, chosen)
            typer.echo(f"{item.key:<{width}}  {verdict}" + (f", because {item.because}" if item.because else ""))
        if quick:
            typer.echo("smaller samples (--quick): Monte Carlo errors are several times those of the full study")
        typer.echo(f"report: {write_paper(study, judged)}")
        return Exit.OK

    watched(quiet, work)
