"""Every code block of the README and the documentation runs, and prints about what the page says."""

import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.proof
def test_every_block_runs():
    """One process for all pages, as `python docs/run_blocks.py` does: what one page compiled serves the next."""
    done = subprocess.run([sys.executable, DOCS / "run_blocks.py"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-3000:]
