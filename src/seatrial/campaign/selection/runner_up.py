"""The two most probable structures side by side: what choosing between them changes in motion, and which trial would decide."""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.design.problem import applied_controls
from seatrial.campaign.design.sweep import design_key, design_next
from seatrial.campaign.inference.estimate import estimate_all
from seatrial.campaign.inference.posterior import build_posterior, shared_model
from seatrial.campaign.prior.predictive import speeds
from seatrial.campaign.store.estimates import Estimate, HasKey, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.signals import GAUGE_CHANNELS, RATES
from seatrial.design.sweep import Sweep, in_blocks
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.unknowns import may_differ
from seatrial.estimation.prediction.prediction import noise_sd, slow_noise
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.estimation.simulation.simulator import Simulator
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.manoeuvres.family import design_words
from seatrial.selection.contenders import Contenders, SpeedDifference, largest_of
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection
from seatrial.vehicles.model import VehicleModel

# Motions of two contending structures: by how much their speeds differ, and what evidence a trial is expected to
# bring.
#
# Where one structure makes the data, the other follows them as well as re-fitting allows. With the difference d of the predicted
# measurements and the sensitivities J of the structure that re-fits, both over the noise, the log Bayes factor is about
# |d - J J+ d|^2 / 2, J+ the pseudo-inverse: what no change of its parameters absorbs. Of nested structures the smaller one re-fits,
# since the larger can always follow it; of others either does, and the smaller number counts.

DRAWS, POINTS = 100, 400  # Draws of each posterior behind a band, and points of a curve, at most
BAND = (0.05, 0.95)
DEPENDENT = 1e-9  # Share of a sensitivity that has to be its own for it to count beside the others


def compare_speeds(
    campaign: Campaign, best: Estimate, runner: Estimate, trials: Trials, sweep: Sweep
) -> tuple[str, list[SpeedDifference]]:
    """Compare a velocity over the inputs of each fitted record, and then over the best design from trim.

    It is the one that differs most, over the noise of its sensor, and is named; or the leading one if none is measured.

    Args:
        campaign: configuration.
        best: posterior of one structure.
        runner: posterior of the other.
        trials: records.
        sweep: designs of the next trial.

    Raises:
        NumericalError: a structure runs away at its posterior mean.
    """
    sensors = {sensor.channel: sensor for sensor in campaign.sensor_models}
    channels = [name for name in sensors if name in RATES] or [
        leading_channel(campaign.model(campaign.full), campaign.channels)
    ]
    pairs = zip(
        _speeds(campaign, best, trials, sweep, channels),
        _speeds(campaign, runner, trials, sweep, channels),
        strict=True,
    )
    runs = [(time, mine, other) for (time, mine), (_, other) in pairs]
    control = sweep.family.control
    commands = {f"run {record.label}": record.channel(control) for record in trials.fit}
    commands[NEXT] = sweep.best_manoeuvre().sample(sweep.family.sample_time)[1]
    driven = [(words, float(np.nanstd(command))) for words, command in commands.items()]
    speeds = [
        [_difference(*which, time, a[..., i], b[..., i]) for which, (time, a, b) in zip(driven, runs, strict=True)]
        for i in range(len(channels))
    ]
    noise = [noise_of(campaign, sensors[name], best) if name in sensors else 1.0 for name in channels]
    most = np.argmax([max(one.largest for one in each) / own for each, own in zip(speeds, noise, strict=True)])
    return channels[most], speeds[most]


def expected_nats(
    campaign: Campaign, best: Estimate, runner: Estimate, trials: Trials, sweep: Sweep
) -> Float[np.ndarray, "A P"]:
    """Expected log Bayes factor between two structures for every design of a grid, NaN if it breaks a limit."""
    a, b = set(best.structure.terms), set(runner.structure.terms)
    pairs = [(runner, best)] if a < b else [(best, runner)] if b < a else [(best, runner), (runner, best)]
    every = campaign.control_trim(campaign.model(campaign.full))
    (rows, columns, commands), time = sweep.inside(every), sweep.family.time()
    controls = _applied(campaign, best, commands, campaign.full)
    nats = np.full(sweep.gain.shape, np.nan)
    nats[rows, columns] = np.min(
        [_nats(campaign, best, truth, other, trials, time, controls) for truth, other in pairs], axis=0
    )
    return nats


