"""Trials run on a simulated vehicle: the first by design, later ones as they were decided, and any schedule that is given."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import OwnSchedule, read_own
from seatrial.campaign.data.no_record import no_record
from seatrial.campaign.data.true_vehicle import FIRST, true_vehicle
from seatrial.campaign.design.schedule import damaged_about, find_schedules, read_about
from seatrial.campaign.design.sweep import design_first, design_key
from seatrial.campaign.store.stored_result import (
    Store,
    is_current,
    key_of,
    read_json,
    write_dataset,
    write_stamped_json,
)
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.files import depend_on
from seatrial.core.record import SIMULATED, Channel, Provenance, Record, make_record
from seatrial.core.record_file import read_record, record_dataset
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.signals import signal_unit
from seatrial.design.sweep import Sweep
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.relay import read_relay_family
from seatrial.manoeuvres.schedule import Schedule, schedule_of

MAX_LABEL_LENGTH = 80  # Characters of a label


@dataclass(frozen=True)
class Chosen:
    """A trial: the family's kind, its amplitude (SI) and period (s), and when it is ended, s, if not after the family's duration."""

    kind: str
    amplitude: float
    period: float
    length: float | None = None

    def manoeuvre(self, families: Sequence[Family]) -> Manoeuvre:
        """The trial itself; its family is one of those that are swept."""
        family = next(one for one in families if one.kind == self.kind)
        made = family.manoeuvre(self.amplitude, self.period)
        return made if self.length is None else replace(made, duration=self.length)


def chosen_of(sweep: Sweep, at: tuple[int, int]) -> Chosen:
    """One design of a sweep."""
    length = None if sweep.length is None else float(sweep.length[at])
    return Chosen(sweep.family.kind, float(sweep.amplitude[at[0]]), float(sweep.period[at[1]]), length)


@dataclass(frozen=True, eq=False)
class Scheduled:
    """A trial that was asked for by its schedule.

    Attributes:
        label: of its record.
        source: name of the schedule's file.
        schedule: controls; what a closed loop is foreseen to give.
        relay: family, amplitude and threshold of a self-oscillating test, which makes its control itself; None for all others.
    """

    label: str
    source: str
    schedule: Schedule
    relay: Mapping[str, Any] | None = None

    def as_plain(self) -> dict[str, Any]:
        """Return what a file keeps of it, and its key is made of."""
        controls = {name: values.tolist() for name, values in self.schedule.controls.items()}
        return {
            "label": self.label,
            "source": self.source,
            "time": self.schedule.time.tolist(),
            "controls": controls,
            "relay": self.relay,
        }


Later = Chosen | Scheduled
"""A trial beyond the first."""


def _read_later(plain: Mapping[str, Any]) -> Later:
    if "label" not in plain:
        return Chosen(**plain)
    controls = {name: np.array(values, float) for name, values in plain["controls"].items()}
    return Scheduled(
        plain["label"], plain["source"], Schedule(np.array(plain["time"], float), controls), plain["relay"]
    )


# The trials, and their records.


def simulated_records(campaign: Campaign, reporter: Reporter = SILENT) -> tuple[tuple[Record, ...], str]:
    """Run every trial that is not current; returns the records and the key of them all.

    Raises:
        InputError: a true vehicle that runs away, or a schedule that is not of this vehicle.
    """
    current, ahead = abs(campaign.truth.get(CURRENT, 0.0)), campaign.hull.trim.get("u")
    if ahead is not None and current > abs(ahead):
        reporter.say(f"caution: the current of {current:g} m/s is faster than the vehicle at trim, {ahead:g} m/s")
    keys, records = record_keys(campaign), []
    for (label, key), trial in zip(keys.items(), _all_trials(campaign), strict=True):
        path = Store(campaign.folder).record(label)
        if not is_current(path, key):
            if trial is None:
                sweep = design_first(campaign, reporter).best
                trial = chosen_of(sweep, sweep.best)
            write_dataset(path, record_dataset(run_trial(campaign, trial, label, key)), key)
        records.append(read_record(path))
    return tuple(records), list(keys.values())[-1]


def record_keys(campaign: Campaign) -> dict[str, str]:
    """Key of every trial's record by its label, in their order; each depends on those before it, so the last is that of them all."""
    key, keys = key_of("simulate", _begun(campaign)), {}
    for number, trial in enumerate(_all_trials(campaign), 1):
        if isinstance(trial, Scheduled):
            plain = {name: value for name, value in trial.as_plain().items() if name != "source"}
            key = key_of("simulate", key, plain)
            keys[trial.label] = key
        else:
            key = key if trial is None else key_of("simulate", key, number, asdict(trial))
            keys[FIRST if trial is None else f"{FIRST}-{number}"] = key
    return keys


