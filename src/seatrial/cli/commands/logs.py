"""Logs before the import: their columns, and a draft of a channel map."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.cli.answer import Exit, current_answer
from seatrial.cli.running import Quiet, watched

_PATIENCE = 2.0


def inspect(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG",
            help="CSV, TSV, Parquet, NetCDF, MATLAB, NumPy archive, ROS 1 or 2 bag, MCAP, dataflash, MAVLink, PX4 or MOOS log. "
            "Give several files of one run to map them together.",
        ),
    ],
    table: Annotated[
        str | None, typer.Option(help="Only this topic, type of message, struct, group or variable.")
    ] = None,
    map_: Annotated[
        bool, typer.Option("--map", help="Print only the guessed map, as [[import.files]] of a campaign file.")
    ] = False,
    only: Annotated[
        list[str] | None, typer.Option(help="Channels to map, such as u,tau_X; all guessed ones if not given.")
    ] = None,
    delimiter: Annotated[
        str | None,
        typer.Option(help='For text files: the character between cells, or "whitespace"; if not given, by the suffix.'),
    ] = None,
    skip_rows: Annotated[int, typer.Option(min=0, help="For text files: lines above the header.")] = 0,
    encoding: Annotated[str, typer.Option(help="Encoding of text files.")] = "utf-8",
    quiet: Quiet = False,
) -> None:
    """List the columns of a log, and guess its channel map.

    If several logs have a channel, the first is used. A log without a new channel counts as another run. If the clocks of the logs of a run
    differ, a quantity that both logs contain gives the shift.
    """

    def work(reporter: Any) -> Exit:
        from seatrial.logs.formats.protocol import TextLayout
        from seatrial.logs.inspect import LogsTogether, inspect_log

        layout = TextLayout(delimiter, skip_rows, encoding=encoding)
        channels = [name for text in only or () for name in text.split(",")]
        summaries = [
            inspect_log(log, table, layout, progress=_late_progress(reporter, f"reading {log.name}")) for log in logs
        ]
        together, answer = LogsTogether(tuple(summaries), tuple(channels)), current_answer()
        maps = together.maps()
        printed = maps if map_ else ["\n".join(lines) for lines in together.lines()]
        answer.say("\n\n".join(text.rstrip("\n") for text in printed))
        documents = [
            {
                "kind": one.kind,
                "tables": [
                    {"name": table.info.name, "rows": table.rows, "clocks": table.clocks, "columns": table.columns}
                    for table in one.tables
                ],
                "guesses": one.guesses,
                "map": guessed,
            }
            for one, guessed in zip(summaries, maps, strict=True)
        ]
        answer.give(**(documents[0] if len(documents) == 1 else {"logs": documents}))
        return Exit.OK

    watched(quiet, work)


def _late_progress(reporter: Any, title: str) -> Callable[[float], None]:
    """Return a progress bar that appears if the work takes over two seconds."""
    started, report = time.monotonic(), None

    def told(share: float) -> None:
        nonlocal report
        if report is None and share < 1 and time.monotonic() - started > _PATIENCE:
            report = reporter.progress(title)
        if report is not None:
            report(round(1000 * share), 1000)

    return told
