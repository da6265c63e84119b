"""`seatrial` and `python -m seatrial`: the commands about campaigns, and the one that serves them as web pages."""

import os

from seatrial.cli import main as cli
from seatrial.cli.running import run_app
from seatrial.dashboard.command import serve

COMMANDS = cli.COMMANDS | {"serve": cli.Command(serve, "Share")}
app = cli.app_of(COMMANDS)


def main() -> None:
    """Run the command line on the processor, or where JAX_PLATFORMS says; errors meant for the user are printed without a traceback."""
    # Most commands run programs of few lanes, one after another: a loop on the template took six times longer on a GPU.
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    run_app(app)


if __name__ == "__main__":
    main()
