"""Compare posteriors of the same data by their evidences."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import get_args

import jax
import numpy as np

from seatrial.core.argument_checks import check_choice, check_kind, check_mapping
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import Progress, check_progress, no_progress
from seatrial.estimation.diagnostics.error_evidence import log_evidence_gains
from seatrial.estimation.diagnostics.error_sources import StatedErrors
from seatrial.estimation.posterior.mode import Mode, higher_mode
from seatrial.estimation.posterior.posterior import Posterior, as_key, check_posterior
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.selection.evidence import EvidenceSettings
from seatrial.selection.further_modes import search_modes
from seatrial.selection.log_evidence import EvidenceSchedule, Keys, find_own_mode, keys_of, run_schedule
from seatrial.selection.structure_prior import StructurePrior
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Evidence, Selection, blunt_deciders, select, unchecked_deciders


def compare(
    posteriors: Mapping[str, Posterior],
    *,
    settings: EvidenceSettings = EvidenceSettings(),
    key: jax.Array | int = 0,
    progress: Progress = no_progress,
    stated: StatedErrors = StatedErrors(),
    structure_prior: StructurePrior = "equal",
) -> Selection:
    """Compare posteriors of the same data by their evidences with every error.

    Args:
        posteriors: by label. A parameter that some have and others lack is a term in question.
        settings: of each evidence.
        key: random key, or a seed.
        progress: called with the evidences that are there, and how many there will be.
        stated: standard deviations of the inertia, of the scales of sensors and of the clock, which no residual shows.
        structure_prior: how probable each is before the data: `equal`, or by `multiplicity` every number of terms in question alike, and
            every set of so many. It is normalised over the posteriors that are given.

    Returns:
        the probability of each, that of each term in question, and both in words.

    Raises:
        InputError: fewer than two, something that is no posterior, posteriors of different measurements, or settings of something else.
        NumericalError: an evidence that cannot be computed.
    """
    for label, posterior in check_mapping(posteriors, "posteriors", "write {label: posterior}").items():
        check_posterior(posterior, f'posteriors["{label}"]')
    check_kind(settings, EvidenceSettings, "settings", "leave them out, or write EvidenceSettings(repeats=4)")
    if len(posteriors) < 2:
        raise InputError(
            "posteriors",
            found=f"{len(posteriors)} posteriors",
            expected="two at least",
            remedy="use `log_evidence` for only one",
        )
    check_choice(structure_prior, get_args(StructurePrior), "structure_prior")
    check_progress(progress)
    _check_same_data(posteriors)
    structures = [Structure(label, posterior.present_names) for label, posterior in posteriors.items()]
    shared = set.intersection(*(set(structure.terms) for structure in structures))
    optional = [name for name in dict.fromkeys(chain(*(one.terms for one in structures))) if name not in shared]
    keys = [keys_of(own) for own in jax.random.split(as_key(key), len(posteriors))]
    own_posteriors = [*posteriors.values()]
    modes = _searched(own_posteriors, _exchanged(own_posteriors, keys), keys)
    schedules = [EvidenceSchedule(0, one) for one in modes]
    gains = log_evidence_gains(own_posteriors, [one[0] if one else None for one in modes], stated)

    def run(places: Sequence[int]) -> None:
        for place in places:
            run_schedule(own_posteriors[place], schedules[place], keys[place], settings)
            progress(place + 1, len(posteriors))

    evidences = decide(structures, schedules, optional, structure_prior, gains, settings.repeats, run)
    return select(structures, evidences, optional, structure_prior=structure_prior)


def decide(
    structures: Sequence[Structure],
    schedules: Sequence[EvidenceSchedule],
    optional: Sequence[str],
    structure_prior: StructurePrior,
    gains: Sequence[float] | None,
    repeats: int,
    run: Callable[[Sequence[int]], None],
) -> list[Evidence]:
    """Return evidences as sharp as the decisions on terms need them.

    All come from importance sampling about the modes. Tempered SMC checks one that is in doubt, and one on which a decision depends; it is
    repeated where the decision changes within what the check resolves.

    Args:
        structures: candidates.
        schedules: of their evidences, none begun, with the modes that are known.
        optional: terms that are in question.
        structure_prior: how probable structures are before the data.
        gains: of each evidence with every error, nats; None where they are not known.
        repeats: of a check.
        run: does all tasks that the schedules of some candidates, by place, ask for.
    """

    def evidences() -> list[Evidence]:
        return with_gains([one.evidence() for one in schedules], gains)

    def check(places: Sequence[int]) -> None:
        for place in places:
            schedules[place].check(repeats)
        run(places)

    run(range(len(schedules)))
    if len(structures) > 1:
        check([place for place, one in enumerate(schedules) if one.is_doubtful])
        check(unchecked_deciders(structures, evidences(), optional, structure_prior))
        blunt = blunt_deciders(structures, evidences(), optional, structure_prior)
        run([place for place in blunt if schedules[place].sharpen()])
    return evidences()


def with_gains(evidences: Sequence[Evidence], gains: Sequence[float] | None) -> list[Evidence]:
    """Return evidences with what they are with every error; they say so where that is not known."""
    if gains is None:
        return [replace(one, diagnostics=one.diagnostics | {"within_model": True}) for one in evidences]
    return [replace(one, with_errors=one.log_value + gain) for one, gain in zip(evidences, gains, strict=True)]


def _searched(
    posteriors: Sequence[Posterior], modes: Sequence[Mode | None], keys: Sequence[Keys]
) -> list[tuple[Mode, ...]]:
    """Return all modes of each posterior, the highest first: of those that no other contains by a search, of others by what that shows."""
    names = [set(one.present_names) for one in posteriors]
    known: list[tuple[Mode, ...]] = [() if mode is None else (mode,) for mode in modes]
    whole = [place for place, own in enumerate(names) if not any(own < other for other in names)]
    for place in whole:
        if known[place]:
            known[place] = search_modes(posteriors[place], known[place], keys[place].smc)
    for place in set(range(len(names))).difference(whole):
        around = [mode for one in whole if names[place] < names[one] for mode in known[one]]
        if known[place]:
            known[place] = search_modes(posteriors[place], known[place], keys[place].smc, around)
    return known


def _exchanged(posteriors: Sequence[Posterior], keys: Sequence[Keys]) -> list[Mode | None]:
    """Return the mode of each posterior, or a higher one to which those of the others lead; None if none was found."""
    modes: list[Mode | None] = []
    for posterior, own in zip(posteriors, keys, strict=True):
        try:
            modes.append(find_own_mode(posterior, own.importance))
        except NumericalError:
            modes.append(None)
    for index, posterior in enumerate(posteriors):
        others = [mode for place, mode in enumerate(modes) if place != index and mode is not None]
        modes[index] = higher_mode(posterior, modes[index], others) or modes[index]
    return modes


def _check_same_data(posteriors: Mapping[str, Posterior]) -> None:
    """Refuse posteriors of other measurements than those of the first: evidences of different data say nothing of the models."""
    of_records = [pair for pair in posteriors.items() if isinstance(pair[1].data, TrialData)]
    for label, other in of_records[1:]:
        first, one = of_records[0]
        if differs := _difference(one, other):
            raise InputError(
                f'posteriors["{label}"]',
                found=f'other data than in posteriors["{first}"]: {differs}',
                expected="the same measurements at the same times, so that the evidences can be compared",
                remedy="give `make_posterior` the same records, in the same order, and the same sensors for each model",
            )


def _difference(one: Posterior, other: Posterior) -> str:
    """Return in words what differs first in the measurements of two posteriors; empty if nothing does."""
    channels = one.likelihood.channels
    if set(channels) != set(other.likelihood.channels):
        return f"measured {', '.join(other.likelihood.channels)} against {', '.join(channels)}"
    count, counted = len(one.likelihood.labels), len(other.likelihood.labels)
    if count != counted:
        return f"{counted} records against {count}"
    for trial, label in enumerate(one.likelihood.labels):
        for channel in channels:
            (t, x), (s, y) = _measured(one, trial, channel), _measured(other, trial, channel)
            of = f'{channel} of record "{label}"'
            if t.size != s.size:
                return f"{s.size} measurements of {of} against {t.size}"
            if not np.allclose(t, s, rtol=0.0, atol=1e-6):
                return f"other times of {of}"
            if not np.array_equal(x, y):
                return f"{np.count_nonzero(x != y)} of {x.size} measurements of {of}"
    return ""


def _measured(posterior: Posterior, trial: int, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """Return when a channel was measured in a trial, s from its first sample, and what."""
    shown = posterior.data.channels[posterior.likelihood.channels.index(channel)]
    is_present = np.asarray(shown.present[trial]) > 0
    return posterior.data.time[trial][is_present], np.asarray(shown.measured[trial])[is_present]
