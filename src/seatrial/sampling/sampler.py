"""Markov chain samplers behind one protocol: every module of the family is a sampler, chosen by name from one table."""

from collections.abc import Iterator, Mapping
from typing import Any, Protocol, get_args

import jax
from jaxtyping import Array, Float

from seatrial.core.reporter import Progress, no_progress
from seatrial.sampling.names import SamplerName
from seatrial.sampling.run import ChainRun, ChainSettings, Draws, is_finished
from seatrial.sampling.target import Target


class Sampler(Protocol):
    """Chains in step that start, advance block by block, and finish.

    What lies between two blocks is a `Run`, arrays only: stored with `arrays_of_run`, restored with `run_from_arrays` and the
    sampler's `State`, it goes on with the same bits.
    """

    @property
    def State(self) -> Any:
        """Type of the state inside a run, a NamedTuple of arrays."""
        ...

    def start_chains(self, target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> ChainRun:
        """Begin a run from one position of finite density for each chain and a guess of the covariance."""
        ...

    def advance_chains(self, target: Target, run: ChainRun, key: jax.Array, settings: ChainSettings) -> ChainRun:
        """Advance a run by one block of iterations; the key is the same for all blocks."""
        ...

    def finish(self, run: ChainRun) -> Draws:
        """Return the draws of a finished run."""
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
    run = sampler.start_chains(target, starts, cov)
    while not is_finished(run, settings):
        run = sampler.advance_chains(target, run, key, settings)
        progress(run.iteration, settings.warmup + settings.draws)
    return sampler.finish(run)
