"""Markov chain samplers behind one protocol: every module of the family is a sampler, chosen by name from one table."""

from collections.abc import Iterator, Mapping
from typing import Any, Protocol, get_args

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.reporter import Progress, no_progress
from seatrial.sampling.names import SamplerName
from seatrial.sampling.run import BLOCK, ChainRun, ChainSettings, Draws, begin, finish, is_finished
from seatrial.sampling.target import Target


class Sampler(Protocol):
    """Chains in step that go on block by block.

    What lies between two blocks is a `ChainRun`, arrays only: stored with `arrays_of_run`, restored with `run_from_arrays` and the
    sampler's `State`, it goes on with the same bits.
    """

    @property
    def State(self) -> Any:
        """Type of the state inside a run, a NamedTuple of arrays."""
        ...

    def first_state(self, target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> Any:
        """Return the state at one position for each chain, with a guess of the covariance."""
        ...

    def advance_block(self, target: Target, state: Any, key: jax.Array, start: int, warmup: int) -> Any:
        """Return the state after a block of iterations, the first of number `start`, and what each drew: z, log density, acceptance."""
        ...


class _Samplers(Mapping[str, Sampler]):
    """The modules of the family by name, each imported when it is looked up: the No-U-Turn sampler brings a library of its own."""

    def __getitem__(self, name: str) -> Sampler:
        match name:
            case "independence-metropolis":
                from seatrial.sampling import independence_metropolis as sampler
            case "adaptive-metropolis":
                from seatrial.sampling import adaptive_metropolis as sampler
            case "metropolis":
                from seatrial.sampling import metropolis as sampler
            case "de-metropolis":
                from seatrial.sampling import de_metropolis as sampler
            case "nuts":
                from seatrial.sampling import nuts as sampler
            case _:
                raise KeyError(name)
        return sampler

    def __iter__(self) -> Iterator[str]:
        return iter(get_args(SamplerName))

    def __len__(self) -> int:
        return len(get_args(SamplerName))


SAMPLERS = _Samplers()


def start_chains(
    sampler: Sampler, target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]
) -> ChainRun:
    """Begin a run.

    Args:
        sampler: module of the family.
        target: density to sample.
        starts: one position for each chain, of finite density, z, shape (chains, d).
        cov: guess of the covariance, for example that of the Laplace approximation, shape (d, d).

    Raises:
        NumericalError: a start of zero density.
    """
    return begin(sampler.first_state(target, starts, cov))


def advance_chains(
    sampler: Sampler, target: Target, run: ChainRun, key: jax.Array, settings: ChainSettings
) -> ChainRun:
    """Advance a run by one block of iterations, of which the draws are kept, thinned, unless it is still warming up.

    Args:
        sampler: that began the run.
        target: density to sample.
        run: so far.
        key: random key, the same for all blocks.
        settings: size of the run.
    """
    state, drawn = sampler.advance_block(target, run.state, key, run.iteration, settings.warmup)
    drawn[-1].block_until_ready()
    iteration = run.iteration + BLOCK
    if iteration <= settings.warmup:
        return run._replace(state=state, iteration=iteration)
    so_far = (run.z, run.log_density, run.acceptance)
    kept = [
        np.concatenate([old, np.asarray(new)[settings.thin - 1 :: settings.thin]])
        for old, new in zip(so_far, drawn, strict=True)
    ]
    return ChainRun(state, iteration, *kept)


def sample(
    sampler: Sampler,
    target: Target,
    starts: Float[Array, "chains d"],
    cov: Float[Array, "d d"],
    key: jax.Array,
    settings: ChainSettings,
    progress: Progress = no_progress,
) -> Draws:
    """Sample without checkpoints: start, then advance until all draws are made.

    Args:
        sampler: module of the family.
        target: density to sample.
        starts: of the chains, z, shape (chains, d).
        cov: covariance to begin with, shape (d, d).
        key: random key.
        settings: size of the run.
        progress: told how many iterations are done.

    Raises:
        NumericalError: a start of zero density.
    """
    run = start_chains(sampler, target, starts, cov)
    while not is_finished(run, settings):
        run = advance_chains(sampler, target, run, key, settings)
        progress(run.iteration, settings.warmup + settings.draws)
    return finish(run)
