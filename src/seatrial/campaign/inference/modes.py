"""Posterior modes of all structures of a campaign, kept for every command that begins from them, and checks of a mode.

A search that begins from the prior may end on a lower peak. A structure that contains another cannot have a lower maximum than the other's
with its further terms at zero, so the modes of all structures check each other, and are starts that cost nothing.

Further modes are looked for by particles, in the structures that no other contains: by the ratio of Savage and Dickey a structure that is
probable is a slice through the bulk of one that contains it, so that a mode of weight there shows itself.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.compute.workers import Workers
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.check import likely_causes
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import is_whole
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError, NumericalError, SeatrialError
from seatrial.core.findings import Finding
from seatrial.core.record import SIMULATED, Record
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.estimation.diagnostics.prior_checks import NOT_NEEDED, prior_excluding_data
from seatrial.estimation.posterior.mode import Mode, find_mode, higher_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.step_shift import check_step, shorter_step, step_shift
from seatrial.messages.render import remedy, sentences, statement
from seatrial.selection.further_modes import search_modes
from seatrial.selection.structures import Structure

EXCHANGES = 3  # Times at most that modes are exchanged, until none is higher than before
# Keys of [estimation] that change no density
NOT_OF_DENSITY = {
    "inertia_error",
    "scale_error",
    "clock_error",
    "force_error",
    "sampler",
    "chains",
    "warmup",
    "draws",
    "thin",
}
Modes = Mapping[Structure, Mode | NumericalError]  # Mode of each structure, or why there is none


@dataclass(frozen=True)
class KnownModes:
    """The modes that are known of each structure, as they are kept.

    Attributes:
        modes: by label, the highest first; none of a structure without one.
        failures: why there is none, by label.
    """

    modes: Mapping[str, tuple[Mode, ...]]
    failures: Mapping[str, str]

    def of(self, structure: Structure) -> tuple[Mode, ...]:
        """Return the modes of a structure, the highest first."""
        return self.modes.get(structure.label, ())

    def highest(self, structure: Structure) -> Mode | NumericalError:
        """Return the highest mode of a structure, or why there is none."""
        return next(iter(self.of(structure)), None) or NumericalError(self.failures[structure.label])


class _Known(NamedTuple):
    """A structure with its modes, the highest first, none if none is known, and those of the others."""

    structure: Structure
    modes: tuple[Mode, ...]
    others: tuple[Mode, ...]


def structure_modes(study: Study, trials: Trials, reporter: Reporter = SILENT) -> KnownModes:
    """Find the highest mode of every structure; a current result is read.

    The structure with most terms comes first: the others are looked for where its normal approximation expects them.
    """

    def find() -> KnownModes:
        structures, workers = study.campaign.structures, workers_of(study.campaign, reporter)
        shown = {one: reporter.progress(f"mode {one.label}") for one in structures}
        modes = dict[Structure, Mode | NumericalError]()
        largest = max(structures, key=lambda structure: len(structure.terms))
        for items in ([largest], [one for one in structures if one is not largest]):
            near = tuple(mode for mode in modes.values() if isinstance(mode, Mode))
            for one in items:
                shown[one](0, 1)

            def done(index: int, mode: Mode | NumericalError, items: Sequence[Structure] = items) -> None:
                modes[items[index]] = mode
                shown[items[index]](1, 1)

            workers.run(_find, study, [_Known(one, (), near) for one in items], done)
        progress = reporter.progress("compare the modes")
        progress(0, 1)
        known = exchange_modes(study, {one: modes[one] for one in structures}, workers)
        progress(1, 1)
        there = {one.label: (mode,) for one, mode in known.items() if isinstance(mode, Mode)}
        return KnownModes(there, {one.label: str(why) for one, why in known.items() if isinstance(why, NumericalError)})

    return _stored(study.campaign, trials, "highest", Store(study.campaign.folder).modes).read_or_make(find)


def all_modes(study: Study, trials: Trials, reporter: Reporter = SILENT) -> KnownModes:
    """Find the modes of every structure, also those beside the highest; a current result is read."""

    def find() -> KnownModes:
        known, workers = structure_modes(study, trials, reporter), workers_of(study.campaign, reporter)
        structures = [one for one in study.campaign.structures if known.of(one)]
        whole = [one for one in structures if is_whole(one, structures)]
        progress = reporter.progress("search for further modes")
        modes, ended = dict(known.modes), 0
        progress(0, len(structures))
        for items in (whole, [one for one in structures if one not in whole]):

            def done(index: int, own: tuple[Mode, ...], items: Sequence[Structure] = items) -> None:
                nonlocal ended
                modes[items[index].label] = own
                ended += 1
                progress(ended, len(structures))

            around = {one: tuple(modes[two.label] for two in whole if set(one.terms) < set(two.terms)) for one in items}
            workers.run(_search, study, [_Known(one, known.of(one), sum(around[one], ())) for one in items], done)
        return KnownModes(modes, known.failures)

    return _stored(study.campaign, trials, "all", Store(study.campaign.folder).all_modes).read_or_make(find)


def kept_modes(campaign: Campaign, trials: HasKey) -> KnownModes | None:
    """Return the modes of all structures if they were found already, those of the wider search if there are any; nothing is computed."""
    store = Store(campaign.folder)
    for which, path in (("all", store.all_modes), ("highest", store.modes)):
        stored = _stored(campaign, trials, which, path)
        if stored.state() == "current":
            return stored.read()
    return None


def _stored(campaign: Campaign, trials: HasKey, which: str, path: Path) -> StoredResult[KnownModes]:
    """Return where modes are kept, and what they depend on."""
    density = {name: value for name, value in campaign.estimation if name not in NOT_OF_DENSITY}
    believed = campaign.vehicle, campaign.priors, campaign.sensors, campaign.mounts, density, campaign.seed
    key = key_of("modes", which, trials.key, campaign.structures, *believed)
    return StoredResult(path, key, KnownModes)


def exchange_modes(study: Study, modes: Modes, workers: Workers) -> Modes:
    """Return the modes, those replaced to which a mode of another structure shows a higher one; the others are the same objects."""
    known = dict(modes)
    for _ in range(EXCHANGES):
        there = {one: mode for one, mode in known.items() if isinstance(mode, Mode)}
        others = {one: tuple(mode for other, mode in there.items() if other != one) for one in known}
        items = [_Known(one, (there[one],) if one in there else (), modes) for one, modes in others.items() if modes]
        if not items:
            break
        higher = dict[Structure, Mode]()

        def done(index: int, mode: Mode | None, items: list[_Known] = items, higher: dict = higher) -> None:
            if mode is not None:
                higher[items[index].structure] = mode

        workers.run(_exchange, study, items, done)
        if not higher:
            break
        known |= higher
    return known


def long_steps(posterior: Posterior, mode: Mode, records: Sequence[Record]) -> list[Finding]:
    """Return which parameters the steps of the records move by more than a standard deviation, and which step helps.

    Args:
        posterior: of the records.
        mode: its mode, with the parameters that are absent.
        records: fitted; of simulated ones, which the same steps have made, nothing is said.
    """
    if any(record.provenance.source == SIMULATED for record in records):
        return []
    counts = [record.provenance.options.get("averaged", {}) for record in records]
    averaged = np.array([[of_one.get(name, 1.0) for name in posterior.likelihood.channels] for of_one in counts])
    shift = step_shift(posterior, mode, averaged)
    if shift is None:
        return []
    step = max(float(np.median(np.diff(record.time))) for record in records)
    return check_step(posterior, shift, step, shorter_step(step, averaged))


def check_prior_of(study: Study, posterior: Posterior, mode: Mode) -> None:
    """Check that the priors of a campaign contain what its records say; arguments as `prior_excluding_data`.

    Raises:
        InputError: naming the parameter, and first of its remedies what `seatrial check` finds, where a fault of a record may be the cause.
    """
    finding = prior_excluding_data(posterior, mode)
    if finding is None:
        return
    causes, advice = [], remedy(finding)
    if finding.remedies[0] not in NOT_NEEDED.values():  # no fault of a record makes a noise small, or a lag none
        with suppress(SeatrialError):  # of a record that cannot be judged nothing is added
            causes = sentences(likely_causes(study.campaign, study.records))
    if causes:
        advice = f"`seatrial check` finds a likely cause: {'. '.join(causes)}. If that is not the cause: {advice}"
    where = study.campaign.where_of_prior(f"prior.{finding.subject[0]}")
    raise InputError(
        where, found=statement(finding), expected="a prior that contains the value by the data", remedy=advice
    )


def _find(study: Study, item: _Known, report: Progress) -> Mode | NumericalError:
    """Find the mode of a structure, near those of others if there are any, and from the stated start; or why there is none."""
    posterior, near = study.posterior(item.structure), dict[str, float]()
    for mode in item.others:
        near |= mode.expected({name: 0.0 for name in mode.names if name not in posterior.present_names})
    key = random_key(study.campaign.seed, f"mode {item.structure.terms}")
    start_values = study.campaign.estimation.start_values
    stated = {name: value for name, value in start_values.items() if name in posterior.present_names}
    searches = [{"near": near or None}, *([{"near": stated, "starts": 1}] if stated else [])]
    results = list[Mode | NumericalError]()
    for search in searches:
        try:
            results.append(find_mode(posterior, key=key, **search))
        except NumericalError as error:
            results.append(error)
    return max((one for one in results if isinstance(one, Mode)), key=lambda one: one.log_density, default=results[0])


def _exchange(study: Study, item: _Known, report: Progress) -> Mode | None:
    return higher_mode(study.posterior(item.structure), next(iter(item.modes), None), item.others)


def _search(study: Study, item: _Known, report: Progress) -> tuple[Mode, ...]:
    """Return all modes of a structure, the highest first."""
    key = random_key(study.campaign.seed, f"search {item.structure.terms}")
    return search_modes(study.posterior(item.structure), item.modes, key, item.others)
