"""What some measurements need besides this Python, and questions to peers in an environment of their own."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

PEERS = Path(__file__).parents[1] / ".venv-peers" / "bin" / "python"
"""Python of the environment that holds the peers."""
REMEDIES = {
    "gcc": "install it (apt install gcc)",
    "g++": "install it (apt install g++)",
    "Rscript": "install R and its package BMS (apt install r-base-core r-cran-bms)",
    "peers": f"`make bench` sets it up in {PEERS.parents[1].name}",
}


def missing(needs: Sequence[str]) -> str:
    """Say which tools are missing, by their names in `REMEDIES`, and how to get them; nothing if none is."""
    lost = [name for name in needs if shutil.which(PEERS if name == "peers" else name) is None]
    return "; ".join(f"{name} is missing: {REMEDIES[name]}" for name in lost)


def ask(script: str, question: dict, environment: dict[str, str]) -> dict:
    """What a peer finds, in a process of its own on the same cores, without our settings of JAX but those in `environment`.

    Raises:
        SystemExit: it failed; says why.
    """
    command = [str(PEERS), str(Path(__file__).with_name(script))]
    done = subprocess.run(
        command, input=json.dumps(question), capture_output=True, text=True, env=_environment() | environment
    )
    if done.returncode:
        raise SystemExit(
            f"benchmarks: {script} failed; `rm -r {PEERS.parents[1].name}` and `make bench` set it up anew\n{done.stderr}"
        )
    return json.loads(done.stdout)


def later_process(script: str) -> float:
    """Return the seconds that a script of ours prints in its second process, with the programs that the first one has kept."""
    command = [sys.executable, str(Path(__file__).with_name(script))]
    with TemporaryDirectory() as folder:
        for _ in range(2):
            done = subprocess.run(
                command, stdout=subprocess.PIPE, text=True, env=_environment() | {"XDG_CACHE_HOME": folder}, check=True
            )
    return float(done.stdout)


def _environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "XLA_"))}
