"""Profile likelihoods of the full structure, kept on disk one by one: the range of each parameter that the data alone allow."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Array

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.posterior import random_key
from seatrial.campaign.store.estimates import HasKey, read_profiles
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.errors import InputError, nearest
from seatrial.core.reporter import SILENT, Reporter
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.profile import Profile, profile_likelihood
from seatrial.sampling.target import VECTOR
from seatrial.selection.structures import Structure

TOGETHER = VECTOR // 2
"""Parameters followed at once, each to both sides: as many points as are computed at once."""


@dataclass(frozen=True, eq=False)
class Profiled:
    """Profiles of some parameters of a structure.

    Attributes:
        structure: which terms.
        profiles: one for each parameter.
        labels: printed labels (LaTeX).
    """

    structure: Structure
    profiles: tuple[Profile, ...]
    labels: tuple[str, ...]

    def lines(self) -> list[str]:
        """Name the structure, and say each interval in words."""
        return [
            f"structure {self.structure.label}, with every term: {' '.join(self.structure.terms)}",
            *(one.line for one in self.profiles),
        ]

    @property
    def open(self) -> list[str]:
        """Parameters that the data do not bound to both sides."""
        return [profile.name for profile in self.profiles if profile.kind != "closed"]


def stored_profiles(campaign: Campaign, trials: HasKey) -> StoredResult[dict[str, Profile]]:
    """Return where the profiles of the full structure are kept, as far as they are there, and what they depend on."""
    structure = campaign.full
    key = key_of("profiles", [field.name for field in fields(Profile)], estimate_key(campaign, structure, trials))

    def read(path: Path) -> dict[str, Profile]:
        stored = read_profiles(path, f"seatrial profile {campaign.folder}")
        return {name: Profile(**vars(one)) for name, one in stored.items()}

    return StoredResult(Store(campaign.folder).profiles(structure.label), key, read)


def profile_all(campaign: Campaign, trials: Trials, names: Sequence[str] = (), reporter: Reporter = SILENT) -> Profiled:
    """Profile parameters of the full structure; current results are read, and kept as soon as they are there.

    Args:
        campaign: configuration.
        trials: records, of which the fitted ones are used.
        names: parameters; none for all.
        reporter: receives what happens.

    Raises:
        InputError: no such parameter.
        NumericalError: a likelihood of several maxima.
    """
    structure = campaign.full
    posterior = Study(campaign, trials.fit).posterior(structure)
    known = posterior.present_names
    chosen = list(dict.fromkeys(names)) or list(known)
    for name in chosen:
        if name not in known:
            raise InputError(
                "--parameter",
                found=f'"{name}"',
                expected=f"a parameter of {structure.label}: " + ", ".join(known),
                remedy=nearest(name, known),
            )
    kept = stored_profiles(campaign, trials)
    found = kept.read(kept.path) if kept.is_current() else {}
    missing = [name for name in chosen if name not in found]
    if missing:
        progress = reporter.progress(f"profile {structure.label}: {' '.join(missing)}")
        progress(0, len(missing))
        for done, profile in enumerate(
            _each(posterior, random_key(campaign.seed, f"mode {structure.terms}"), missing), 1
        ):
            found[profile.name] = profile
            kept.write({"profiles": [_as_json(item) for item in found.values()]})
            progress(done, len(missing))
    labels = {parameter.name: parameter.label for parameter in posterior.present_parameters}
    return Profiled(structure, tuple(found[name] for name in chosen), tuple(labels[name] for name in chosen))


def _each(posterior: Posterior, key: Array, names: Sequence[str]) -> Iterator[Profile]:
    """Profiles, a few at a time; `key` is that of the mode."""
    mode = find_mode(posterior, key).only(posterior.places)
    for start in range(0, len(names), TOGETHER):
        yield from profile_likelihood(posterior, mode, names[start : start + TOGETHER])


def _as_json(profile: Profile) -> dict[str, Any]:
    """Open ends are null, and points where the model diverges are left out: JSON has no infinity."""
    there = np.isfinite(profile.drop)
    ends = {side: end if np.isfinite(end := getattr(profile, side)) else None for side in ("lower", "upper")}
    arrays = {name: getattr(profile, name)[there].tolist() for name in ("values", "drop", "others")}
    return {**vars(profile), **arrays, **ends, "bounds": list(profile.bounds)}
