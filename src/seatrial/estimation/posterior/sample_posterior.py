"""Draws of a posterior by any method, from nothing but the posterior."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.core.argument_checks import check_choice, check_count
from seatrial.core.errors import InputError
from seatrial.core.reporter import Progress, check_progress, no_progress
from seatrial.estimation.posterior.mode import Mode, find_mode
from seatrial.estimation.posterior.noncentred import in_posterior, uncouple
from seatrial.estimation.posterior.posterior import Posterior, as_key, check_posterior, named_draws
from seatrial.sampling import sampler
from seatrial.sampling.names import DEFAULT, METHODS
from seatrial.sampling.nested import sample_nested
from seatrial.sampling.run import ChainSettings, Draws, unnamed_draws
from seatrial.sampling.sampler import SAMPLERS
from seatrial.sampling.target import Target, evaluate
from seatrial.sampling.tempered_smc import SMCSettings, sample_tempered_smc


@dataclass(frozen=True)
class NestedSettings:
    """Size of a run of nested sampling.

    Attributes:
        live: live points.
        draws: equally weighted draws that are taken of the points.

    Raises:
        InputError: a size that is none.
    """

    live: int = 500
    draws: int = 2000

    def __post_init__(self) -> None:
        """Refuse sizes of no run."""
        check_count(self.live, "NestedSettings, live", least=2, remedy="take a hundred or more")
        check_count(self.draws, "NestedSettings, draws", remedy="take a few hundred or more")


Settings = ChainSettings | SMCSettings | NestedSettings
Draw = Callable[[Posterior, jax.Array], Draws]
# Size of each method's run where many are made; enough for a hundred independent draws of a posterior not too far from
# normal.
SIZES: dict[str, Settings] = {
    "independence-metropolis": ChainSettings(32, 300, 200),
    "adaptive-metropolis": ChainSettings(32, 500, 500),
    "metropolis": ChainSettings(32, 500, 1000),
    "de-metropolis": ChainSettings(32, 500, 1000),
    "nuts": ChainSettings(8, 300, 200),
    "tempered-smc": SMCSettings(512),
    "nested": NestedSettings(200, 512),
}
SPREAD = 1.5  # Standard deviations of the normal approximation from which chains start
MAX_BEHIND = 7.0  # Nats by which the evidence about a further mode, by Laplace, may be less than that of the best for chains to start there


def sample(
    posterior: Posterior,
    method: str = DEFAULT,
    *,
    settings: Settings | None = None,
    key: jax.Array | int = 0,
    progress: Progress = no_progress,
) -> Draws:
    """Draw from a posterior.

    Chains start about the mode, spread wider than the normal approximation there, so that chains which do not meet are seen; ask the
    draws for their `complaints`.

    Args:
        posterior: density to draw from.
        method: `independence-metropolis`, `adaptive-metropolis`, `metropolis`, `de-metropolis`, `nuts`, `tempered-smc` or `nested`.
        settings: size of the run: `ChainSettings`, of `tempered-smc` `SMCSettings`, of `nested` `NestedSettings`.
        key: random key, or a seed; the same key gives the same bits.
        progress: of chains, called with the iterations done and in all.

    Returns:
        draws of every parameter by its name, in its SI unit, shape (chains, draws) each; a population counts as one chain.

    Raises:
        InputError: no such method, settings of another, or a progress that cannot be called.
        NumericalError: nothing of the prior can be simulated, or the mode is not found.
    """
    check_posterior(posterior)
    if isinstance(method, Settings):
        raise InputError(
            "method",
            found=f"a {type(method).__name__}",
            expected="the name of a method",
            remedy="write settings=… for it",
        )
    check_choice(method, METHODS, "method")
    kind = type(SIZES[method])
    settings = kind() if settings is None else settings
    if not isinstance(settings, kind):
        raise InputError(
            f"settings of {method}",
            found=type(settings).__name__,
            expected=kind.__name__,
            remedy="leave them out, or choose a method that has them",
        )
    check_progress(progress)
    return _BY_KIND[kind](posterior, method, settings, as_key(key), progress)


def find_method(name: str) -> Draw:
    """Return a method by name, of the size for many runs.

    Raises:
        InputError: no such method.
    """
    check_choice(name, METHODS, "method")
    return partial(_sample_small, name)


def _sample_small(name: str, posterior: Posterior, key: jax.Array) -> Draws:
    return sample(posterior, name, settings=SIZES[name], key=key)


def spread_starts(target: Target, mode: Mode, chains: int, key: jax.Array, further: Sequence[Mode] = ()) -> np.ndarray:
    """Positions spread wider than the normal approximation, so that R-hat can see chains that do not meet, shape (chains, d).

    Chains are dealt to the modes that may hold a thousandth of the evidence, the mode and further ones.
    """
    noise = np.random.default_rng(np.asarray(jax.random.key_data(key))).standard_normal((chains, target.dim))
    best = max(one.log_evidence for one in (mode, *further))
    modes = [one for one in (mode, *further) if one is mode or one.log_evidence > best - MAX_BEHIND]
    dealt = [modes[chain % len(modes)] for chain in range(chains)]
    starts = np.array([one.z + SPREAD * one.scale @ step for one, step in zip(dealt, noise, strict=True)])
    finite = np.isfinite(evaluate(target, starts))
    return np.where(finite[:, None], starts, [one.z for one in dealt])


def _by_chains(posterior: Posterior, method: str, settings: ChainSettings, key: jax.Array, progress: Progress) -> Draws:
    mode_key, start_key, key = jax.random.split(key, 3)
    target, mode = uncouple(posterior, find_mode(posterior, key=mode_key))
    starts = spread_starts(target, mode, settings.chains, start_key)
    draws = sampler.sample(SAMPLERS[method], target, starts, jnp.asarray(mode.cov), key, settings, progress)
    return in_posterior(target, draws)


def _by_smc(posterior: Posterior, method: str, settings: SMCSettings, key: jax.Array, progress: Progress) -> Draws:
    run = sample_tempered_smc(posterior, key, settings, progress)
    return _population(posterior, run.particles, float(run.acceptance.min()))


def _by_nested(
    posterior: Posterior, method: str, settings: NestedSettings, key: jax.Array, progress: Progress
) -> Draws:
    run_key, draw_key = jax.random.split(key)
    run = sample_nested(posterior, run_key, live=settings.live, progress=progress)
    return _population(posterior, run.draws(settings.draws, draw_key), 1.0 - run.stuck)


def _population(posterior: Posterior, z: np.ndarray, moved: float) -> Draws:
    """Return equally weighted particles as one chain."""
    result = unnamed_draws(np.asarray(z)[None], evaluate(posterior, z)[None], moved)
    return replace(named_draws(posterior, result), moved=moved)


_BY_KIND = {ChainSettings: _by_chains, SMCSettings: _by_smc, NestedSettings: _by_nested}
