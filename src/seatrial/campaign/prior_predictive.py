"""What the priors of the full structure mean in metres per second: motions drawn from them before any data are used.

Each draw of the coefficients and nuisances is simulated over one control; see Gelman et al., Bayesian Workflow,
arXiv:2011.01808, section 2.4.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from zlib import crc32

import jax
import numpy as np
from jaxtyping import Float

from seatrial.campaign.config import Campaign
from seatrial.campaign.prior_motion import FASTEST, speeds, steady_motion
from seatrial.campaign.prior_trial import PriorTrial, prior_trial
from seatrial.campaign.problem import random_key
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.coefficients import CoefficientName
from seatrial.core.shown import shown_unit
from seatrial.estimation.output_error import initial_name, own_name
from seatrial.estimation.priors import Prior, physical_support
from seatrial.estimation.sensors import bias_name, noise_name
from seatrial.estimation.simulation import CURRENT
from seatrial.vehicles.model import VehicleModel

N_DRAWS = 2000
SHOWN, SINGLE = 600, 6
"""Instants kept of each motion, at most; motions kept whole, to be drawn."""
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
MOST = 0.5
"""Share of draws without a motion above which a prior is not to be used."""


@dataclass(frozen=True)
class Believed:
    """One parameter's prior, and what it does alone.

    Attributes:
        name: of the parameter.
        unit: SI.
        quantiles: 5, 50 and 95 % of its prior, SI.
        speed: 5 and 95 % of the steady speed, m/s, where it alone varies and the other coefficients are at their medians;
            None for a parameter that is no coefficient, NaN where most draws have no steady speed.
        blame: how much larger it is among draws that run away than among the others, in standard deviations; 0 if none do.
    """

    name: str
    unit: str
    quantiles: tuple[float, float, float]
    speed: tuple[float, float] | None
    blame: float


@dataclass(frozen=True, eq=False)
class PriorPredictive:
    """Motions that the prior expects.

    Attributes:
        over: what was simulated, in words.
        time: s, shape (n,).
        control: name to values, SI, shape (n,).
        bands: quantiles of u, through the water, at `LEVELS` among draws that do not diverge, m/s, shape (5, n); NaN if most do.
        single: u of a few draws, m/s, shape (k, n); NaN where they have diverged.
        measured: u as measured, m/s, NaN where not, shape (n,); None where it is not.
        held: share of the measured speeds inside the 90 % range of what the prior expects to be measured, with noise, bias and current;
            NaN where nothing can be compared.
        at: steady control, in words.
        steady: speed in which each draw settles at that control from the trial's first, m/s, NaN where it does not, shape (draws,).
        settling: time constant there, s, likewise.
        diverged: which draws leave `FASTEST`, shape (draws,).
        believed: the parameters.
        unphysical: coefficients whose priors allow values that physics does not.
    """

    over: str
    time: Float[np.ndarray, " n"]
    control: Mapping[str, np.ndarray]
    bands: Float[np.ndarray, "5 n"]
    single: Float[np.ndarray, "k n"]
    measured: Float[np.ndarray, " n"] | None
    held: float
    at: str
    steady: Float[np.ndarray, " draws"]
    settling: Float[np.ndarray, " draws"]
    diverged: np.ndarray
    believed: tuple[Believed, ...]
    unphysical: tuple[str, ...]

    @property
    def lost(self) -> np.ndarray:
        """Draws that run away: they diverge, or have no steady speed, shape (draws,)."""
        return self.diverged | np.isnan(self.steady)


def predict_from_prior(campaign: Campaign, watch: Watch = SILENT) -> PriorPredictive:
    """Draw from the full structure's prior and simulate over the trial that `prior_trial` finds.

    Raises:
        InputError: logs that cannot be read, no design inside the limits, or a vehicle that does not only move along X.
    """
    campaign.check_surge("the prior predictive check")
    model = campaign.model(campaign.full)
    trial = prior_trial(campaign, watch)
    key = random_key(campaign, "prior predictive")
    drawn = {name: _draw(prior, key, name) for name, prior in trial.priors.items()}
    coefficients = {term.text: drawn[term.text] for term in model.coefficients}
    names = [initial_name(state, trial.label) for state in model.states]
    start = [drawn.get(name, np.full(N_DRAWS, value)) for name, value in zip(names, trial.start, strict=True)]
    current, bias = (_of_trial(drawn, name, trial.label) for name in (CURRENT, bias_name("u")))
    if trial.label and campaign.source.estimation.initial != "trim":
        start[model.states.index("u")] = start[model.states.index("u")] - current
    keep = np.unique(np.linspace(0, trial.time.size - 1, SHOWN).round().astype(int))
    speed, diverged = speeds(
        model, "u", coefficients, drawn.get("delay"), np.column_stack(start), trial.control, trial.step, keep
    )
    moving = speed[~diverged]
    usable = diverged.mean() <= MOST
    measured = None if trial.measured is None else trial.measured[keep]
    held = float("nan")
    if usable and measured is not None:
        noise = drawn[noise_name("u")][~diverged, None] * np.asarray(jax.random.normal(key, moving.shape))
        held = _held(measured, moving + (bias + current)[~diverged, None] + noise)
    control, at = _steady_control(campaign, model, trial)
    cruise = trial.start[model.states.index("u")]
    steady, settling = steady_motion(model, coefficients, control, cruise)
    return PriorPredictive(
        trial.words,
        trial.time[keep],
        {name: trial.control[keep, i] for i, name in enumerate(model.controls)},
        np.quantile(moving, LEVELS, axis=0) if usable else np.full((len(LEVELS), keep.size), np.nan),
        np.where(np.abs(speed[:SINGLE]) <= FASTEST, speed[:SINGLE], np.nan),
        measured,
        held,
        at,
        steady,
        settling,
        diverged,
        tuple(
            _believed(model, name, drawn, trial.units[name], control, cruise, diverged | np.isnan(steady))
            for name in drawn
        ),
        tuple(term.text for term in model.coefficients if _reaches_beyond(campaign, term, trial.priors[term.text])),
    )


def most_have(values: Float[np.ndarray, " draws"]) -> bool:
    """Whether at least half of the draws have a value."""
    return bool(np.isnan(values).mean() <= MOST)


def _draw(prior: Prior, key: jax.Array, name: str) -> Float[np.ndarray, " draws"]:
    return np.asarray(prior.draw(jax.random.fold_in(key, crc32(name.encode())), (N_DRAWS,)), float)


def _of_trial(drawn: Mapping[str, np.ndarray], name: str, label: str) -> Float[np.ndarray, " draws"]:
    """A nuisance that trials share or that each has of its own; 0 where it is none."""
    return drawn.get(name, drawn.get(own_name(name, label), np.zeros(N_DRAWS)))


def _held(measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, "draws n"]) -> float:
    """Share of the measured values inside the 90 % range of what is expected; NaN if none are measured."""
    there = np.isfinite(measured)
    if not there.any():
        return float("nan")
    low, high = np.quantile(expected[:, there], (LEVELS[0], LEVELS[-1]), axis=0)
    return float(np.mean((measured[there] >= low) & (measured[there] <= high)))


def _steady_control(campaign: Campaign, model: VehicleModel, trial: PriorTrial) -> tuple[list[float], str]:
    """Controls at trim; where the campaign knows none, the medians of the trial's."""
    trim = {**campaign.hull.trim, campaign.family.control: campaign.family.trim}
    control = [trim.get(name, 0.0) for name in model.controls]
    if not any(control):
        control = [float(value) for value in np.median(trial.control, axis=0)]
    shown = [(name, value, *shown_unit(name)) for name, value in zip(model.controls, control, strict=True)]
    return control, ", ".join(f"{name} = {value * factor:.4g} {unit}" for name, value, factor, unit in shown)


