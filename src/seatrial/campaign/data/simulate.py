"""Trials run on a simulated vehicle: the first by design, each later one as it was decided after those before it.

The truth may hold what no structure has: a lag of the actuator, dn/dt = (command - n) / lag, and a steady current along the course,
which the speed over ground shows and the speed through the water does not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import exp

import jax
import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign, actuator_lag
from seatrial.campaign.design.sweep import design_first, design_key
from seatrial.campaign.inference.posterior import random_key
from seatrial.campaign.store.files import Store, is_current, key_of, read_json, write_dataset, write_stamped_json
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.progress import SILENT, Reporter
from seatrial.core.record import SIMULATED, Channel, Provenance, Record, make_record
from seatrial.core.record_file import read_record, record_dataset
from seatrial.core.signals import signal_unit
from seatrial.design.sweep import Sweep
from seatrial.estimation.simulation import CURRENT
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.vehicles.simulate import simulate

# What to write into a campaign file that says nothing of its trials, once one has been run or is to be simulated.


def no_record(campaign: Campaign) -> InputError:
    """Return the error of what needs a record in a campaign that has neither [import] nor [truth]: both, ready to paste."""
    schedule, log = Store(campaign.folder).schedule(Store(campaign.folder).design), "`seatrial inspect LOG --map`"
    first = "" if schedule.is_file() else f"design it with `seatrial design {campaign.folder}`, "
    return InputError(
        campaign.where("import"),
        found="neither [import] nor [truth]: no trial has been run",
        expected="the log of a trial, or a vehicle to simulate",
        remedy=f"{first}run the trial of {schedule}, put its log into {campaign.folder}, and add to the file, by what {log} prints:\n"
        + _indented(import_example(campaign))
        + "\n  or, to simulate it, a value of each coefficient:\n"
        + _indented(truth_example(campaign)),
    )


def import_example(campaign: Campaign) -> str:
    """Return an [import] that maps every control and sensor of a campaign to a column of its name."""
    names = dict.fromkeys((*campaign.model(campaign.full).controls, *campaign.channels))
    columns = [f'channels.{name} = {{ column = "{name}", unit = "{shown_unit(name)[1]}" }}' for name in names]
    head = ["[import]", 'fit = ["1"]', "", "[[import.files]]", 'path = "log_{run}.csv"']
    return "\n".join([*head, 'time = { column = "time", unit = "s" }', *columns])


def truth_example(campaign: Campaign) -> str:
    """Return a [truth] at the prior means of the coefficients, SI."""
    model = campaign.model(campaign.full)
    values = [(term.text, campaign.prior(term.text).mean) for term in model.coefficients]
    return "\n".join(["[truth]", *(f"{name} = {float(mean):.4g}" for name, mean in values)])


def _indented(text: str) -> str:
    """Return lines set in below a remedy."""
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())


FIRST = "trial"
"""Label of the first trial; later ones are `trial-2`, `trial-3` and so on."""


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


def simulated_records(campaign: Campaign, reporter: Reporter = SILENT) -> tuple[tuple[Record, ...], str]:
    """Run every trial that is not current; returns the records and the key of them all.

    Raises:
        InputError: a true vehicle that runs away.
    """
    current, ahead = abs(campaign.truth.get(CURRENT, 0.0)), campaign.hull.trim.get("u")
    if ahead is not None and current > abs(ahead):
        reporter.say(f"caution: the current of {current:g} m/s is faster than the vehicle at trim, {ahead:g} m/s")
    keys, records = record_keys(campaign), []
    for (label, key), chosen in zip(keys.items(), (None, *later_trials(campaign)), strict=True):
        path = Store(campaign.folder).record(label)
        if not is_current(path, key):
            if chosen is None:
                sweep = design_first(campaign, reporter).best
                chosen = chosen_of(sweep, sweep.best)
            _run(campaign, chosen, label, key)
        records.append(read_record(path))
    return tuple(records), list(keys.values())[-1]


def record_keys(campaign: Campaign) -> dict[str, str]:
    """Key of every trial's record by its label, in their order; each depends on those before it, so the last is that of them all."""
    key = key_of("simulate", _begun(campaign))
    keys = {FIRST: key}
    for number, chosen in enumerate(later_trials(campaign), 2):
        key = key_of("simulate", key, number, asdict(chosen))
        keys[f"{FIRST}-{number}"] = key
    return keys