def later_trials(campaign: Campaign) -> tuple[Later, ...]:
    """Trials beyond the first.

    Where the campaign was changed, so that the first is another, those that were decided on what was found are gone; schedules stay.
    """
    return _sequence(campaign)[0]


def _all_trials(campaign: Campaign) -> tuple[Later | None, ...]:
    """Every trial in its order; None stands for the best design, which is the first where [design] names no schedule."""
    later, without_first = _sequence(campaign)
    own = campaign.own_schedule
    first = None if own is None else _of_own(own, own.label)
    if without_first or (first is not None and first.label in [getattr(one, "label", None) for one in later]):
        return later
    return (first, *later)


def _sequence(campaign: Campaign) -> tuple[tuple[Later, ...], bool]:
    """Trials beyond the first, and whether there is no first."""
    path = Store(campaign.folder).sequence
    depend_on(path)
    if not path.exists():
        return (), False
    content = read_json(path, f"seatrial next {campaign.folder} --run")
    fresh = content["key"] == key_of("sequence", _begun(campaign))
    trials = tuple(_read_later(item) for item in content["trials"] if fresh or "label" in item)
    return trials, bool(content.get("alone", False) and trials)


def add_trial(campaign: Campaign, trial: Later, alone: bool = False) -> None:
    """Decide on one trial more; it is run when records are asked for. A schedule takes the place of an earlier one of its label.

    Args:
        campaign: configuration.
        trial: what is to be run.
        alone: whether it takes the place of all trials so far.

    Raises:
        InputError: as `check_simulated`.
    """
    check_simulated(campaign)
    trials, without_first = _sequence(campaign)
    if alone:
        trials, without_first = (), True
    labels = [one.label if isinstance(one, Scheduled) else None for one in trials]
    if isinstance(trial, Scheduled) and trial.label in labels:
        at = labels.index(trial.label)
        trials = (*trials[:at], trial, *trials[at + 1 :])
    else:
        trials = (*trials, trial)
    _write_sequence(campaign, trials, without_first)


def _write_sequence(campaign: Campaign, trials: tuple[Later, ...], alone: bool) -> None:
    plain = [asdict(one) if isinstance(one, Chosen) else one.as_plain() for one in trials]
    content = {"trials": plain, **({"alone": True} if alone else {})}
    write_stamped_json(Store(campaign.folder).sequence, content, key_of("sequence", _begun(campaign)))


def check_simulated(campaign: Campaign) -> None:
    """Check that trials of this campaign are simulated.

    Raises:
        InputError: a campaign of real logs, or one that says nothing of its trials.
    """
    if not campaign.has_records:
        raise no_record(campaign)
    if not campaign.is_simulated:
        raise InputError(
            str(campaign.path), found="[import]", expected="[truth], to simulate", remedy="use `seatrial import`"
        )


def _begun(campaign: Campaign) -> str:
    own = campaign.own_schedule
    first = () if own is None else (_of_own(own, own.label).as_plain(),)
    return key_of("begun", design_key(campaign), campaign.truth, campaign.seed, *first)


