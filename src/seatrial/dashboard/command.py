"""The web page."""

from pathlib import Path
from typing import Annotated

import typer


def serve(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="[FOLDER]",
            help="Campaign, or folder of campaigns (made if missing); the current folder if not given.",
        ),
    ] = Path("."),
    host: Annotated[
        str, typer.Option(help="Address of the server; any other than loopback needs a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 for any free port.")] = 8080,
    token: Annotated[
        str | None,
        typer.Option(help="Token of every request; if it is needed and not given, one is made and printed."),
    ] = None,
    also: Annotated[
        list[Path] | None,
        typer.Option(
            "--allow-read",
            metavar="DIR",
            help="Another folder that campaigns may read, such as a folder of logs; may be given several times.",
        ),
    ] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open a browser.")] = False,
) -> None:
    """Show campaigns in a browser, without internet."""
    from seatrial.core.errors import InputError, install_extra

    try:
        import nicegui  # noqa: F401
    except ImportError as cause:
        raise InputError(
            "seatrial serve",
            found="no NiceGUI in this environment",
            expected="the extra `dashboard`",
            remedy=install_extra("dashboard"),
        ) from cause
    from seatrial.dashboard.request_guard import token_for
    from seatrial.dashboard.server import serve as run_server

    run_server(folder, host, port, token_for(host, token), browser=not no_browser, also=also or ())
