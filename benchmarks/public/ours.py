"""Our own entries: the campaign of the set, estimated by the posterior mode, and predicted with draws about it.

`fit_ours` takes the campaign as it stands and, of several candidate structures, the one of the largest evidence by Laplace. `fit_chosen`
takes the structure and the model of the error that predict fitted runs best, each left out in turn.

Predictions are those of the fitted model given the measurements so far. Where residuals are coloured the run is simulated from its start,
and what is left at the start of a stretch is forgotten with the correlation time tau of the residuals: for each draw

    y(t) = f(t) + rho (y(0) - f(0)) + sigma sqrt(1 - rho^2) e,   rho = exp(-t / tau)

Otherwise each stretch is simulated from the state as it is measured at its start, with white noise and, where there is any, process noise.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import jax
import numpy as np

from benchmarks.public.method import Fitted, Predicted, Problem
from benchmarks.public.tasks import Stretch
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.cross_validation import best_campaign, cross_validate
from seatrial.campaign.inference.posterior import build_likelihood, build_parameters, first_sd, initial_state
from seatrial.campaign.inference.quick_estimates import NormalPosterior, draw_about_mode
from seatrial.compiled.batching import bucket_length
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import NumericalError
from seatrial.core.record import Record
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.output_error import ANY_TRIAL, OutputError, initial_name
from seatrial.estimation.posterior.replicate import motions
from seatrial.estimation.prediction.prediction import noise_sd, slow_noise, spread_rows
from seatrial.estimation.priors import Normal
from seatrial.estimation.simulation.delayed_control import delay_control
from seatrial.estimation.simulation.starts import first_measured, level_start
from seatrial.estimation.simulation.trial_data import TrialData

RUN_DRAWS, STRETCH_DRAWS = 200, 40
"""Draws that are simulated over a whole run, and over each of its stretches."""
LANES = 2048
"""Simulations in one call: draws times stretches."""


def fit_ours(problem: Problem) -> Fitted:
    """Find the posterior mode of every structure of the campaign and keep that of the largest evidence by Laplace.

    Raises:
        NumericalError: no structure has a mode.
    """
    return _fit(problem, problem.campaign)


def fit_chosen(problem: Problem) -> Fitted:
    """Leave each fitted run out in turn, and fit the structure and model of the error that predict it best; `seatrial crossvalidate`.

    Raises:
        InputError: fewer than three fitted runs.
        NumericalError: no structure has a mode.
    """
    validated = cross_validate(problem.campaign, problem.trials, problem.reporter)
    fitted = _fit(problem, best_campaign(problem.campaign, problem.trials, validated))
    return replace(
        fitted, note=f"{fitted.note}; model of the error: {(validated.recommended or validated.own[0]).error_model}"
    )


def _fit(problem: Problem, campaign: Campaign) -> "Ours":
    """Find the modes of a campaign's structures given the fitted runs; errors as `fit_ours`."""
    study, modes, failures = Study(campaign, problem.records), [], []
    tell = problem.reporter.progress("ours: modes")
    for index, structure in enumerate(campaign.structures):
        tell(index, len(campaign.structures))
        posterior = study.posterior(structure)
        try:
            mode = find_mode(posterior, random_key(campaign.seed, f"mode {structure.terms}"))
        except NumericalError as error:
            failures.append(error)
            continue
        modes.append(
            (mode.log_evidence, draw_about_mode(campaign.seed, structure, posterior, mode), mode.only(posterior.places))
        )
    tell(len(campaign.structures), len(campaign.structures))
    if not modes:
        raise failures[0]
    _, drawn, mode = max(modes, key=lambda one: one[0])
    about, about_sd = (dict(zip(drawn.names, map(float, one), strict=True)) for one in (mode.values, mode.sd))
    several = (
        f"{drawn.structure.label} of {len(campaign.structures)} structures: " if len(campaign.structures) > 1 else ""
    )
    return Ours(campaign, drawn, about, about_sd, several + " ".join(drawn.structure.terms))