def ask_for(
    campaign: Campaign,
    design: str | None,
    schedule: Path | None,
    label: str | None = None,
    alone: bool = False,
    reporter: Reporter = SILENT,
) -> None:
    """Add the trials of a design or of a schedule to those of the campaign; they are run when records are asked for.

    Args:
        campaign: configuration.
        design: name of a schedule among the results; `batch` stands for all that were planned together, `design` for the first trial.
        schedule: CSV of somebody's own.
        label: of the record; the name of the design or of the file where none is given.
        alone: whether they take the place of all trials so far.
        reporter: who is told.

    Raises:
        InputError: both, or neither with a label or `alone`; or as `check_simulated`, `designed_trials` and `own_trial`.
    """
    check_simulated(campaign)
    if (design is None) == (schedule is None) and (design is not None or label is not None or alone):
        raise InputError(
            "--design, --schedule",
            found="both" if design is not None else "neither, with --label or --only",
            expected="one of the two",
            remedy="name the trial that is to be run",
        )
    before = len(_all_trials(campaign))
    if design == "design" and label is None and campaign.own_schedule is None:
        _write_sequence(campaign, () if alone else later_trials(campaign), False)
    else:
        asked = () if design is None else designed_trials(campaign, design, label, reporter)
        asked += () if schedule is None else (own_trial(campaign, schedule, label, reporter),)
        labels = {one.label for one in later_trials(campaign) if isinstance(one, Scheduled)}
        for number, trial in enumerate(asked):
            if trial.label in labels and not alone:
                reporter.say(f"caution: {trial.label} takes the place of the trial of that label; --label keeps both")
            add_trial(campaign, trial, alone and number == 0)
    if alone and before > 1:
        reporter.say(
            f"{before} trials so far are left out; their records stay in {Store(campaign.folder).results / 'records'}"
        )


def designed_trials(
    campaign: Campaign, name: str, label: str | None = None, reporter: Reporter = SILENT
) -> tuple[Scheduled, ...]:
    """Return the trials of a design among the results, by the name of its schedule; of `batch` all that were planned together.

    Raises:
        InputError: no such schedule, a damaged one, or one that breaks today's limits.
    """
    schedules = find_schedules(campaign.folder)
    together = [one for one in schedules if one.startswith("batch_")] if name == "batch" else []
    names = [name] if name in schedules else together
    remedy = f"run `seatrial design {campaign.folder}` with the option that makes it, such as --free-form 24"
    if not names:
        raise InputError(
            f"--design {name}",
            found="no such schedule" if schedules else "no schedule",
            expected="one of " + ", ".join(schedules)
            if schedules
            else f"a designed trial under {Store(campaign.folder).results}",
            remedy=nearest(name, schedules, remedy),
        )
    if label is not None and len(names) > 1:
        raise InputError(
            "--label",
            found=f"one label for {len(names)} trials",
            expected="a label with one trial, such as --design batch_1",
            remedy="leave it out: their records are " + ", ".join(names),
        )
    trials = []
    for one in sorted(names, key=lambda one: (len(one), one)):
        about = read_about(schedules[one], remedy)
        if about.get("design", design_key(campaign)) != design_key(campaign):
            reporter.say(
                f"caution: {schedules[one].name} was designed before the campaign was changed; it is run as it is"
            )
        try:
            family = read_relay_family(about["relay"]["family"]) if "relay" in about else None
        except (KeyError, TypeError, ValueError) as cause:
            raise damaged_about(schedules[one], cause, remedy) from cause
        step = campaign.family.sample_time if family is None else family.sample_time
        trials.append(_scheduled(campaign, schedules[one], label or one, step, reporter, about.get("relay")))
    return tuple(trials)


