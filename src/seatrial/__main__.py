"""`python -m seatrial`: the command line."""

from seatrial.apps.cli import main

main()
