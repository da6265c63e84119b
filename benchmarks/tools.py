"""What some measurements need besides this Python, looked for before the first of them starts."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

PEERS = Path(__file__).parents[1] / ".venv-peers" / "bin" / "python"
"""Python of the environment that holds the peers."""
REMEDIES = {
    "gcc": "install it (apt install gcc)",
    "g++": "install it (apt install g++)",
    "Rscript": "install R and its package BMS (apt install r-base-core r-cran-bms)",
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


def ask(script: str, question: dict, environment: dict[str, str]) -> dict:
    """What a peer finds, in a process of its own on the same cores, without our settings of JAX but those in `environment`.

    Raises:
        SystemExit: it failed; says why.
    """
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "XLA_"))}
    command = [str(PEERS), str(Path(__file__).with_name(script))]
    done = subprocess.run(command, input=json.dumps(question), capture_output=True, text=True, env=clean | environment)
    if done.returncode:
        raise SystemExit(
            f"benchmarks: {script} failed; `rm -r {PEERS.parents[1].name}` and `make bench` set it up anew\n{done.stderr}"
        )
    return json.loads(done.stdout)
