"""What every Markov chain sampler shares: the size of a run, the run itself as arrays, and the draws it ends in.

A run advances in blocks of 100 iterations. Iteration t uses the key folded with t, so that a run cut after any block, stored
and resumed, gives the same bits.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from seatrial.core.argument_checks import check_choice, check_count, check_names, check_sequence, shown
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.findings import Finding
from seatrial.core.result_table import table_html, table_text
from seatrial.sampling.diagnostics import chain_findings, diagnose, mixing

if TYPE_CHECKING:
    from pandas import DataFrame

BLOCK = 100


@dataclass(frozen=True)
class ChainSettings:
    """Size of a run.

    Attributes:
        chains: chains in step.
        warmup: iterations that adapt and are dropped, a multiple of 100.
        draws: iterations after them, a multiple of 100.
        thin: every how many-th of these is kept, a divisor of 100.

    Raises:
        InputError: a size that is none of these.
    """

    chains: int = 32
    warmup: int = 500
    draws: int = 1500
    thin: int = 1

    def __post_init__(self) -> None:
        """Refuse sizes of which no whole number of blocks is made."""
        check_count(self.chains, "ChainSettings, chains", remedy="take 4 chains or more, so that they can be compared")
        for name, least in (("warmup", 0), ("draws", BLOCK)):
            value = getattr(self, name)
            check_count(value, f"ChainSettings, {name}", least=least, multiple_of=BLOCK, remedy="round it to a hundred")
        check_count(self.thin, "ChainSettings, thin", remedy="1 keeps every draw")
        if BLOCK % self.thin:
            raise InputError(
                "ChainSettings, thin",
                found=str(self.thin),
                expected=f"a divisor of {BLOCK}",
                remedy="for example 2, 5 or 10",
            )


class ChainRun(NamedTuple):
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


class Mixing(NamedTuple):
    """What a method says of its own draws, NaN if it has no such number.

    Attributes:
        r_hat: largest R-hat of all parameters.
        ess: smallest effective sample size.
        diverged: share of the transitions that diverged.
        moved: smallest share of the moves of a population that were made.
    """

    r_hat: float = np.nan
    ess: float = np.nan
    diverged: float = np.nan
    moved: float = np.nan


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of named parameters after warm-up, by chain; a population counts as one chain.

    `draws["X_u"]` are those of one parameter, in its own unit, of shape (chains, draws); `"X_u" in draws` asks for a name, and
    iterating goes through the names.

    Attributes:
        z: unconstrained positions, shape (chains, draws, d).
        log_density: unnormalised log densities of z, shape (chains, draws).
        acceptance: mean acceptance probability.
        divergences: transitions after warm-up with a trajectory that left its energy surface; 0 if there are none.
        names: of the d parameters.
        units: theirs, SI.
        values: draws in these units, shape (chains, draws, d).
        moved: of a population, the smallest share of accepted moves; NaN for chains.
    """

    z: Float[np.ndarray, "chains draws d"]
    log_density: Float[np.ndarray, "chains draws"]
    acceptance: float
    divergences: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, "chains draws d"]
    moved: float = np.nan

    @property
    def is_population(self) -> bool:
        """Whether these are equally weighted particles and not chains, so that R-hat has no meaning."""
        return not np.isnan(self.moved)

    def __getitem__(self, name: str) -> Float[np.ndarray, "chains draws"]:
        """Return the draws of one parameter, in its own unit, shape (chains, draws).

        Args:
            name: of the parameter.

        Raises:
            InputError: no parameter of that name.
        """
        return self.values[..., self._place(name)]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the parameters."""
        return iter(self.names)

    def __contains__(self, name: object) -> bool:
        """Return whether there is a parameter of that name."""
        return name in self.names

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self.names)

    def array(self, names: Sequence[str] | None = None) -> Float[np.ndarray, "n k"]:
        """Return the draws of some parameters, chain after chain, in their own units, shape (n, k).

        Args:
            names: of k parameters; all if None.

        Raises:
            InputError: no parameter of that name.
        """
        places = [self._place(name) for name in (self.names if names is None else check_names(names, "names"))]
        return self.values.reshape(-1, len(self.names))[:, places]

    def thinned(self, places: Sequence[int] | Int[np.ndarray, " k"]) -> "Draws":
        """Return some draws of every chain.

        Args:
            places: of the draws in their chain, from 0, shape (k,).

        Raises:
            InputError: no whole numbers, or a place that the chains do not have.
        """
        kept = self.log_density.shape[1]
        for i, place in enumerate(check_sequence(places, "places", "write for example range(0, 1000, 10)")):
            if not isinstance(place, Integral) or isinstance(place, bool) or not 0 <= int(place) < kept:
                raise InputError(
                    f"places[{i}]",
                    found=shown(place),
                    expected=f"a whole number from 0 to {kept - 1}: each chain has {kept} draws",
                    remedy="write for example range(0, 1000, 10)",
                )
        places = np.asarray(places, int)
        return replace(
            self, z=self.z[:, places], log_density=self.log_density[:, places], values=self.values[:, places]
        )

    def mixing(self) -> Mixing:
        """Return the method's own diagnostics of all parameters together."""
        if self.is_population:
            return Mixing(moved=self.moved)
        chains, kept, _ = self.z.shape
        return Mixing(*mixing(self.z), diverged=self.divergences / (chains * kept))

    def findings(self) -> list[Finding]:
        """Return findings against the use of the draws; empty for a population and for sound chains."""
        if self.is_population:
            return []
        return chain_findings(self.names, diagnose(self.values)) + self.faults()

    def faults(self) -> list[Finding]:
        """Return faults of single chains; empty if all moved and none diverged."""
        chains, kept, _ = self.z.shape
        findings = []
        still = np.flatnonzero((self.z == self.z[:, :1]).all((1, 2)))
        if kept > 1 and still.size:
            values = {"stuck": tuple(int(i) + 1 for i in still), "chains": chains, "kept": kept}
            findings.append(Finding("chains-stuck", "alarm", (), values, ("warm-up-longer",)))
        if self.divergences:
            values = {"diverged": self.divergences, "transitions": chains * kept}
            findings.append(Finding("transitions-diverged", "alarm", (), values, ("another-sampler",)))
        return findings

    def summary(self) -> "DataFrame":
        """Return a table with a row for each parameter: unit, mean, sd, the 5 % and 95 % quantiles, and how well they are known.

        `mcse` is the Monte Carlo error of the mean; it, `r_hat`, `ess_bulk` and `ess_tail` are NaN for a population.
        """
        from pandas import DataFrame

        flat, nan = self.array(), np.full(len(self.names), np.nan)
        low, high = np.quantile(flat, (0.05, 0.95), axis=0)
        health = None if self.is_population else diagnose(self.values)
        named = {
            key: nan if health is None else getattr(health, key) for key in ("mcse", "r_hat", "ess_bulk", "ess_tail")
        }
        columns = {"unit": self.units, "mean": flat.mean(0), "sd": flat.std(0), "5%": low, "95%": high}
        return DataFrame(columns | named, index=list(self.names))

    @property
    def _heading(self) -> str:
        chains, kept, _ = self.z.shape
        size = f"{kept} particles" if self.is_population else f"{chains} chains of {kept}"
        return f"Draws of {len(self)} parameters, {size}"

    @property
    def _remarks(self) -> list[str]:
        return [f"{one.code}: {', '.join(one.subject)}".removesuffix(": ") for one in self.findings()]

    __repr__ = table_text
    _repr_html_ = table_html

    def _place(self, name: str) -> int:
        return self.names.index(check_choice(name, self.names, "draws"))


