"""What a chosen model leaves out and what that does to its coefficients: delays, offsets, other forces, each tested by itself."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import CampaignVehicle
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.store.estimates import Estimate, LeftOut, OfStructure, read_left_out
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.coefficients import CoefficientName
from seatrial.core.programs import program
from seatrial.core.signals import signal_unit
from seatrial.estimation.delayed_control import DELAY, delay_control
from seatrial.estimation.omitted_effects import Omitted, score_effects
from seatrial.estimation.output_error import OutputError
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.prediction_scores import effective_samples, whiteness
from seatrial.estimation.sensors import noise_name
from seatrial.selection.structures import Structure

FORCES = ("X_0", "X_u", "X_uabsu", "X_u3")
"""Forces along X that are looked for where the structure lacks them."""
CHANCE = 0.01
"""Probability that chance alone finds some effect missing."""
MATTERS = 1.0
"""Shift of a coefficient, in standard deviations, from which a missing effect is told."""
LIKELY = 0.01
"""P-value of a test of whiteness from which residuals are taken for white."""


def stored_left_out(campaign: Campaign, estimate: OfStructure) -> StoredResult[tuple[LeftOut, ...]]:
    """Return where it is kept what a structure leaves out, and what that depends on."""
    path = Store(campaign.folder).left_out(estimate.structure.label)
    read = partial(read_left_out, made_by=f"seatrial estimate {campaign.folder}")
    return StoredResult(path, key_of("left out", estimate.key), read)


def left_out(campaign: Campaign, estimate: Estimate, trials: Trials) -> tuple[LeftOut, ...]:
    """Effects that are missing beyond chance and matter, the most harmful first; none where the likelihood has process noise."""
    posterior = build_posterior(campaign, estimate.structure, trials.fit)
    if not isinstance(posterior.likelihood, OutputError):
        return ()
    return stored_left_out(campaign, estimate).read_or_make(
        lambda: {"effects": [asdict(one) for one in _left_out(campaign, estimate, posterior)]}
    )


def _left_out(campaign: Campaign, estimate: Estimate, posterior: Posterior) -> tuple[LeftOut, ...]:
    extra = _extra_forces(campaign.vehicle, estimate.structure)
    wider = Structure("wider", (*estimate.structure.terms, *extra))
    values = dict(zip(posterior.names, estimate.data["mode"].values, strict=True))
    run = _signatures(campaign.model(wider), posterior.likelihood, posterior.names, extra)
    base, slopes, of_extra, of_start, delayed = map(np.asarray, run(posterior.data, values))
    channels, data = posterior.likelihood.channels, posterior.data
    weight = np.stack(
        [np.asarray(one.present) / values[noise_name(name)] for name, one in zip(channels, data.channels, strict=True)],
        -1,
    )
    residual = (np.stack([np.asarray(one.measured) for one in data.channels], -1) - base) * weight
    cov = np.atleast_2d(np.cov(estimate.draws().T))
    signatures = {name: of_extra[..., i] for i, name in enumerate(extra)}
    if not posterior.likelihood.free_initial:
        signatures |= {f"start of {name}": of_start[..., i] for i, name in enumerate(posterior.likelihood.model.states)}
    step = float(np.asarray(data.step)[0, 0])
    if not campaign.has_delay and np.ptp(np.asarray(data.step)[np.asarray(data.step) > 0]) < 1e-6 * step:
        signatures[DELAY] = (delayed - base) / step
    for i, sensor in enumerate(campaign.sensor_models):
        if not sensor.bias:
            signatures[f"offset of {sensor.channel}"] = np.eye(len(channels))[i] * np.ones_like(base)
    found = score_effects(
        residual.ravel(),
        (slopes * weight[..., None]).reshape(-1, slopes.shape[-1]),
        cov,
        {name: (signature * weight).ravel() for name, signature in signatures.items()},
        _worth(residual, weight, np.asarray(data.step)),
    )
    return _that_matter(campaign.vehicle, estimate, found)


def _that_matter(vehicle: CampaignVehicle, estimate: Estimate, found: Sequence[Omitted]) -> tuple[LeftOut, ...]:
    names = [name for name in estimate.structure.terms if name in estimate.names]
    at = [estimate.names.index(name) for name in names]
    sd = np.array([float(estimate.data.sel(parameter=name)["sd"]) for name in names])
    missing = []
    for effect in found:
        moves = effect.shift[at] / sd
        worst = int(np.argmax(np.abs(moves)))
        if effect.p_value < CHANCE / len(found) and abs(moves[worst]) > MATTERS:
            missing.append(LeftOut(*_effect_words(vehicle, estimate, effect), names[worst], float(moves[worst])))
    return tuple(sorted(missing, key=lambda one: -abs(one.by)))


def _effect_words(vehicle: CampaignVehicle, estimate: Estimate, effect: Omitted) -> tuple[str, str]:
    """Name and size of an effect, and how to add it."""
    size = f"{effect.size:.2g} ± {effect.sd:.1g}"
    if effect.name == DELAY:
        return f"a delay or lag of the actuator of about {size} s", "give `delay` a prior, [prior.delay]"
    kind, _, channel = effect.name.partition(" of ")
    if kind == "offset":
        words = f"an offset of {channel}, a bias of the sensor or a current, of about {size} {signal_unit(channel)}"
        return words, f'set sensors.{channel}.bias = "own" or estimation.current = "own", with a prior'
    if kind == "start":
        words = f"a start that differs from what is assumed in {channel} by about {size} {signal_unit(channel)}"
        return words, 'set estimation.initial = "estimated"'
    model = vehicle.model(Structure("wider", (*estimate.structure.terms, effect.name)))
    words = f"a force {effect.name} of about {size} {model.unit_of(CoefficientName.parse(effect.name))}"
    return words, f"add {effect.name} to structure.optional, with a prior"


def _extra_forces(vehicle: CampaignVehicle, structure: Structure) -> tuple[str, ...]:
    if not vehicle.is_surge:
        return ()
    taken = {*structure.terms, *vehicle.hull.fixed}
    return tuple(name for name in FORCES if name not in taken)


def _worth(residual: np.ndarray, weight: np.ndarray, step: np.ndarray) -> float:
    """Share of the samples that residuals are worth, of the channel and trial where they are worth least; 1 where all are white."""
    shares = [1.0]
    for trial in range(residual.shape[0]):
        time = np.concatenate([[0.0], np.cumsum(step[trial])[:-1]])
        for channel in range(residual.shape[2]):
            present = weight[trial, :, channel] > 0
            if whiteness(time[present], residual[trial, present, channel]).p_value < LIKELY:
                shares.append(effective_samples(time[present], residual[trial, present, channel]) / present.sum())
    return float(min(shares))


@lru_cache(maxsize=8)
def _signatures(model: Any, likelihood: OutputError, names: tuple[str, ...], extra: tuple[str, ...]):
    """Prediction, its slopes along the parameters, along forces that are absent and along the start, and behind a late command."""
    simulator = replace(likelihood.simulator, model=model)

    @program
    def run(data: Any, values: dict) -> tuple:
        def shown(point: Any, forces: Any, starts: Any, late: bool = False) -> Any:
            named = {**dict(zip(names, point, strict=True)), **dict(zip(extra, forces, strict=True))}

            def of_one_trial(apart: dict, trial: Any, start: Any) -> Any:
                control = tuple(delay_control(column, jnp.ones(())) if late else column for column in trial.control)
                return simulator.outputs({**named, **apart}, start + starts, control, trial.step)

            return jax.vmap(of_one_trial)(likelihood.apart(named), data, likelihood.starts(named, data))

        point = jnp.array([values[name] for name in names])
        forces, still = jnp.zeros(len(extra)), jnp.zeros(data.initial.shape[-1])
        slopes = jax.jacfwd(shown, (0, 1, 2))(point, forces, still)
        return shown(point, forces, still), *slopes, shown(point, forces, still, late=True)

    return run