def own_trial(campaign: Campaign, path: Path, label: str | None, reporter: Reporter = SILENT) -> Scheduled:
    """Return the trial of a schedule that somebody wrote.

    Raises:
        InputError: a table that is none of this vehicle, that breaks the limits of the control, or a label that cannot be.
    """
    return _scheduled(campaign, path, path.stem if label is None else label, campaign.family.sample_time, reporter)


def _scheduled(
    campaign: Campaign, path: Path, label: str, step: float, reporter: Reporter, relay: Mapping[str, Any] | None = None
) -> Scheduled:
    trim = campaign.control_trim(campaign.model(campaign.full))
    own = read_own(path, [name for name, _ in trim], campaign.control_limits, step)
    for line in own_lines(campaign, own):
        reporter.say(line)
    return _of_own(own, label, relay)


def own_lines(campaign: Campaign, own: OwnSchedule) -> list[str]:
    """Return what is not taken from a schedule of one's own, and what it leaves at trim."""
    name, lost, messages = PurePath(own.source).name, own.skipped, []
    if lost:
        messages.append(
            f"caution: {own.source}:{lost[0]}, {len(lost)} row{'s' * (len(lost) != 1)} between samples of "
            f"{own.schedule.time[1]:g} s: corners there are left out; lower `sample_time` of [design]"
        )
    trim, moved = campaign.control_trim(campaign.model(campaign.full)), campaign.autopilot.moved
    if still := [control for control, _ in trim if control not in (*own.schedule.controls, *moved)]:
        messages.append(f"{name}: {', '.join(still)} held at trim")
    return messages


def _of_own(own: OwnSchedule, label: str, relay: Mapping[str, Any] | None = None) -> Scheduled:
    _check_label(label)
    return Scheduled(label, PurePath(own.source).name, own.schedule, relay)


def _check_label(label: str) -> None:
    plain = (
        0 < len(label) <= MAX_LABEL_LENGTH and label.isprintable() and not set(label) & set("/\\") and label[0] != "."
    )
    taken = label == FIRST or (label.startswith(f"{FIRST}-") and label.removeprefix(f"{FIRST}-").isdigit())
    if not plain or taken:
        raise InputError(
            f"--label {label[: 2 * MAX_LABEL_LENGTH]}",
            found="a name that seatrial gives its own trials" if taken else "a name that no file can have",
            expected=f"a plain name of at most {MAX_LABEL_LENGTH} characters",
            remedy="name the record otherwise, for example --label sea-1",
        )


# The simulation.


def run_trial(campaign: Campaign, trial: Later, label: str, key: str) -> Record:
    """Simulate one trial.

    Args:
        campaign: configuration.
        trial: what is run.
        label: of the record; its noise is drawn by it.
        key: of the record.

    Raises:
        InputError: a true vehicle that runs away, or a schedule that is not of this vehicle.
    """
    if isinstance(trial, Chosen):
        manoeuvre = trial.manoeuvre(campaign.families)
        schedule = schedule_of(manoeuvre, campaign.family.sample_time)
        options = {"manoeuvre": manoeuvre.name, **{name: float(value) for name, value in manoeuvre.parameters.items()}}
    else:
        schedule, options = trial.schedule, {"manoeuvre": f"schedule {trial.source}", "relay": trial.relay is not None}
    purposes = [f"noise {channel}" if label == FIRST else f"noise {channel} {label}" for channel in campaign.channels]
    keys, measured = (
        [random_key(campaign.seed, purpose) for purpose in purposes],
        campaign.measured_mask(schedule.time) > 0,
    )
    with located(f'record "{label}"'):
        columns = true_vehicle(campaign).show(
            schedule, measured, keys, None if isinstance(trial, Chosen) else trial.relay
        )
    options |= {"truth": campaign.truth, "seed": campaign.seed}
    channels = tuple(
        Channel(name, signal_unit(name), "measurement" if name in campaign.channels else "control") for name in columns
    )
    return make_record(schedule.time, columns, channels, Provenance(SIMULATED, key, options), label)
