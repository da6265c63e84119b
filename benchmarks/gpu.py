"""The same work on a GPU and on all cores of this machine's processor: densities, design sweep, chains, evidence, calibration.

`python benchmarks/gpu.py`, or with the other measurements `python benchmarks/run.py gpu`; `--write` keeps the numbers in
docs/dev/gpu.json and makes the table of docs/how-to/cluster.md from them. Where JAX sees no GPU, the script reports that and measures
nothing; `JAX_NUM_CPU_DEVICES=2 python benchmarks/gpu.py --rehearse` then runs the smallest sizes with a second device of the processor in
its place, in the form that an accelerator computes: its numbers are checked, its times mean nothing.

Each size runs on both in turn after one call that compiles. Densities, the sweep and the replicates of a calibration use all cores of the
processor; chains and evidence are one program, which one core runs. Results without random numbers must agree within rounding: orders of
summation, and another exp and log, over thousands of steps. A chain decides at random: where rounding changes one decision in a million,
it takes another path that is as good. So chains, evidence and ranks must agree within their Monte Carlo errors.
"""

import atexit
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from math import isqrt
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from paper_problem import paper_problem
from problems import family, grid, state_space
from timing import Ratio, Row, alternate, row

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.templates import init_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.calibration import calibrate
from seatrial.campaign.store.stored_result import Store
from seatrial.compiled import batching as lanes
from seatrial.core.processes import cores as usable_cores
from seatrial.design.sweep import in_blocks, sweep_family
from seatrial.estimation.diagnostics.calibration import DRAWS
from seatrial.estimation.posterior.mode import find_mode
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.target import log_densities
from seatrial.sampling.tempered_smc import SMCSettings, sample_tempered_smc

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))
import study_numbers  # pyright: ignore[reportMissingImports]

STEPS = 6_000
REPEATS, PATIENCE = 3, 5.0
"""Runs of each size that are timed; one alone where the first on both takes more seconds than `PATIENCE`."""
ROUNDING = 1e-9
"""Relative, of what is computed without a choice."""
ERRORS = 5.0
"""Monte Carlo standard errors between two runs."""
METHOD = "independence-metropolis"
COMMAND = "python benchmarks/gpu.py --write"
DEVICES = ("processor", "GPU")
RATIO, DIFFERENCE = " / ".join(DEVICES), "largest relative difference"


class Numbers(NamedTuple):
    """Results of a run, shape (n,), and their Monte Carlo standard errors; None for results without random numbers."""

    values: np.ndarray
    error: np.ndarray | None = None


def densities(count: int) -> Callable[[], Numbers]:
    """Log densities of many parameter vectors of the paper's posterior."""
    posterior = paper_problem().posterior
    drawn = np.asarray(posterior.sample_prior(jax.random.key(0), count))
    return lambda: Numbers(in_blocks(lambda z: (log_densities(posterior, z),), drawn)[0])


def sweep(count: int) -> Callable[[], Numbers]:
    """Entropy reductions and standard deviations of a square grid of designs."""
    side = isqrt(count)
    space, doublets, designs = state_space(), family(STEPS), grid(side, side, 20.0)

    def run() -> Numbers:
        swept = sweep_family(space, doublets, *designs)
        return Numbers(np.concatenate([swept.gain.ravel(), swept.final_sd.ravel()]))

    return run


def chains(count: int) -> Callable[[], Numbers]:
    """Means of 100 + 100 iterations of adaptive Metropolis, many chains in step, from the mode."""
    posterior, (z, cov) = paper_problem().posterior, _mode()
    starts, settings = jnp.tile(jnp.asarray(z), (count, 1)), ChainSettings(count, 100, 100)
    key = jax.random.key(1)

    def run() -> Numbers:
        drawn = np.asarray(
            sample(SAMPLERS["adaptive-metropolis"], posterior, starts, jnp.asarray(cov), key, settings).z
        )
        return Numbers(drawn.mean((0, 1)), np.asarray(diagnose(drawn).mcse))

    return run


def evidence(particles: int) -> Callable[[], Numbers]:
    """Log evidence by tempered SMC; its variance is that of independent particles, four times over."""
    posterior, key, settings = paper_problem().posterior, jax.random.key(2), SMCSettings(particles)

    def run() -> Numbers:
        result = sample_tempered_smc(posterior, key, settings)
        return Numbers(np.array([result.log_evidence]), np.array([2.0 * np.sqrt(result.expected_variance)]))

    return run


def calibration(replicates: int) -> Callable[[], Numbers]:
    """Ranks of a calibration of the template campaign, as shares."""
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    init_campaign(folder, "remus100")
    campaign = load_campaign(folder)
    trials, path = get_trials(campaign), Store(campaign.folder).calibration(METHOD)

    def run() -> Numbers:
        path.unlink(missing_ok=True)
        shares = calibrate(campaign, trials, replicates, METHOD).ranks.ravel() / DRAWS
        return Numbers(shares, np.full(shares.size, np.sqrt(0.25 / DRAWS)))

    return run


WORK = {
    f"log densities, {STEPS} steps": (densities, (100, 1_000, 10_000, 100_000, 1_000_000), "lanes"),
    f"square-root UKF sweep, {STEPS} steps": (sweep, (100, 900, 10_000), "designs"),
    f"adaptive Metropolis, 200 iterations, {STEPS} steps": (chains, (32, 1024), "chains"),
    f"evidence by tempered SMC, {STEPS} steps": (evidence, (1024, 8192), "particles"),
    f"calibration by {METHOD}": (calibration, (8, 32), "replicates"),
}
"""Titles, what prepares a run of one size on the device in use, sizes, and what they count."""


