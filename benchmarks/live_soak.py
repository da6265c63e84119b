"""Hours of a stream at 100 Hz through `seatrial live`, as text: `python benchmarks/live_soak.py [HOURS]` prints memory and processor time.

The vehicle is the one of examples/design_trial under a doublet without end; once an hour the stream stops for ten seconds, and once its
clock is set back. Everything is kept on disk as it is at sea.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.live.session import Session
from seatrial.campaign.live.session_files import Kept
from seatrial.campaign.live.sources import Piece
from seatrial.compiled import engine

RATE, RPM = 100, 2 * np.pi / 60
BLOCK = 10
"""Samples that come at a time."""


def main(hours: float) -> None:
    """Print one line for each sixth of an hour of the stream."""
    engine.configure()
    text = (Path(__file__).parents[1] / "examples" / "design_trial" / "campaign.toml").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(text, encoding="utf-8")
        campaign = load_campaign(folder)
        session = Session(campaign, "soak")
        session.warm()
        session.kept = Kept(campaign, ".received.csv", ("n", "u"))
        session.take(Piece(["time,n,u"], begins=True))
        _run(session, int(hours * 3600 * RATE))
        session.kept.close()
        print("\n".join(session.look().lines()))


def _run(session: Session, samples: int) -> None:
    rng, u, every = np.random.default_rng(0), 1.54, 600 * RATE
    offset, worst, began = 0.0, 0.0, time.process_time()
    for first in range(0, samples, BLOCK):
        lines = []
        if first and first % (3600 * RATE) == 0:
            offset += 10.0 if (first // (3600 * RATE)) % 2 else -1800.0
        for k in range(first, first + BLOCK):
            n = (1194.0 + 200.0 * np.sign(np.sin(2 * np.pi * k / RATE / 16.0))) * RPM
            lines.append(f"{k / RATE + offset:.2f},{n:.4f},{u + 0.05 * rng.normal():.4f}")
            u += (0.9 * 6.28e-4 * n * n - 1.21 * u - 2.93 * u * abs(u)) / 31.41 / RATE
        taken = time.process_time()
        session.take(Piece(lines, raw=("\n".join(lines) + "\n").encode()))
        worst = max(worst, time.process_time() - taken)
        if (first + BLOCK) % every == 0:
            spent, began = time.process_time() - began, time.process_time()
            size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(
                f"{(first + BLOCK) / RATE / 3600:.2f} h: {spent / every * 1e3:.3f} ms of processor a sample, the worst block of "
                f"{BLOCK} {worst * 1e3:.0f} ms, memory {size:.0f} MiB at most",
                flush=True,
            )
            worst = 0.0


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)
