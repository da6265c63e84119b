"""A study of the paper: its items, and its parts, computed when first asked for and kept on disk, stamped with all they depend on."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, Literal, TypeAlias

import jax
import xarray as xr

from seatrial.campaign.store.stored_result import is_current, key_of, write_dataset
from seatrial.core.dataset_file import open_dataset
from seatrial.core.files import sha256_of_json
from seatrial.core.reporter import SILENT, Progress, Reporter
from studies.remus100.reading import Reading

Verdict = Literal["reproduced", "not comparable", "contradicted"]


@dataclass(frozen=True)
class Sizes:
    """Sample sizes; the defaults are the paper's, or what makes Monte Carlo errors small beside what is shown.

    Attributes:
        filter_seeds: trials of Tables I and II.
        tuning_seeds: trials behind the remarks on P, Q and R.
        chains: chains in step of each Markov chain run.
        burn_in: iterations dropped.
        draws: iterations kept.
        listing_repeats: seeds of Listing 1.
        listing_shared: seeds of Listing 1 with draws shared between the models.
        listing_draws: prior draws of each model for each seed.
        data_seeds: trials behind the probability of M-0 over its true coefficient.
        importance_draws: draws of importance sampling for Tables IV and V.
        smc_particles: particles of each of four repeats of tempered SMC; 0 leaves it out.
        bridge_draws: draws of each of 32 chains for bridge sampling.
        nested_live: live points of nested sampling; 0 leaves it out.
        criteria_draws: draws behind WAIC and PSIS-LOO.
    """

    filter_seeds: int = 100
    tuning_seeds: int = 20
    chains: int = 4
    burn_in: int = 50_000
    draws: int = 50_000
    listing_repeats: int = 200
    listing_shared: int = 20
    listing_draws: int = 100_000
    data_seeds: int = 10
    importance_draws: int = 65_536
    smc_particles: int = 128
    bridge_draws: int = 2000
    nested_live: int = 100
    criteria_draws: int = 500


FULL = Sizes()


QUICK = Sizes(
    filter_seeds=8,
    tuning_seeds=8,
    chains=8,
    burn_in=1_000,
    draws=2_000,
    listing_repeats=12,
    listing_shared=6,
    listing_draws=20_000,
    data_seeds=2,
    importance_draws=10_000,
    smc_particles=0,
    bridge_draws=500,
    nested_live=0,
    criteria_draws=200,
)


@dataclass(frozen=True, eq=False)
class Study:
    """A vehicle, sample sizes, and a folder of results.

    Attributes:
        folder: where results are kept.
        reading: vehicle.
        sizes: sample sizes.
        parts: how each part is computed, by name.
        reporter: receives what happens.
        seed: of everything random but the data, which have seeds of their own.
    """

    folder: Path
    reading: Reading
    sizes: Sizes
    parts: "Mapping[str, Part]"
    reporter: Reporter = SILENT
    seed: int = 0
    _held: dict[str, xr.Dataset] = field(default_factory=dict)
    _locks: dict[str, Lock] = field(default_factory=dict)

    def part(self, name: str) -> xr.Dataset:
        """Return the results of one part: from memory, from disk if they are current, or computed now."""
        with self._locks.setdefault(name, Lock()):
            if name not in self._held:
                path, key = self.folder / "results" / f"{name}.nc", self.key(name)
                if not is_current(path, key):
                    write_dataset(path, self.parts[name](self), key)
                self._held[name] = open_dataset(path).to_xarray()
            return self._held[name]

    def key(self, name: str) -> str:
        """Stamp of a part's results."""
        return key_of("paper", name, asdict(self.reading), asdict(self.sizes), self.seed)

    def random_key(self, name: str) -> jax.Array:
        """Random key of a part, its own."""
        return jax.random.fold_in(jax.random.key(self.seed), int(sha256_of_json(name)[:7], 16))

    def progress(self, title: str) -> Progress:
        """Begin a long piece of work; see `Reporter.progress`."""
        return self.reporter.progress(title)


Part: TypeAlias = Callable[[Study], xr.Dataset]


@dataclass(frozen=True)
class Number:
    """One number of an item beside the printed one.

    Attributes:
        name: what it is, unit included.
        printed: as the paper prints it; None where it prints none.
        found: here.
        error: its Monte Carlo standard error; 0 where there is none.
    """

    name: str
    printed: float | None
    found: float
    error: float = 0.0


@dataclass(frozen=True)
class Item:
    """One item with its verdict.

    Attributes:
        key: name for `--only`, such as `table-1`.
        title: what it is.
        verdict: judgement.
        because: reason, one sentence; may be empty if the item is reproduced.
        numbers: what was compared.
        settings: how it was computed, seeds included.
    """

    key: str
    title: str
    verdict: Verdict
    because: str = ""
    numbers: tuple[Number, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """The verdict in one line."""
        return f"{self.verdict}: {self.because}" if self.because else self.verdict

    def as_json(self) -> dict[str, Any]:
        """Everything, JSON-able."""
        return {**asdict(self), "words": self.words}


def trial_settings(study: Study) -> dict[str, Any]:
    """Return the vehicle, the trial, and the seeds of both trial and computation."""
    return {"reading": study.reading.name, "data_seed": 1, "sigma": study.reading.sigma, "seed": study.seed}


def chain_settings(study: Study) -> dict[str, Any]:
    """These and the size of a Markov chain run."""
    sizes = study.sizes
    return trial_settings(study) | {"chains": sizes.chains, "burn_in": sizes.burn_in, "draws": sizes.draws}
