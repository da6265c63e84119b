"""Compare posteriors of the same data by their evidences."""

from collections.abc import Mapping, Sequence
from itertools import chain

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.core.argument_checks import check_kind, check_mapping
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import Progress, check_progress, no_progress
from seatrial.estimation.posterior.mode import Mode, higher_mode
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior, as_key, check_posterior
from seatrial.estimation.posterior.replicate import motions
from seatrial.estimation.prediction.fit_verdict import LIKELY as LIKELY_CORRELATED
from seatrial.estimation.prediction.fit_verdict import UNDERSTATED
from seatrial.estimation.prediction.prediction import noise_sd, slow_noise
from seatrial.estimation.prediction.prediction_scores import integrated_correlation, new_residuals
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.selection.evidence import EvidenceSettings
from seatrial.selection.log_evidence import EvidenceSchedule, Keys, find_own_mode, keys_of, run_schedule
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection, blunt_deciders, select


def compare(
    posteriors: Mapping[str, Posterior],
    settings: EvidenceSettings = EvidenceSettings(),
    key: jax.Array | int = 0,
    progress: Progress = no_progress,
) -> Selection:
    """Compare posteriors of the same data by their evidences, equally probable before.

    Args:
        posteriors: by label. A parameter that some have and others lack is a term in question.
        settings: of each evidence.
        key: random key, or a seed.
        progress: called with the evidences that are there, and how many there will be.

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
            remedy="use `log_evidence` for one alone",
        )
    check_progress(progress)
    _check_same_data(posteriors)
    structures = [Structure(label, posterior.names) for label, posterior in posteriors.items()]
    shared = set.intersection(*(set(structure.terms) for structure in structures))
    optional = [name for name in dict.fromkeys(chain(*(one.terms for one in structures))) if name not in shared]
    evidences, keys = [], [keys_of(own) for own in jax.random.split(as_key(key), len(posteriors))]
    modes = _exchanged([*posteriors.values()], keys)
    schedules = [EvidenceSchedule(settings.repeats, mode) for mode in modes]
    for posterior, schedule, own in zip(posteriors.values(), schedules, keys, strict=True):
        run_schedule(posterior, schedule, own, settings)
        evidences.append(schedule.evidence())
        progress(len(evidences), len(posteriors))
    for index in blunt_deciders(structures, evidences, optional):
        if schedules[index].sharpen():
            run_schedule([*posteriors.values()][index], schedules[index], keys[index], settings)
            evidences[index] = schedules[index].evidence()
    best = max(range(len(evidences)), key=lambda index: evidences[index].log_value)
    residuals = _residual_doubt([*posteriors.values()][best], modes[best], as_key(key))
    return select(structures, evidences, optional, residuals=residuals)


def _residual_doubt(posterior: Posterior, mode: Mode | None, key: jax.Array) -> str:
    """Say why the residuals of a posterior of records, at its mode, are not the noise that is modelled; empty where they may be.

    Those of filter error are not looked at: process noise correlates a simulation also where it is right.
    """
    likelihood, data = posterior.likelihood, posterior.data
    if mode is None or not isinstance(likelihood, OutputError):
        return ""
    values = {name: jnp.asarray(value) for name, value in zip(mode.names, mode.values, strict=True)}
    shown = np.asarray(motions(likelihood, values, data, key))
    for column, sensor in enumerate(likelihood.simulator.sensors):
        sd, slow, runs = float(noise_sd(sensor, values)), slow_noise(sensor, values), []
        for trial in range(len(likelihood.labels)):
            time, measured = _measured(posterior, trial, sensor.channel)
            is_present = np.asarray(data.channels[column].present[trial]) > 0
            runs.append((time, new_residuals(time, (measured - shown[trial, is_present, column]) / sd, slow)))
        correlation = integrated_correlation(runs)
        if correlation.p_value < LIKELY_CORRELATED and correlation.sd_factor > UNDERSTATED:
            remedy = "look for a missing term" if sensor.noise == "drifting" else 'give the sensor noise="drifting"'
            return (
                f"residuals of {sensor.channel} are correlated, and the stated standard deviations are too small, by a factor of "
                f"about {correlation.sd_factor:.1f}; {remedy}"
            )
    return ""


def _exchanged(posteriors: Sequence[Posterior], keys: Sequence[Keys]) -> list[Mode | None]:
    """Return the mode of each posterior, or a higher one to which those of the others lead; None where none was found."""
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
    """Return in words what differs first in the measurements of two posteriors; empty where nothing does."""
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