def absorbed(difference: Float[Array, " n"], sensitivities: Float[Array, "n k"]) -> Float[Array, " n"]:
    """What is left of a difference after least squares on sensitivities, those that say the same counted once.

    By Gram and Schmidt, each column cleared twice of those before it: plain arithmetic, which many threads may run at once.
    """
    basis, rest = [], difference
    for column in sensitivities.T:
        size = jnp.linalg.norm(column)
        left = column / jnp.where(size > 0, size, 1.0)
        for _ in range(2):
            for q in basis:
                left = left - (q @ left) * q
        size = jnp.linalg.norm(left)
        q = jnp.where(size > DEPENDENT, left / jnp.where(size > 0, size, 1.0), 0.0)
        rest = rest - (q @ rest) * q
        basis.append(q)
    return rest


def noise_of(campaign: Campaign, sensor: Sensor, estimate: Estimate) -> float:
    """Return the standard deviation of a sensor's residuals about what it shows at trim, SI: its posterior mean."""
    shown = campaign.channel_trim.get(sensor.channel, 0.0)
    return float(noise_sd(sensor, _noise_draws(campaign, sensor, estimate), shown).mean())


def leading_channel(model: VehicleModel, channels: Sequence[str]) -> str:
    """Return the channel to show if it is the only one: surge speed, or the first state; of a held vehicle, that of the first sensor."""
    if GAUGE_CHANNELS[0] in model.outputs:
        return channels[0]
    return "u" if "u" in model.states else model.states[0]


