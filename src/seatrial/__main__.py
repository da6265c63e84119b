"""`seatrial` and `python -m seatrial`: the commands about campaigns, and the one that serves them as web pages."""

from seatrial.cli import main as cli
from seatrial.cli.running import run_app
from seatrial.dashboard.command import serve

COMMANDS = cli.COMMANDS | {"serve": cli.Command(serve)}
app = cli.app_of(COMMANDS)


def main() -> None:
    """Run the command line; errors meant for the user are printed without a traceback."""
    run_app(app)


if __name__ == "__main__":
    main()
