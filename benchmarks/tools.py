"""What some measurements need besides this Python, looked for before the first of them starts."""

import shutil
from collections.abc import Iterable
from pathlib import Path

PEERS = Path(__file__).parents[1] / ".venv-peers" / "bin" / "python"
"""Python of the environment that holds PyMC and NumPyro."""
REMEDIES = {
    "gcc": "install it (apt install gcc)",
    "g++": "install it (apt install g++)",
    "peers": f"`make bench` sets it up in {PEERS.parents[1].name}",
}


def check(needs: Iterable[str]) -> None:
    """Look for tools, by their names in `REMEDIES`.

    Raises:
        SystemExit: some are missing; says how to get them.
    """
    missing = [name for name in dict.fromkeys(needs) if shutil.which(PEERS if name == "peers" else name) is None]
    if missing:
        raise SystemExit("\n".join(f"benchmarks: {name} is missing; {REMEDIES[name]}" for name in missing))
