"""From a vehicle, records and priors to a posterior: whatever has a prior is unknown (`seatrial.estimation.posterior.unknowns`)."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.compiled.engine import check_precision
from seatrial.core.argument_checks import check_each_of, check_kind, check_names, check_numbers, check_sequence, shown
from seatrial.core.coefficients import base_name, configuration_name
from seatrial.core.errors import InputError, nearest
from seatrial.core.record import Record
from seatrial.core.signals import RATES
from seatrial.estimation.posterior.filter_error import FilterError, filter_error, process_name
from seatrial.estimation.posterior.first_guess import first_guess
from seatrial.estimation.posterior.output_error import (
    OutputError,
    output_error,
    own_name,
    spread_name,
)
from seatrial.estimation.posterior.posterior import Parameter, Posterior, check_priors
from seatrial.estimation.posterior.unknowns import (
    Unknown,
    deviations,
    may_differ,
    may_vary,
    slow_noise_priors,
    unknowns_of,
)
from seatrial.estimation.priors import Prior
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.disturbance import disturbed_axes
from seatrial.estimation.simulation.sensor_errors import Sensor, noise_kinds, noise_name
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.estimation.simulation.starts import start_of
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.vehicles.model import VehicleModel

_A_RECORD = "give one, or a list of them, of `read_log`, `make_record` or `simulate`"
# Differences between configurations of a vehicle if none are stated: weight less buoyancy, and the height of the centre of buoyancy.
BY_CONFIGURATION = ("net_weight", "z_b")
# Standard deviations of a prior above 0, from which its values below 0, one in thirty thousand, do not matter.
MIN_SDS_ABOVE_ZERO = 4.0
UNSEEN_SD = 1.0  # Standard deviation of a state at the start where no sensor shows it, in its own unit


def make_posterior(
    model: VehicleModel,
    records: Record | Sequence[Record],
    priors: Mapping[str, Prior],
    sensors: Sequence[Sensor | str] | None = None,
    *,
    start: Mapping[str, float] | Sequence[Sequence[float]] | None = None,
    start_sd: Mapping[str, float] | None = None,
    starts_over_ground: bool | None = None,
    own: Sequence[str] = (),
    by_configuration: Sequence[str] | None = None,
) -> Posterior:
    """Build the posterior of all unknowns with a prior, given one record or several that are fitted jointly.

    Args:
        model: vehicle; its coefficients are unknown, all others are part of it.
        records: trials, each with a different label.
        priors: of each unknown by name, SI: coefficients of the vehicle; `sigma_u`, `tau_u`, `dof_u`, `bias_u` and `lag_u` of a
            sensor, `share_u` of noise in proportion to the signal; `delay`, `current`, `process_u`, `disturbance_X` with
            `disturbance_time_X`, `spread_X_u` and `u_0`. What each trial has of its own may have a separate prior, as `u_0[trial]`,
            and so may the value of a configuration, as `net_weight@loaded`. The slow part of a noise that drifts has usual priors
            where none is stated (`slow_noise_priors`).
        sensors: measured channels; a name means a sensor of white noise. All channels of the first record if not given.
        start: state at the first sample, if it is known better than by its first measurement; signal name to SI value. Or the
            whole state of each record, SI, in the order of the states of the vehicle, shape (records, n_states).
        start_sd: where a filter is used, how well each state is known at the start, SI; if not given, as well as its sensor's noise is
            large by the mean of its prior, and 1 for a state that nothing measures.
        starts_over_ground: whether the surge velocity at the start is over ground; by default through the water if `start` states it,
            else over ground.
        own: unknowns with a separate value for each trial, such as `bias_u` or `current`.
        by_configuration: unknowns of the vehicle with a separate value for each configuration of the records (`Record.in_configuration`);
            if not given, `net_weight` and `z_b` as far as they have a prior. All others are common to the configurations.

    Returns:
        a posterior with parameters named as the priors; those of one trial end in its label, as `u_0[trial]`, and those of one
        configuration in its name, as `net_weight@loaded`.

    Raises:
        InputError: an unknown without a prior, a prior that nothing uses, a channel or control that a record lacks, or a velocity of
            which nothing says where it starts; a prior that allows values below 0 of a noise, a time or another size.
    """
    check_precision()
    check_model(model)
    records = [records] if isinstance(records, Record) else list(check_each_of(records, Record, "records", _A_RECORD))
    if not records:
        raise InputError("records", found="none", expected="one record at least", remedy=_A_RECORD)
    chosen = sensors_of(model, records, sensors)
    check_priors(priors)
    priors = {**priors, **slow_noise_priors(chosen, priors)}
    own = check_names(own, "own", "bias_u")
    check_numbers(start_sd, "start_sd", known=model.states, above=0.0)
    stated = {base_name(name) for name in priors}
    if by_configuration is None:
        differing = any(record.configuration for record in records)
        by_configuration = [
            name for name in BY_CONFIGURATION if differing and name in stated and name in may_differ(model)
        ]
    by_configuration = check_names(by_configuration, "by_configuration", "net_weight")
    configurations = _configurations(model, records, by_configuration, own, stated)
    parameters = parameters_of(
        model, chosen, priors, [record.label for record in records], own, by_configuration, configurations
    )
    sizes = {name: priors[name].mean if name in priors else np.nan for name in stated}
    sizes |= {noise_name(state): sd for state, sd in (start_sd or {}).items()}
    free = f"{model.states[0]}_0" in stated
    starts = starts_of(model, records, start, free)
    if starts_over_ground is None:
        starts_over_ground = start is None or (isinstance(start, Mapping) and "u" not in start)
    likelihood, data = likelihood_of(
        model,
        records,
        chosen,
        sizes,
        starts,
        own=own,
        free_initial=free,
        starts_over_ground=starts_over_ground,
        by_configuration=by_configuration,
    )
    guess = None
    # In surge alone draws from the prior do as well.
    if [state for state in model.states if state in RATES] != ["u"]:
        coefficients = first_guess(model, records, starts, priors_of_guess(parameters))
        guess = guess_of(parameters, coefficients)
    return Posterior(parameters, likelihood, data, guess)


def parameters_of(
    model: VehicleModel,
    sensors: Sequence[Sensor],
    priors: Mapping[str, Prior],
    labels: Sequence[str],
    own: Sequence[str] = (),
    by_configuration: Sequence[str] = (),
    configurations: Sequence[str] = (),
) -> tuple[Parameter, ...]:
    """Return the parameters of a posterior: those of all trials, then deviations, then initial states.

    Args:
        model: vehicle.
        sensors: of the measured channels.
        priors: see `make_posterior`.
        labels: of the trials.
        own: see `make_posterior`.
        by_configuration: see `make_posterior`.
        configurations: of the records, each once.

    Raises:
        InputError: an unknown without a prior, a prior that nothing uses or one that allows values below 0 of what has no sign.
    """
    unknown = unknowns_of(model, sensors, {base_name(name) for name in priors})
    each = (*own, *(one.name for one in unknown if one.is_initial))
    _check_signs(priors, unknown)
    parts = [own_name(name, label) for label in labels for name in each]
    parts += [configuration_name(name, one) for one in configurations for name in by_configuration]
    _check_priors(priors, unknown, own, parts)
    return tuple(_parameters(unknown, priors, labels, own, dict.fromkeys(by_configuration, configurations)))


def priors_of_guess(parameters: Sequence[Parameter]) -> dict[str, Prior]:
    """Return the priors by which `first_guess` judges: of a coefficient of several configurations the first."""
    return {one.name.partition("@")[0]: one.prior for one in reversed(parameters)}


def guess_of(parameters: Sequence[Parameter], guess: Mapping[str, float]) -> Float[np.ndarray, " d"]:
    """Return the guess of each parameter, NaN without one: all configurations of a coefficient have the same."""
    return np.array([guess.get(one.name.partition("@")[0], np.nan) for one in parameters])


def starts_of(
    model: VehicleModel,
    records: Sequence[Record],
    start: Mapping[str, float] | Sequence[Sequence[float]] | None,
    free: bool,
) -> list[tuple[float, ...]]:
    """Return the state at the first sample of each record, SI; `start` as that of `make_posterior`.

    Raises:
        InputError: a state that is no number, or a velocity of which nothing says where it starts, unless it is `free`.
    """
    if start is None or isinstance(start, Mapping):
        return [start_of(model, record, start, free) for record in records]
    given = check_sequence(start, "start", 'write for example {"u": 1.5}')
    try:
        starts = [tuple(map(float, state)) for state in given]
    except (TypeError, ValueError):
        starts = []
    if [len(state) for state in starts] != [len(model.states)] * len(records) or not np.isfinite(starts).all():
        raise InputError(
            "start",
            found=shown(start),
            expected=f"one state for each of {len(records)} records: {', '.join(model.states)}, all finite",
            remedy='give them all, or a mapping such as {"u": 1.5}',
        )
    return starts


def check_model(model: VehicleModel) -> None:
    """Check that a vehicle has been built.

    Raises:
        InputError: it has not, or is none.
    """
    check_kind(
        model, VehicleModel, "model", 'build it of a vehicle: load_vehicle("remus100_surge").build(free=["X_u"])'
    )


def sensors_of(
    model: VehicleModel, records: Sequence[Record], sensors: Sequence[Sensor | str] | None
) -> tuple[Sensor, ...]:
    """Return the sensors: as given, or all channels of the first record that the vehicle has.

    Raises:
        InputError: a channel that the vehicle does not have, or none at all.
    """
    if sensors is not None:
        return stated_sensors(model, sensors)
    known = model.channel_units()
    measured = [name for name in records[0].measured if name in known]
    if not measured:
        raise InputError(
            f'record "{records[0].label}"',
            found="no channel of the vehicle",
            expected="one of " + ", ".join(known),
            remedy="measure one of them, or choose another vehicle",
        )
    return stated_sensors(model, measured)


def stated_sensors(model: VehicleModel, sensors: Sequence[Sensor | str]) -> tuple[Sensor, ...]:
    """Return sensors as stated, each of another channel; a name alone is a sensor of white noise.

    Raises:
        InputError: none, something that is neither, a channel that the vehicle does not have, or one twice.
    """
    known, example = model.channel_units(), 'write for example ["u"] or [Sensor("u", bias=True)]'
    asked = check_sequence(sensors, "sensors", example)
    chosen = check_each_of([Sensor(one) if isinstance(one, str) else one for one in asked], Sensor, "sensors", example)
    if not chosen:
        raise InputError("sensors", found="none", expected="one of " + ", ".join(known), remedy=example)
    for sensor in chosen:
        if sensor.channel not in known or [one.channel for one in chosen].count(sensor.channel) > 1:
            raise InputError(
                "sensors",
                found=f'channel "{sensor.channel}"' + " twice" * (sensor.channel in known),
                expected="each once, of " + ", ".join(known),
                remedy="leave one out" if sensor.channel in known else nearest(sensor.channel, known),
            )
    return chosen


def likelihood_of(
    model: VehicleModel,
    records: Sequence[Record],
    sensors: Sequence[Sensor],
    values: Mapping[str, float],
    starts: Sequence[Sequence[float]],
    *,
    free_initial: bool = False,
    **options: Any,
) -> tuple[OutputError | FilterError, TrialData]:
    """Return the likelihood in which everything of `values` is a parameter, and its data.

    Args:
        model: vehicle.
        records: trials.
        sensors: measured channels.
        values: of the parameters, SI, of which the size of a sensor's noise says how well a start is known.
        starts: state at the first sample of each trial.
        free_initial: whether the starts are parameters; a filter takes them as uncertain anyway.
        options: `own`, `starts_over_ground` and `by_configuration` of `output_error`.

    Raises:
        InputError: as `output_error` and `filter_error`.
    """
    options |= {"delay": DELAY in values, "current": CURRENT in values}
    options["varying"] = tuple(one.name for one in may_vary(model) if spread_name(one.name) in values)
    disturbed = disturbed_axes(values, model)
    if disturbed or any(process_name(state) in values for state in model.states):
        spread = [float(values.get(noise_name(state), UNSEEN_SD)) for state in model.states]
        return filter_error(model, records, sensors, starts, spread, disturbed=disturbed, **options)
    return output_error(model, records, sensors, starts, free_initial=free_initial, **options)


def _configurations(
    model: VehicleModel,
    records: Sequence[Record],
    differing: Sequence[str],
    own: Sequence[str],
    stated: Collection[str],
) -> tuple[str, ...]:
    """Return the configurations of the records, each once.

    Raises:
        InputError: a record without one beside others, or names that cannot differ between them.
    """
    each, allowed = [record.configuration for record in records], may_differ(model)
    if "" in each and (any(each) or differing):
        raise InputError(
            f'record "{records[each.index("")].label}"',
            found="no configuration",
            expected="one of each record, if others have one or coefficients differ by it",
            remedy='name it: record.in_configuration("empty")',
        )
    for name in differing:
        if name in own or spread_name(name) in stated or name not in allowed:
            raise InputError(
                "by_configuration",
                found=f'"{name}"' + (", which differs from trial to trial as well" if name in allowed else ""),
                expected="unknowns of the vehicle that trials share, of " + ", ".join(allowed),
                remedy="leave it out of one of the two" if name in allowed else nearest(name, allowed),
            )
    return tuple(dict.fromkeys(filter(None, each)))


def _parameters(
    unknown: Sequence[Unknown],
    priors: Mapping[str, Prior],
    labels: Sequence[str],
    own: Sequence[str],
    configurations: Mapping[str, Sequence[str]],
) -> list[Parameter]:
    """Return all parameters: one for all trials, or one for each under its label; then deviations, then initial states.

    Those that differ by configuration have `configurations`.
    """
    shared, initial = [one for one in unknown if not one.is_initial], [one for one in unknown if one.is_initial]
    result = []
    for one in shared:
        if one.name in own:
            result += [_of_trial(one, label, priors) for label in labels]
        elif one.name in configurations:
            for configuration in configurations[one.name]:
                prior = priors.get(configuration_name(one.name, configuration)) or priors[one.name]
                result.append(one.of_configuration(configuration, prior))
        else:
            result.append(one.parameter(priors[one.name]))
    names = {one.name for one in shared}
    result += deviations([one for one in shared if spread_name(one.name) in names], labels)
    return result + [_of_trial(one, label, priors) for label in labels for one in initial]


def _of_trial(one: Unknown, label: str, priors: Mapping[str, Prior]) -> Parameter:
    return one.of_trial(label, priors.get(own_name(one.name, label)) or priors[one.name])


def _check_priors(
    priors: Mapping[str, Prior], unknown: Sequence[Unknown], own: Sequence[str], of_trials: Sequence[str]
) -> None:
    needed = {one.name: one.unit for one in unknown}
    parts = {name: [part for part in of_trials if base_name(part) == name] for name in needed}
    there = {name for name, own in parts.items() if name in priors or (own and all(part in priors for part in own))}
    missing = {name: unit for name, unit in needed.items() if name not in there}
    if missing:
        raise InputError(
            "priors",
            found="none of " + ", ".join(missing),
            expected="a prior of " + ", ".join(f"{name} ({unit})" for name, unit in missing.items()),
            remedy=f'for example priors["{next(iter(missing))}"] = Uniform(lower, upper)',
        )
    shared = [one.name for one in unknown if not one.is_initial]
    for where, names, allowed in (("priors", priors, [*needed, *of_trials]), ("own", own, shared)):
        for name in names:
            if name in allowed:
                continue
            kind, _, channel = name.partition("_")
            remedy, of_noise = nearest(name, allowed), noise_kinds(channel).get(name)
            if (of_noise or kind in ("bias", "lag")) and noise_name(channel) in allowed:
                needed_option = f'noise="{of_noise}"' if of_noise else f"{kind}=True"
                remedy = f'make it Sensor("{channel}", {needed_option}), or leave {name} out'
            found, expected = f'"{name}", which nothing uses', "among " + ", ".join(allowed)
            raise InputError(where, found=found, expected=expected, remedy=remedy)


def _check_signs(priors: Mapping[str, Prior], unknown: Sequence[Unknown]) -> None:
    """Refuse priors that give values below 0 more than a trace of probability, of what has no sign."""
    unsigned = {one.name for one in unknown if not one.signed}
    for name, prior in priors.items():
        if base_name(name) in unsigned and prior.bounds[0] < 0 and prior.mean < MIN_SDS_ABOVE_ZERO * prior.sd:
            raise InputError(
                f'priors["{name}"]',
                found=f"{shown(prior)}, which allows values below 0",
                expected="a prior of values above 0: noises and times have no sign",
                remedy="for example LogUniform(lower, upper) or half_normal(scale, lower=0.0)",
            )