def later_trials(campaign: Campaign) -> tuple[Chosen, ...]:
    """Trials decided so far beyond the first; none where the campaign was changed so that the first is another."""
    path = Store(campaign.folder).sequence
    if not path.exists():
        return ()
    content = read_json(path, f"seatrial next {campaign.folder} --run")
    return (
        tuple(Chosen(**item) for item in content["trials"])
        if content["key"] == key_of("sequence", _begun(campaign))
        else ()
    )


def add_trial(campaign: Campaign, chosen: Chosen) -> None:
    """Decide on one trial more; it is run when records are asked for.

    Raises:
        InputError: as `check_simulated`.
    """
    check_simulated(campaign)
    trials = [asdict(one) for one in (*later_trials(campaign), chosen)]
    write_stamped_json(Store(campaign.folder).sequence, {"trials": trials}, key_of("sequence", _begun(campaign)))


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
    return key_of("begun", design_key(campaign), campaign.truth, campaign.seed)


def _run(campaign: Campaign, chosen: Chosen, label: str, key: str) -> None:
    family, manoeuvre = campaign.family, chosen.manoeuvre(campaign.families)
    time, command = manoeuvre.sample(family.sample_time)
    trim = campaign.control_trim(campaign.model(campaign.full))
    columns = {name: command if name == family.control else np.full(command.size, value) for name, value in trim}
    mask = campaign.measured_mask(time)
    for index, (channel, exact) in enumerate(_shown(campaign, command, family.sample_time).items()):
        purpose = f"noise {channel}" if label == FIRST else f"noise {channel} {label}"
        noise = campaign.noise[channel] * np.asarray(jax.random.normal(random_key(campaign.seed, purpose), exact.shape))
        columns[channel] = np.where(mask[:, index] > 0, exact + noise, np.nan)
    settings = {name: float(value) for name, value in manoeuvre.parameters.items()}
    told = {
        "manoeuvre": manoeuvre.name,
        **settings,
        "truth": campaign.truth,
        "seed": campaign.seed,
    }
    channels = tuple(
        Channel(name, signal_unit(name), "control" if name in dict(trim) else "measurement") for name in columns
    )
    record = make_record(time, columns, channels, Provenance(SIMULATED, key, told), label)
    write_dataset(Store(campaign.folder).record(label), record_dataset(record), key)


def _shown(campaign: Campaign, command: Float[np.ndarray, " n"], step: float) -> Mapping[str, Float[np.ndarray, " n"]]:
    """What each sensor would show of the true vehicle without noise."""
    model, truth = campaign.model(campaign.full), campaign.truth
    published = campaign.vehicle.published if campaign.vehicle.equations(campaign.full) == () else {}
    params = {term.text: truth.get(term.text, published.get(term.text, 0.0)) for term in model.coefficients}
    start = np.array(campaign.state_trim(model))
    acting, held = _lagged(command, truth.get(actuator_lag(campaign.family.control), 0.0), step)
    trim, driven = campaign.control_trim(model), campaign.family.control
    columns = [held if name == driven else np.full(command.size, value) for name, value in trim]
    shown_control = tuple(acting if name == driven else np.full(command.size, value) for name, value in trim)
    states = np.asarray(simulate(model, params, np.column_stack(columns), np.full(command.size, step), start))
    if not np.isfinite(states).all():
        raise InputError(
            campaign.where("truth"),
            found="a simulated vehicle that diverges",
            expected="damping that dissipates",
            remedy="check signs: negative damping coefficients dissipate",
        )
    shown = {}
    for sensor in campaign.sensor_models:
        drift = truth.get(CURRENT, 0.0) if sensor.channel == "u" and sensor.over_ground else 0.0
        shown[sensor.channel] = drift + np.asarray(model.output(sensor.channel, params, tuple(states.T), shown_control))
    return shown


def _lagged(
    command: Float[np.ndarray, " n"], lag: float, step: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Control that acts at each sample, and its mean until the next one, behind a first-order lag; exact for held commands."""
    if lag == 0.0:
        return command, command
    left = exp(-step / lag)
    acting = np.empty_like(command)
    acting[0] = command[0]
    for k in range(1, command.size):
        acting[k] = command[k - 1] + left * (acting[k - 1] - command[k - 1])
    return acting, command + (acting - command) * (1.0 - left) * lag / step
