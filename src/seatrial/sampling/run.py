"""What every Markov chain sampler shares: the size of a run, the run itself as arrays, and the draws it ends in.

A run advances in blocks of 100 iterations. Iteration t uses the key folded with t, so that a run cut after any block, stored
and resumed, gives the same bits.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import NumericalError

BLOCK = 100


@dataclass(frozen=True)
class ChainSettings:
    """Size of a run.

    Attributes:
        chains: chains in step.
        warmup: iterations that adapt and are dropped, a multiple of 100.
        draws: iterations after them, a multiple of 100.
        thin: every how many-th of these is kept, a divisor of 100.
    """

    chains: int = 32
    warmup: int = 500
    draws: int = 1500
    thin: int = 1


class Run(NamedTuple):
    """A run so far: what a checkpoint holds.

    Attributes:
        state: everything the next iteration needs, a NamedTuple of arrays with `z` and `log_density` among them.
        iteration: iterations done.
        z: positions kept.
        log_density: log densities there.
        acceptance: mean acceptance probability of all chains in each iteration kept.
    """

    state: Any
    iteration: int
    z: Float[np.ndarray, "kept chains d"]
    log_density: Float[np.ndarray, "kept chains"]
    acceptance: Float[np.ndarray, " kept"]


class Draws(NamedTuple):
    """Draws after warm-up.

    Attributes:
        z: positions, shape (chains, draws, d).
        log_density: log densities there, shape (chains, draws).
        acceptance: mean acceptance probability.
        divergences: transitions after warm-up whose trajectory left the surface it was to follow; 0 where there are none.
    """

    z: Float[np.ndarray, "chains draws d"]
    log_density: Float[np.ndarray, "chains draws"]
    acceptance: float
    divergences: int = 0


def begin(state: Any) -> Run:
    """Begin a run at a state; its arrays get types that no block changes, so that one program serves all blocks."""
    state = jax.tree.map(lambda x: jnp.asarray(x, x.dtype), state)
    chains, d = state.z.shape
    return Run(state, 0, np.empty((0, chains, d)), np.empty((0, chains)), np.empty(0))


def refuse_dead_starts(log_density: Float[Array, " chains"]) -> None:
    """Check the log densities where chains start.

    Raises:
        NumericalError: a start of zero density.
    """
    bad = int(np.sum(~np.isfinite(log_density)))
    if bad:
        raise NumericalError(
            f"{bad} of {len(log_density)} chains start where the density is zero: start them inside the support"
        )


def keep(run: Run, state: Any, drawn: tuple[Array, Array, Array], settings: ChainSettings) -> Run:
    """Append the positions, log densities and acceptances of one block to a run, thinned, unless it is still warming up."""
    drawn[-1].block_until_ready()
    iteration = run.iteration + BLOCK
    if iteration <= settings.warmup:
        return run._replace(state=state, iteration=iteration)
    so_far = (run.z, run.log_density, run.acceptance)
    kept = [
        np.concatenate([old, np.asarray(new)[settings.thin - 1 :: settings.thin]])
        for old, new in zip(so_far, drawn, strict=True)
    ]
    return Run(state, iteration, *kept)


def is_finished(run: Run, settings: ChainSettings) -> bool:
    """Whether the run has all its draws."""
    return run.iteration >= settings.warmup + settings.draws


def finish(run: Run) -> Draws:
    """Draws of a finished run."""
    return Draws(np.swapaxes(run.z, 0, 1), run.log_density.T, float(run.acceptance.mean()))


def complaints_of_draws(draws: Draws) -> list[str]:
    """What is wrong with the chains as such, in words; empty where all moved and none diverged."""
    chains, kept, _ = draws.z.shape
    said = []
    still = np.flatnonzero((draws.z == draws.z[:, :1]).all((1, 2)))
    if kept > 1 and still.size:
        which = ", ".join(str(i + 1) for i in still[:5]) + (", ..." if still.size > 5 else "")
        said.append(
            f"{still.size} of {chains} chains never moved in {kept} draws (chain {which}): they started where the density "
            "is broken or the proposal is far too wide; warm up longer, or use another sampler"
        )
    if draws.divergences:
        said.append(
            f"{draws.divergences} of {chains * kept} transitions diverged: the density has an edge or a narrow neck that "
            "the sampler may not have entered; use adaptive Metropolis, or a prior that keeps clear of it"
        )
    return said


def arrays_of_run(run: Run) -> dict[str, np.ndarray]:
    """Arrays of a run by name, for a checkpoint."""
    state = {f"state {name}": value for name, value in run.state._asdict().items()}
    return {
        name: np.asarray(value) for name, value in (state | dict(zip(run._fields[1:], run[1:], strict=True))).items()
    }


def run_from_arrays(state: type, arrays: Mapping[str, np.ndarray]) -> Run:
    """Restore a run of a sampler whose state has this type; every bit is as it was.

    Raises:
        KeyError: arrays of another sampler.
    """
    restored = state(*(jnp.asarray(arrays[f"state {name}"]) for name in state._fields))
    return Run(restored, int(arrays["iteration"]), *(arrays[name] for name in Run._fields[2:]))
