"""Filter traces: how the square-root UKF's belief about the coefficients narrows along the fitted records."""

import json
from collections.abc import Sequence

import jax
import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import initial_state
from seatrial.campaign.store.estimates import Estimate, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.coefficients import base_name, configuration_of
from seatrial.core.dataset import Dataset
from seatrial.core.display_units import plain
from seatrial.core.record import Record
from seatrial.design.prior_belief import STATE_SD
from seatrial.estimation.priors import Prior, nominal
from seatrial.estimation.simulation.delayed_control import delay_control
from seatrial.filters.run import FilterTrace, run_filter
from seatrial.filters.square_root import unscented_filter
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.discretise import discretise

EXPLAINED = 1.3  # Ratio of the innovations to the fitted noise, or its inverse, up to which that noise explains them


def stored_filter(campaign: Campaign, estimate: OfStructure) -> StoredResult[Dataset]:
    """Return where the traces of the filter are kept, and what they depend on."""
    gained = campaign.process_sds(campaign.model(estimate.structure)).tolist()
    key = key_of("filter", estimate.key, list(campaign.noise.values()), gained)
    return StoredResult(Store(campaign.folder).filter, key, Dataset, f"seatrial run {campaign.folder}")


def trace_filter(campaign: Campaign, estimate: Estimate, trials: Trials) -> Dataset:
    """Run the filter over the fitted records one after another, each beginning with what the last one taught.

    Coefficients start from the mean and standard deviation of their priors; a delay is set to its posterior mean.
    Sensor and process noise are those of the configuration.
    """
    return stored_filter(campaign, estimate).read_or_make(lambda: _traces(campaign, estimate, trials))


def filter_complaints(dataset: Dataset, fitted: Sequence[float] = ()) -> list[str]:
    """What is wrong with the filter's run, in words.

    Args:
        dataset: its traces.
        fitted: noise of each sensor by the fit, over the nominal one; none if it was not fitted.
    """
    lines = []
    if dataset.attrs["failures"] > 0:
        lines.append(
            f"the filter lost a positive covariance at {dataset.attrs['failures']} samples: do not use its traces; narrow the priors or "
            f"raise the sensor noise"
        )
    nis, count = dataset["nis"].values, dataset["n_measured"].values
    ratio = float(nis[count > 0].sum() / max(count.sum(), 1))
    error = np.sqrt(2.0 / max(count.sum(), 1))
    if abs(ratio - 1.0) > max(5.0 * error, 0.2):
        word = "smaller" if ratio < 1 else "larger"
        finding = f"innovations of the filter are {word} than its nominal sensor noise (normalised square {ratio:.2f} instead of 1)"
        beyond = np.sqrt(ratio) / np.exp(np.mean(np.log(fitted))) if fitted else 1.0
        if not 1 / EXPLAINED < beyond < EXPLAINED:
            lines.append(
                f"{finding}, and {plain(beyond)} times those of the fit: the filter is linearised about wide priors, without a fitted "
                "lag or start. Do not use its traces, and do not change [sensors]"
            )
        else:
            times = f"multiply the noise in [sensors] by about {np.sqrt(ratio):.2g}"
            lines.append(f"{finding}: {times}, or expect model error; see `seatrial tuning`")
    return lines


def prior_belief(priors: Sequence[Prior]) -> tuple[Gaussian, np.ndarray]:
    """Belief about coefficients before the first record, in units of their prior standard deviations, and these, SI."""
    scales = np.array([prior.sd for prior in priors])
    return Gaussian(np.array(list(map(nominal, priors))) / scales, np.eye(scales.size)), scales


def filter_record(
    campaign: Campaign, estimate: Estimate, record: Record, belief: Gaussian, scales: np.ndarray
) -> tuple[StateSpace, FilterTrace]:
    """Run the filter along one record.

    Args:
        campaign: configuration, whose sensor and process noise the filter has.
        estimate: of the full structure; a delay is set to its posterior mean.
        record: trial.
        belief: about the coefficients, in units of `scales`.
        scales: SI value of one unit of each coefficient.
    """
    model = campaign.model(estimate.structure)
    d = len(model.states)
    chol = np.zeros((d + scales.size,) * 2)
    chol[range(d), range(d)] = STATE_SD
    chol[d:, d:] = belief.chol_cov
    initial = Gaussian(np.concatenate([initial_state(campaign, model, record), belief.mean]), chol)
    gained = campaign.process_sds(model) * np.sqrt(np.median(record.step)) / np.concatenate([np.ones(d), scales])
    noise = np.array(list(campaign.noise.values()))
    space = discretise(model, campaign.channels, initial, gained, noise, scales.tolist())
    delay = float(estimate.draws(["delay"]).mean()) if campaign.has_delay else 0.0
    control = np.column_stack(
        [np.asarray(delay_control(record.channel(name), delay / record.step[0])) for name in model.controls]
    )
    measured = np.column_stack([record.channel(channel) for channel in campaign.channels])
    return space, run_filter(unscented_filter(len(space.states)), space, control, measured, record.step)


def _traces(campaign: Campaign, estimate: Estimate, trials: Trials) -> Dataset:
    model = campaign.model(estimate.structure)
    names, d = [campaign.in_next_trial(term.text) for term in model.coefficients], len(model.states)
    belief, scales = prior_belief([campaign.priors.get(name) or campaign.prior(base_name(name)) for name in names])
    pieces, failures = [], 0
    # The filter's belief is carried from record to record, so that all have to be of the same configuration.
    chosen = {configuration_of(name) for name in names} - {""}
    records = [record for record in trials.fit if not chosen or record.configuration in chosen]
    for index, record in enumerate(records):
        _, trace = filter_record(campaign, estimate, record, belief, scales)
        belief = jax.device_get(trace.final).marginal(d)
        failures += int(trace.failures)
        pieces.append(
            {
                "time": record.time,
                "record": np.full(record.time.size, index),
                "nis": trace.nis,
                "n_measured": trace.n_measured,
                "mean": np.asarray(trace.means)[:, d:] * scales,
                "sd": np.asarray(trace.sds)[:, d:] * scales,
                "state": np.asarray(trace.means)[:, :d],
                "innovation": trace.innovations,
            }
        )
    columns = {name: np.concatenate([np.asarray(piece[name]) for piece in pieces]) for name in pieces[0]}
    dims = {
        "mean": ("sample", "coefficient"),
        "sd": ("sample", "coefficient"),
        "state": ("sample", "state_name"),
        "innovation": ("sample", "channel"),
    }
    return Dataset(
        {name: (dims.get(name, ("sample",)), values) for name, values in columns.items()},
        coords={"coefficient": names, "state_name": list(model.states), "channel": list(campaign.channels)},
        attrs={
            "failures": failures,
            "records": json.dumps([record.label for record in records]),
            "filter": "square-root UKF",
        },
    )