@dataclass(frozen=True, eq=False)
class Ours:
    """The fitted campaign.

    Attributes:
        campaign: of the set.
        drawn: parameters about the mode.
        about: values at the mode, SI.
        about_sd: their standard deviations as if the posterior were normal, SI.
        note: which terms.
    """

    campaign: Campaign
    drawn: NormalPosterior
    about: Mapping[str, float]
    about_sd: Mapping[str, float]
    note: str

    def predict(self, record: Record, stretches: Sequence[Stretch]) -> Predicted:
        """See `Fitted`."""
        remembers = any(sensor.noise in ("coloured", "drifting") for sensor in self.campaign.sensor_models)
        simulated = [(stretches[0][0], record.time.size - 1)] if remembers else stretches
        count = RUN_DRAWS if len(simulated) == 1 else STRETCH_DRAWS
        known = dict(zip(self.drawn.names, spread_rows(self.drawn.draws(), count).T, strict=True))
        campaign, model = self.campaign, self.campaign.model(self.drawn.structure)
        likelihood, _ = build_likelihood(campaign, model, [replace(_piece(record, simulated[0]), label=ANY_TRIAL)])
        values, starts = self._values(record, simulated, known)
        control = _late_controls(record, model.controls, values.get("delay"), len(next(iter(known.values()))))
        key = random_key(campaign.seed, f"benchmark {record.label}")
        undelayed = {**values, "delay": np.zeros_like(values["delay"])} if "delay" in values else values
        shown = _simulated(likelihood, undelayed, starts, control, record, simulated, key)
        if remembers:
            return self._remembered(record, stretches, values, next(shown))
        mean = np.full((record.time.size, len(self.campaign.channels)), np.nan)
        motion = mean.copy()
        for (begin, end), outputs in zip(stretches, shown, strict=True):
            mean[begin + 1 : end + 1], motion[begin + 1 : end + 1] = outputs[:, 1:].mean(0), outputs[:, 1:].std(0)
        noise = [np.sqrt(np.mean(noise_sd(sensor, values) ** 2)) for sensor in self.campaign.sensor_models]
        return Predicted(mean, np.hypot(motion, noise))

    def _remembered(
        self, record: Record, stretches: Sequence[Stretch], values: Mapping[str, np.ndarray], outputs: np.ndarray
    ) -> Predicted:
        """What the simulation, shape (draws, n, m), leaves at the start of each stretch is kept in mind, and forgotten from there on."""
        first = stretches[0][0]
        measured = np.column_stack([record.channel(channel) for channel in self.campaign.channels])
        noise = np.column_stack([noise_sd(sensor, values) for sensor in self.campaign.sensor_models])
        slow = [slow_noise(sensor, values) for sensor in self.campaign.sensor_models]
        mean = np.full(measured.shape, np.nan)
        sd = mean.copy()
        for begin, end in stretches:
            since = record.time[begin + 1 : end + 1] - record.time[begin]
            kept = np.stack(
                [np.zeros(since.size) if one is None else one.share * np.exp(-since / one.time) for one in slow], -1
            )
            left = measured[begin] - outputs[:, begin - first]
            centre = outputs[:, begin + 1 - first : end + 1 - first] + kept * left[:, None]
            mean[begin + 1 : end + 1] = centre.mean(0)
            variance = np.mean(noise[:, None] ** 2 * (1 - kept**2), 0)
            sd[begin + 1 : end + 1] = np.sqrt(centre.var(0) + variance)
        return Predicted(mean, sd)

    def _values(
        self, record: Record, stretches: Sequence[Stretch], known: Mapping[str, np.ndarray]
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Parameters by name, shape (draws,), those of each stretch's start (stretches, draws); and measured starts (stretches, states)."""
        campaign, model = self.campaign, self.campaign.model(self.drawn.structure)
        starts = np.array([self._start(record, stretch) for stretch in stretches])
        anonymous = replace(_piece(record, stretches[0]), label=ANY_TRIAL)
        key, count = random_key(campaign.seed, f"benchmark values {record.label}"), len(next(iter(known.values())))
        at_start = {initial_name(state, ANY_TRIAL): index for index, state in enumerate(model.states)}
        values = {}
        for index, parameter in enumerate(build_parameters(campaign, model, [anonymous])):
            name = parameter.name
            own = jax.random.fold_in(key, index)
            if name in at_start:
                column = starts[:, at_start[name]]
                spread = first_sd(campaign.noise, model.states[at_start[name]])
                values[name] = column[:, None] + np.asarray(Normal(0.0, spread).draw(own, (len(starts), count)))
            elif name in known:
                values[name] = known[name]
            else:
                values[name] = np.asarray(parameter.prior.draw(own, (count,)))
        return values, starts

    def _start(self, record: Record, stretch: Stretch) -> tuple[float, ...]:
        """State at the start of a stretch as measured there; of the whole run as the campaign says."""
        campaign, model = self.campaign, self.campaign.model(self.drawn.structure)
        piece = _piece(record, stretch)
        if stretch[0] == 0 and stretch[1] == record.time.size - 1:
            return initial_state(campaign, model, piece)
        return level_start(model, {**campaign.hull.trim, **first_measured(piece)})


def _piece(record: Record, stretch: Stretch) -> Record:
    """Samples of a record from the start of a stretch to its end; three at least, for a record has no fewer."""
    begin, end = stretch
    there = slice(begin, max(end + 1, begin + 3))
    return replace(
        record, time=record.time[there], control=record.control[there], measurement=record.measurement[there]
    )


def _late_controls(record: Record, controls: Sequence[str], delay: np.ndarray | None, draws: int) -> np.ndarray:
    """Controls as they act under each draw's delay, which reaches back before a stretch, shape (controls, draws, n)."""
    columns = np.array([record.channel(name) for name in controls])
    if delay is None:
        return np.broadcast_to(columns[:, None, :], (len(columns), draws, record.time.size))
    samples = delay / np.median(record.step)
    return np.array([[np.asarray(delay_control(column, one)) for one in samples] for column in columns])


def _simulated(
    likelihood: OutputError | FilterError,
    values: Mapping[str, np.ndarray],
    starts: np.ndarray,
    control: np.ndarray,
    record: Record,
    stretches: Sequence[Stretch],
    key: jax.Array,
) -> Iterator[np.ndarray]:
    """Yield what the sensors show without noise along each stretch, its start included, shape (draws, samples, m)."""
    draws, count = control.shape[1], len(stretches)
    length = bucket_length(max(end - begin for begin, end in stretches) + 1)
    at_once = max(1, min(count, LANES // draws))
    run = _program_of(likelihood)
    for first in range(0, count, at_once):
        places = np.minimum(first + np.arange(at_once), count - 1)
        begins, ends = np.array([stretches[place] for place in places]).T
        rows = begins[:, None] + np.arange(length)
        inside, rows = rows < ends[:, None], np.minimum(rows, ends[:, None])
        own = {
            name: column[places] if column.ndim == 2 else np.broadcast_to(column, (at_once, draws))
            for name, column in values.items()
        }
        controls = tuple(one[:, rows].transpose(1, 0, 2) for one in control)
        data = TrialData(controls, (), np.where(inside, record.step[rows], 0.0), starts[places])
        shown = np.asarray(run(own, data, jax.random.fold_in(key, first)))
        for index in range(min(at_once, count - first)):
            yield shown[index, :, : ends[index] - begins[index] + 1]


@lru_cache(maxsize=16)
def _program_of(likelihood: OutputError | FilterError):
    """Return the compiled function of values (stretches, draws), data of the stretches and a key: outputs (stretches, draws, n, m)."""

    def of_draw(values: Mapping[str, jax.Array], control: tuple, step: jax.Array, start: jax.Array, key: jax.Array):
        one = TrialData(tuple(column[None] for column in control), (), step[None], start[None])
        return motions(likelihood, values, one, key)[0]

    def of_stretch(values: Mapping[str, jax.Array], data: TrialData, keys: jax.Array):
        return jax.vmap(of_draw, (0, 0, None, None, 0))(values, data.control, data.step, data.initial, keys)

    @program
    def of_stretches(values: Mapping[str, jax.Array], data: TrialData, key: jax.Array) -> jax.Array:
        draws = jax.tree.leaves(values)[0].shape[1]
        return jax.vmap(of_stretch)(values, data, jax.random.split(key, (data.step.shape[0], draws)))

    return of_stretches