def _believed(
    model: VehicleModel,
    name: str,
    drawn: Mapping[str, np.ndarray],
    unit: str,
    control: list[float],
    cruise: float,
    lost: np.ndarray,
) -> Believed:
    values, terms = drawn[name], [term.text for term in model.coefficients]
    low, middle, high = (float(value) for value in np.quantile(values, (0.05, 0.5, 0.95)))
    if name not in terms:
        return Believed(name, unit, (low, middle, high), None, 0.0)
    others = {term: np.full(N_DRAWS, np.median(drawn[term])) for term in terms}
    steady, _ = steady_motion(model, {**others, name: values}, control, cruise)
    ends = np.nanquantile(steady, (0.05, 0.95)) if most_have(steady) else (np.nan, np.nan)
    blame = (values[lost].mean() - values[~lost].mean()) / values.std() if 0 < lost.sum() < lost.size else 0.0
    return Believed(name, unit, (low, middle, high), (float(ends[0]), float(ends[1])), float(blame))


def _reaches_beyond(campaign: Campaign, term: CoefficientName, prior: Prior) -> bool:
    support = physical_support(term, 1.0 if campaign.hull.mass is None else campaign.hull.mass)
    return support is not None and not (support[0] <= prior.bounds[0] and prior.bounds[1] <= support[1])