def _speeds(
    campaign: Campaign, estimate: Estimate, trials: Trials, sweep: Sweep, channels: Sequence[str]
) -> list[tuple[Float[np.ndarray, " n"], Float[np.ndarray, "d n m"]]]:
    """Time and velocities of each manoeuvre; of the posterior mean in row 0, of draws in the others."""
    model, table = shared_model(campaign, estimate.structure), estimate.draws()
    draws = table[:: max(1, len(table) // DRAWS)][:DRAWS]
    values = dict(zip(estimate.names, np.vstack([table.mean(axis=0), draws]).T, strict=True))
    output, data = _output(campaign, estimate, trials)
    apart, starts = _apart_and_starts(output, values, data)
    here = [{**values, **{name: np.asarray(c)[:, i] for name, c in apart.items()}} for i in range(len(trials.fit))]
    trim = np.tile(campaign.state_trim(model), (1 + len(draws), 1))
    runs = [
        (one, np.asarray(starts)[:, i], record.time, np.column_stack([record.channel(name) for name in model.controls]))
        for i, (one, record) in enumerate(zip(here, trials.fit, strict=True))
    ]
    all_speeds = []
    controls = sweep.best_controls(campaign.control_trim(model))[None]
    designed = sweep.family.time(), _applied(campaign, estimate, controls, estimate.structure)[0]
    absent = np.zeros(len(trim))
    for one, start, time, control in [*runs, (values, trim, *designed)]:
        next_one = {name: one.get(name, one.get(campaign.in_next_trial(name), absent)) for name in may_differ(model)}
        params = {name: np.asarray(value) for name, value in next_one.items()}
        delay = np.asarray(one["delay"]) if campaign.has_delay else None
        step = np.append(np.diff(time), 0.0)
        speed, lost = speeds(model, channels, params, delay, start, control, step, range(time.size))
        if lost[0]:
            raise NumericalError(
                f"{estimate.structure.label} diverges at its posterior mean, so its motion cannot be compared: "
                "look at its posterior in the report"
            )
        all_speeds.append((time, np.where(lost[:, None, None], np.nan, speed)))
    return all_speeds


def _applied(campaign: Campaign, estimate: Estimate, commands: np.ndarray, structure: Structure) -> np.ndarray:
    """Return the controls under some designs, as an autopilot makes them for the posterior mean; terms that it has not are 0."""
    model = campaign.model(structure)
    mean = dict(zip(estimate.names, estimate.draws().mean(0), strict=True))
    values = np.array([mean.get(campaign.in_next_trial(term.text), 0.0) for term in model.coefficients])
    return applied_controls(campaign, model, values, commands)


@program(static_argnums=0)
def _apart_and_starts(output: OutputError, values: dict[str, Array], data: TrialData) -> tuple[dict[str, Array], Array]:
    """Return what differs between trials, and where each begins, of every draw."""
    return jax.vmap(lambda one: (output.apart(one), output.starts(one, data)))(values)


def _difference(
    words: str, excitation: float, time: np.ndarray, best: np.ndarray, runner: np.ndarray
) -> SpeedDifference:
    excess, keep = best - runner, np.unique(np.linspace(0, time.size - 1, min(time.size, POINTS)).round().astype(int))
    lower, upper = np.nanquantile(excess[1:, keep], BAND, axis=0)
    mean = excess[0]
    return SpeedDifference(
        words,
        excitation,
        time[keep],
        best[0, keep],
        mean[keep],
        lower,
        upper,
        float(np.abs(mean).max()),
        float(np.sqrt((mean**2).mean())),
    )


def _nats(
    campaign: Campaign,
    best: Estimate,
    truth: Estimate,
    other: Estimate,
    trials: Trials,
    time: np.ndarray,
    controls: np.ndarray,
) -> np.ndarray:
    """What each control, one a row, is expected to tell where `truth` makes the data and `other` re-fits."""
    simulators = [_output(campaign, estimate, trials)[0].simulator for estimate in (truth, other)]
    step, mask = float(time[1] - time[0]), campaign.measured_mask(time)
    samples = tuple(np.flatnonzero(mask[:, c]) for c in range(mask.shape[1]))
    noise = np.array([noise_of(campaign, sensor, best) for sensor in campaign.sensor_models])
    memory = [
        _memory(campaign, sensor, best, step * (at[1] - at[0]))
        for sensor, at in zip(campaign.sensor_models, samples, strict=True)
    ]
    start = np.array(campaign.state_trim(campaign.model(best.structure)))
    every = campaign.model(campaign.full).controls
    places = [tuple(every.index(name) for name in simulator.model.controls) for simulator in simulators]
    fit = *simulators, *places, campaign.estimation.initial != "trim"
    values = _of_new_trial(campaign, truth), _of_new_trial(campaign, other)
    fixed = *values, start, np.full(time.size, step), samples, noise, np.array(memory)
    return in_blocks(lambda control: (_follow(*fit, control, *fixed),), controls)[0]


@program(static_argnums=(0, 1, 2, 3, 4))
def _follow(
    truth: Simulator,
    other: Simulator,
    drives: tuple[int, ...],
    follows: tuple[int, ...],
    free_start: bool,
    controls: Array,
    made_by: dict,
    known: dict,
    start: Array,
    step: Array,
    samples: tuple,
    noise: Array,
    memory: Array,
) -> Array:
    """Half the squared residual that is left when `other` follows `truth`, over a batch of all controls.

    `drives` are the places of those of `truth` among them, `follows` of those of `other`.
    """

    def one(control: Array) -> Array:
        def white(outputs: Array) -> Array:
            columns = [outputs[at, c] / noise[c] for c, at in enumerate(samples)]
            later = [
                (column[1:] - rho * column[:-1]) / jnp.sqrt(1.0 - rho * rho)
                for column, rho in zip(columns, memory, strict=True)
            ]
            return jnp.concatenate(
                [piece for column, rest in zip(columns, later, strict=True) for piece in (column[:1], rest)]
            )

        vector, back = ravel_pytree((known, start))

        def follow(vector: Array) -> tuple[Array, Array]:
            values, begin = back(vector)
            shown = white(other.outputs(values, begin, tuple(control[:, i] for i in follows), step))
            return shown, shown

        sensitivities, shown = jax.jacfwd(follow, has_aux=True)(vector)
        free = sensitivities if free_start else sensitivities[:, : vector.size - start.size]
        made = truth.outputs(made_by, start, tuple(control[:, i] for i in drives), step)
        rest = absorbed(white(made) - shown, free)
        return 0.5 * (rest @ rest)

    return jax.vmap(one)(controls)


def _output(campaign: Campaign, estimate: Estimate, trials: Trials) -> tuple[OutputError, TrialData]:
    posterior = build_posterior(campaign, estimate.structure, trials.fit)
    return posterior.likelihood.output, posterior.data


def _of_new_trial(campaign: Campaign, estimate: Estimate) -> Mapping[str, np.ndarray]:
    """Posterior means of what all trials share; of what each has its own, the mean over the fitted ones."""
    means = dict(zip(estimate.names, estimate.draws().mean(axis=0), strict=True))
    shared = {name: value for name, value in means.items() if "[" not in name}
    for name in campaign.by_configuration(campaign.model(estimate.structure)):
        shared[name] = shared[campaign.in_next_trial(name)]
    for name in campaign.own:
        shared[name] = np.mean([value for one, value in means.items() if one.split("[")[0] == name])
    return {name: np.asarray(value) for name, value in shared.items()}


def _memory(campaign: Campaign, sensor: Sensor, estimate: Estimate, gap: float) -> float:
    """Correlation of one sample's noise with the next one's."""
    slow = slow_noise(sensor, _noise_draws(campaign, sensor, estimate))
    return slow.share * float(np.exp(-gap / slow.time)) if slow else 0.0


def _noise_draws(campaign: Campaign, sensor: Sensor, estimate: Estimate) -> dict[str, np.ndarray]:
    """Return the draws of what is unknown about a sensor in all trials alike, as its noise is."""
    return {name: estimate.draws([name])[:, 0] for name in sensor.parameters if name not in campaign.own}


NEXT = "the next trial"


def contending(selection: Selection) -> tuple[Structure, ...]:
    """The two most probable structures, the best first; fewer where there are not two."""
    order = np.argsort(-selection.probability, kind="stable")[:2]
    return tuple(selection.structures[index] for index in order)


def find_contenders(
    campaign: Campaign, selection: Selection, trials: Trials, reporter: Reporter = SILENT
) -> Contenders | None:
    """Estimate the two contenders where that has not been done, and compare them; None of one structure, or where no trial is designed."""
    pair = contending(selection)
    if len(pair) < 2 or campaign.trial_design is None:
        return None
    best, runner = estimate_all(campaign, trials, reporter, pair)
    sweep = design_next(campaign, best, reporter).best

    def compute() -> Contenders:
        progress = reporter.progress("compare the best structure with the runner-up")
        progress(0, 1)
        contenders = _compare(campaign, best, runner, trials, sweep)
        progress(1, 1)
        return contenders

    return stored_contenders(campaign, best, runner, trials).read_or_make(compute)


def stored_contenders(
    campaign: Campaign, best: OfStructure, runner: OfStructure, trials: HasKey
) -> StoredResult[Contenders]:
    """Return where the comparison of two structures is kept, and what it depends on."""
    key = key_of("contenders", design_key(campaign), best.key, runner.key, trials.key)
    return StoredResult(Store(campaign.folder).contenders, key, Contenders, f"seatrial select {campaign.folder}")


def _compare(campaign: Campaign, best: Estimate, runner: Estimate, trials: Trials, sweep: Sweep) -> Contenders:
    channel, manoeuvres = compare_speeds(campaign, best, runner, trials, sweep)
    sensor = next((one for one in campaign.sensor_models if one.channel == channel), None)
    nats = expected_nats(campaign, best, runner, trials, sweep)
    row, column = largest_of(nats)
    return Contenders(
        best=best.structure,
        runner_up=runner.structure,
        channel=channel,
        noise=float("nan") if sensor is None else noise_of(campaign, sensor, best),
        manoeuvres=tuple(manoeuvres),
        amplitude=sweep.amplitude,
        period=sweep.period,
        expected_nats=nats,
        trial=design_words(sweep.family, float(sweep.amplitude[row]), float(sweep.period[column])),
    )