def speed(cores: int) -> Iterator[Row | Ratio]:
    """Yield seconds of every size on both, and how far their numbers are apart; nothing where there is no GPU."""
    try:
        accelerator = jax.devices("gpu")[0]
    except RuntimeError as error:
        skipped = 'gpu: skipped, because JAX sees no GPU here; pip install -e ".[cuda]" where there is one'
        print(f"{skipped} ({str(error).splitlines()[0]})", file=sys.stderr)
        return
    yield from between(jax.devices("cpu")[0], accelerator, cores)


def rehearse(cores: int) -> Iterator[Row | Ratio]:
    """Yield those of the smallest sizes, a second device of the processor in the place of a GPU, computing as one would.

    Raises:
        SystemExit: the processor is not two devices.
    """
    if len(jax.devices("cpu")) != 2:
        raise SystemExit("gpu: a rehearsal needs two devices; set JAX_NUM_CPU_DEVICES=2")
    processor, other = jax.devices("cpu")
    lanes.backend = lambda: "gpu" if _device() == other else "cpu"
    return between(processor, other, cores, rehearsal=True)


def between(processor: Any, accelerator: Any, cores: int, rehearsal: bool = False) -> Iterator[Row | Ratio]:
    """Yield the measurements of all work on both devices; in a rehearsal of the smallest sizes."""
    devices = dict(zip((DEVICES[0], "second device") if rehearsal else DEVICES, (processor, accelerator), strict=True))
    for group, (prepare, sizes, things) in WORK.items():
        for size in sizes[:1] if rehearsal else sizes:
            yield from _both(group, partial(prepare, size), f"{size} {things}", devices, cores)


def _both(
    group: str, prepare: Callable[[], Callable[[], Numbers]], size: str, devices: dict[str, Any], cores: int
) -> Iterator[Row | Ratio]:
    results: dict[str, Numbers] = {}
    runs = {name: partial(_keep, results, name, device, _on(device, prepare)) for name, device in devices.items()}
    seconds = alternate(runs, 1)
    if sum(times.sum() for times in seconds.values()) < PATIENCE:
        more = alternate(runs, REPEATS - 1, warm_up=False)
        seconds = {name: np.concatenate([times, more[name]]) for name, times in seconds.items()}
    for name, times in seconds.items():
        yield row(group, f"{size}, {name}", cores, "ms", times, 1e-3)
    first, second = (times.min() for times in seconds.values())
    yield Ratio(group, f"{' / '.join(devices)}, {size}", cores, first / second)
    reference, other = results.values()
    apart = _apart(reference.values, other.values)
    relative = float(np.max(apart / np.where(apart > 0, np.abs(reference.values), 1.0)))
    exact = reference.error is None
    yield Ratio(group, f"{DIFFERENCE}, {size}", cores, relative, at_most=ROUNDING if exact else None)
    if reference.error is not None:
        worst = float(np.max(apart / (np.sqrt(2) * reference.error)))
        yield Ratio(group, f"the same in Monte Carlo errors, {size}", cores, worst, at_most=ERRORS)


def _keep(results: dict[str, Numbers], name: str, device: Any, run: Callable[[], Numbers]) -> None:
    results[name] = _on(device, run)


def _on(device: Any, function: Callable[[], Any]) -> Any:
    """Call with a default device, which the threads of a run follow too."""
    before = _device()
    jax.config.update("jax_default_device", device)
    try:
        return function()
    finally:
        jax.config.update("jax_default_device", before)


def _device() -> Any:
    return jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Differences; infinite where one of two is not finite, unless both are the same infinity."""
    with np.errstate(invalid="ignore"):
        return np.where(one == other, 0.0, np.nan_to_num(np.abs(one - other), nan=np.inf, posinf=np.inf))


@cache
def _mode() -> tuple[np.ndarray, np.ndarray]:
    """Mode and covariance of the paper's posterior, found once, so that chains on both devices start alike."""
    mode = find_mode(paper_problem().posterior, key=jax.random.key(0))
    return mode.z, mode.cov


def numbers_of(lines: Sequence[Row | Ratio]) -> dict[str, dict[str, dict[str, float]]]:
    """Return by work and size the least seconds on both, their ratio, and the largest relative difference of the results."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for line in lines:
        words, size = line.what.rsplit(", ", 1) if isinstance(line, Ratio) else line.what.rsplit(", ", 1)[::-1]
        sizes = found.setdefault(line.group, {}).setdefault(size, {})
        sizes[words] = line.value if isinstance(line, Ratio) else 1e-3 * line.minimum
    return found


def tables(numbers: dict[str, Any]) -> str:
    """Return the table of docs/how-to/cluster.md."""
    lines = ["| Work | Size | Processor | GPU | Processor / GPU | Largest relative difference |", f"|{'---|' * 6}"]
    for group in (name for name in numbers if name != "commit"):
        for i, (size, one) in enumerate(numbers[group].items()):
            times = [_time(one[device]) for device in DEVICES]
            cells = [group if i == 0 else "", size, *times, f"{one[RATIO]:.3g}", f"{one[DIFFERENCE]:.2g}"]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"


if __name__ == "__main__":
    measured, lines = rehearse if sys.argv[1:] == ["--rehearse"] else speed, []
    for line in measured(usable_cores()):
        lines.append(line)
        print(*((*line[:-2], line.verdict) if isinstance(line, Ratio) else line), sep=" | ", flush=True)
    if sys.argv[1:] == ["--write"] and lines:
        study_numbers.keep("gpu", numbers := numbers_of(lines))
        study_numbers.show("../how-to/cluster", tables(numbers), COMMAND)