def unnamed_draws(
    z: Float[np.ndarray, "chains draws d"],
    log_density: Float[np.ndarray, "chains draws"],
    acceptance: float,
    divergences: int = 0,
) -> Draws:
    """Return draws of a density whose components have no names: z[0], z[1] and so on, which are their own values."""
    d = z.shape[-1]
    return Draws(z, log_density, acceptance, divergences, tuple(f"z[{i}]" for i in range(d)), ("1",) * d, z)


def begin(state: Any) -> ChainRun:
    """Begin a run at a state; its arrays get types that no block changes, so that one program serves all blocks.

    Raises:
        NumericalError: a start of zero density.
    """
    bad = int(np.sum(~np.isfinite(state.log_density)))
    if bad:
        raise NumericalError(
            f"{bad} of {len(state.log_density)} chains start outside the support, at zero density: start them inside"
        )
    state = jax.device_put(jax.tree.map(np.asarray, state))
    chains, d = state.z.shape
    return ChainRun(state, 0, np.empty((0, chains, d)), np.empty((0, chains)), np.empty(0))


def is_finished(run: ChainRun, settings: ChainSettings) -> bool:
    """Return whether the run has all its draws."""
    return run.iteration >= settings.warmup + settings.draws


def finish(run: ChainRun) -> Draws:
    """Return the draws of a finished run; a sampler whose state counts no divergences has none."""
    divergences = int(getattr(run.state, "divergences", 0))
    return unnamed_draws(np.swapaxes(run.z, 0, 1), run.log_density.T, float(run.acceptance.mean()), divergences)


def arrays_of_run(run: ChainRun) -> dict[str, np.ndarray]:
    """Return the arrays of a run by name, for a checkpoint."""
    state = {f"state {name}": value for name, value in run.state._asdict().items()}
    return {
        name: np.asarray(value) for name, value in (state | dict(zip(run._fields[1:], run[1:], strict=True))).items()
    }


def run_from_arrays(state: type, arrays: Mapping[str, np.ndarray]) -> ChainRun:
    """Restore a run of a sampler whose state has this type; every bit is as it was.

    Raises:
        KeyError: arrays of another sampler.
    """
    restored = jax.device_put(state(*(arrays[f"state {name}"] for name in state._fields)))
    return ChainRun(restored, int(arrays["iteration"]), *(arrays[name] for name in ChainRun._fields[2:]))
