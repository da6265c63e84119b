"""Our own entry: the campaign of the set, estimated by the posterior mode, and predicted with draws about it.

Of several candidate structures the one of the largest evidence by Laplace is taken. A stretch is simulated from the state as it is
measured at its start, with the drawn parameters. What the sensors add to the motion is white noise, or, where the residuals of the fit are
coloured, a process that begins at zero there, for the state was just measured, and forgets that with its correlation time:

    sd^2 = sd of the motion^2 + sigma^2 (1 - exp(-2 t / tau))
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.benchmark.method import Fitted, Predicted, Problem
from seatrial.benchmark.tasks import Stretch
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import first_measured, level_start
from seatrial.campaign.inference.posterior import build_likelihood, build_parameters, first_sd, initial_state, random_key
from seatrial.campaign.inference.quick_estimates import NormalPosterior, draw_about_mode
from seatrial.core.batching import bucket_length
from seatrial.core.errors import NumericalError
from seatrial.core.programs import program
from seatrial.core.record import Record
from seatrial.estimation.filter_error import FilterError
from seatrial.estimation.mode import find_mode
from seatrial.estimation.output_error import OutputError, initial_name
from seatrial.estimation.prediction import ANY, noise_sd
from seatrial.estimation.priors import Normal
from seatrial.estimation.replicate import motions
from seatrial.estimation.sensors import correlation_name
from seatrial.estimation.simulation import delay_control
from seatrial.estimation.trial_data import TrialData

RUN_DRAWS, STRETCH_DRAWS = 200, 40
"""Draws that are simulated over a whole run, and over each of its stretches."""
LANES = 2048
"""Simulations in one call: draws times stretches."""


def fit_ours(problem: Problem) -> Fitted:
    """Find the posterior mode of every structure of the campaign and keep that of the largest evidence by Laplace.

    Raises:
        NumericalError: no structure has a mode.
    """
    campaign = problem.campaign
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
        modes.append((mode.log_evidence, draw_about_mode(campaign.seed, structure, posterior, mode), mode.only(posterior.places)))
    tell(len(campaign.structures), len(campaign.structures))
    if not modes:
        raise failures[0]
    _, drawn, mode = max(modes, key=lambda one: one[0])
    about = dict(zip(drawn.names, map(float, mode.values), strict=True))
    several = f"{drawn.structure.label} of {len(campaign.structures)} structures: " if len(campaign.structures) > 1 else ""
    return Ours(campaign, drawn, about, several + " ".join(drawn.structure.terms))


@dataclass(frozen=True, eq=False)
class Ours:
    """The fitted campaign.

    Attributes:
        campaign: of the set.
        drawn: parameters about the mode.
        about: values at the mode, SI.
        note: which terms.
    """

    campaign: Campaign
    drawn: NormalPosterior
    about: Mapping[str, float]
    note: str

    def predict(self, record: Record, stretches: Sequence[Stretch]) -> Predicted:
        """See `Fitted`."""
        draws = self.drawn.draws()
        count = RUN_DRAWS if len(stretches) == 1 else STRETCH_DRAWS
        known = dict(zip(self.drawn.names, draws[:: max(1, len(draws) // count)][:count].T, strict=True))
        campaign, model = self.campaign, self.campaign.model(self.drawn.structure)
        likelihood, _ = build_likelihood(campaign, model, [replace(_piece(record, stretches[0]), label=ANY)])
        values, starts = self._values(record, stretches, known)
        control = _late_controls(record, model.controls, values.get("delay"), len(next(iter(known.values()))))
        mean, motion = _simulated(
            likelihood, {**values, "delay": np.zeros_like(values["delay"])} if "delay" in values else values,
            starts, control, record, stretches, random_key(campaign.seed, f"benchmark {record.label}"),
        )
        return Predicted(mean, np.hypot(motion, self._noise(record, stretches, values)))

    def _values(
        self, record: Record, stretches: Sequence[Stretch], known: Mapping[str, np.ndarray]
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Parameters by name, shape (draws,), those of each stretch's start (stretches, draws); and measured starts (stretches, states)."""
        campaign, model = self.campaign, self.campaign.model(self.drawn.structure)
        starts = np.array([self._start(record, stretch) for stretch in stretches])
        anonymous = replace(_piece(record, stretches[0]), label=ANY)
        key, count = random_key(campaign.seed, f"benchmark values {record.label}"), len(next(iter(known.values())))
        at_start = {initial_name(state, ANY): index for index, state in enumerate(model.states)}
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

    def _noise(self, record: Record, stretches: Sequence[Stretch], values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Standard deviation of what the sensors add to the motion, by the time since the start of each stretch, shape (n, m)."""
        since = np.full(record.time.size, np.nan)
        for begin, end in stretches:
            since[begin + 1 : end + 1] = record.time[begin + 1 : end + 1] - record.time[begin]
        columns = []
        for sensor in self.campaign.sensor_models:
            variance = np.mean(noise_sd(sensor, values) ** 2)
            tau = correlation_name(sensor.channel)
            grown = 1.0 if tau not in values or len(stretches) == 1 else -np.expm1(-2.0 * since / np.median(values[tau]))
            columns.append(np.sqrt(variance * grown) * np.ones_like(since))
        return np.column_stack(columns)


def _piece(record: Record, stretch: Stretch) -> Record:
    """Samples of a record from the start of a stretch to its end; three at least, for a record has no fewer."""
    begin, end = stretch
    there = slice(begin, max(end + 1, begin + 3))
    return replace(record, time=record.time[there], control=record.control[there], measurement=record.measurement[there])


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
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation over the draws of what the sensors show without noise, shapes (n, m)."""
    n, draws = record.time.size, control.shape[1]
    mean = np.full((n, len(likelihood.channels)), np.nan)
    motion = mean.copy()
    length = bucket_length(max(end - begin for begin, end in stretches) + 1)
    at_once = max(1, min(len(stretches), LANES // draws))
    run = _program_of(likelihood)
    for first in range(0, len(stretches), at_once):
        some = list(stretches[first : first + at_once])
        some += some[-1:] * (at_once - len(some))
        rows = np.array([np.minimum(begin + np.arange(length), end) for begin, end in some])
        inside = np.array([begin + np.arange(length) < end for begin, end in some])
        own = {
            name: column[np.minimum(first + np.arange(at_once), len(stretches) - 1)] if column.ndim == 2 else
            np.broadcast_to(column, (at_once, draws))
            for name, column in values.items()
        }
        data = TrialData(
            tuple(one[:, rows].transpose(1, 0, 2) for one in control),
            (),
            np.where(inside, record.step[rows], 0.0),
            starts[np.minimum(first + np.arange(at_once), len(stretches) - 1)],
        )
        shown, spread = run(own, data, jax.random.fold_in(key, first))
        for index, (begin, end) in enumerate(some):
            mean[begin + 1 : end + 1] = np.asarray(shown)[index, 1 : end - begin + 1]
            motion[begin + 1 : end + 1] = np.asarray(spread)[index, 1 : end - begin + 1]
    return mean, motion


@lru_cache(maxsize=16)
def _program_of(likelihood: OutputError | FilterError):
    """Return the compiled function of values (stretches, draws), data of the stretches, and a key: moments over draws, (stretches, n, m)."""

    @program
    def of_stretches(values: Mapping[str, jax.Array], data: TrialData, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        draws = jax.tree.leaves(values)[0].shape[1]
        keys = jax.random.split(key, (data.step.shape[0], draws))

        def of_draw(values: Mapping[str, jax.Array], control: tuple, step: jax.Array, start: jax.Array, key: jax.Array):
            one = TrialData(tuple(column[None] for column in control), (), step[None], start[None])
            return motions(likelihood, values, one, key)[0]

        def of_stretch(values: Mapping[str, jax.Array], data: TrialData, keys: jax.Array):
            return jax.vmap(of_draw, (0, 0, None, None, 0))(values, data.control, data.step, data.initial, keys)

        shown = jax.vmap(of_stretch)(values, data, keys)
        return jnp.mean(shown, 1), jnp.std(shown, 1)

    return of_stretches
