"""A posterior in the form that ArviZ and its plots read: an xarray DataTree with groups, coordinates and units.

Groups are those of the InferenceData schema: `posterior`, `sample_stats`, `observed_data`, `constant_data`, `posterior_predictive`,
`log_likelihood`.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np

from seatrial.campaign.store.estimates import Estimate
from seatrial.core.argument_checks import check_count, check_each_of, check_kind
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.pointwise import pointwise_log_likelihood
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.prediction.prediction import replicate_record
from seatrial.sampling.run import Draws

if TYPE_CHECKING:
    from xarray import DataArray, DataTree


def to_arviz(
    result: Draws | Estimate,
    posterior: Posterior | None = None,
    records: Record | Sequence[Record] = (),
    *,
    start: Mapping[str, float] | None = None,
    n: int = 200,
    key: jax.Array | int = 0,
    log_likelihood: bool = False,
) -> "DataTree":
    """Return a tree that ArviZ reads.

    `posterior` has a variable for each parameter, `sample_stats` has `lp`, both on `chain` and `draw`. With a posterior and records
    there are `observed_data`, `constant_data` (the controls) and `posterior_predictive`, whose variables are named as `u[trial]`, each
    on a time of its own, s, and, if asked for, `log_likelihood`, which ArviZ's `loo` needs. Every variable tells its SI unit in
    `attrs`. Means over all chains, such as the acceptance, are attributes of `sample_stats`.

    Args:
        result: draws of `sample`, or an estimate of a campaign.
        posterior: that was drawn from, of `make_posterior`.
        records: that it predicts, with noise, each from draws spread evenly over the chains.
        start: state at the first sample of each record, as in `predict`.
        n: draws that predict, and under which the log density of each measurement is computed, about.
        key: random key, or a seed.
        log_likelihood: whether to add the log density of each measurement, nats; the records are then those that were fitted, and
            their residuals white or heavy-tailed.

    Raises:
        InputError: records without the posterior, as `predict`, or measurements whose log density cannot be given.
    """
    from xarray import Dataset, DataTree

    names, units, values, log_density, told = _parts(result)
    check_count(n, "n", remedy="take a hundred draws or more")
    at = {"chain": np.arange(values.shape[0]), "draw": np.arange(values.shape[1])}
    drawn = {name: _variable(values[..., i], at, units[i]) for i, name in enumerate(names)}
    groups = {
        "posterior": Dataset(drawn, attrs={"inference_library": "seatrial"}),
        "sample_stats": Dataset({"lp": _variable(log_density, at, "nat")}, attrs=told),
    }
    listed = [records] if isinstance(records, Record) else records
    given = check_each_of(listed, Record, "records", "give one Record, or a list of them")
    if not given and not log_likelihood:
        return DataTree.from_dict(groups)
    if posterior is None or not given or not isinstance(result, Draws):
        raise InputError(
            "posterior" if given else "log_likelihood",
            found="no records" if not given else "records alone" if posterior is None else "an estimate of a campaign",
            expected="draws, the posterior they were drawn from, and records",
            remedy="write to_arviz(draws, posterior, records), or leave "
            + ("the records out" if given else "log_likelihood out"),
        )
    chains, kept = result.log_density.shape
    places = np.arange(0, kept, max(1, kept * chains // n))
    if log_likelihood:
        groups["log_likelihood"] = Dataset(_log_likelihood(result, posterior, given, places))
    for record in given:
        for group, variables in _of_record(result, posterior, record, start, places, key).items():
            groups[group] = groups.get(group, Dataset()).assign(variables)
    return DataTree.from_dict(groups)


def _parts(result: Draws | Estimate) -> tuple[Sequence[str], Sequence[str], np.ndarray, np.ndarray, dict]:
    """Return names, units, values (chains, draws, d), log densities, and what is told of all chains together."""
    if isinstance(result, Estimate):
        data = result.data
        units = [str(unit) for unit in data["unit"].values]
        values = data["draws"].transpose("chain", "draw", "parameter").values
        told = {"acceptance_rate": float(data.attrs["acceptance"])}
        return result.names, units, values, data["log_density"].transpose("chain", "draw").values, told
    check_kind(result, Draws, "result", "draw with `sample`, or give an estimate of a campaign")
    told = {"acceptance_rate": result.acceptance, "divergences": result.divergences}
    return result.names, result.units, result.values, result.log_density, told


def _of_record(
    draws: Draws,
    posterior: Posterior,
    record: Record,
    start: Mapping[str, float] | None,
    places: np.ndarray,
    key: jax.Array | int,
) -> "dict[str, dict[str, DataArray]]":
    """Return the variables of one record by group: each channel at the times at which it was measured, and the controls."""
    chains, few = draws.log_density.shape[0], draws.thinned(places)
    shown = replicate_record(posterior, few, record, start=start, n=few.log_density.size, key=key)
    shown = shown.reshape(chains, places.size, *shown.shape[1:])
    found: dict[str, dict[str, DataArray]] = {"observed_data": {}, "constant_data": {}, "posterior_predictive": {}}
    for column, channel in enumerate(posterior.likelihood.channels):
        measured, name = record.channel(channel), f"{channel}[{record.label}]"
        there = np.isfinite(measured)
        at = {f"time_{name}": record.time[there]}
        unit = signal_unit(channel)
        found["observed_data"][name] = _variable(measured[there], at, unit)
        over = {"chain": np.arange(chains), "draw": places, **at}
        found["posterior_predictive"][name] = _variable(shown[..., there, column], over, unit)
    for control in record.controls:
        name = f"{control}[{record.label}]"
        at = {f"time_{name}": record.time}
        found["constant_data"][name] = _variable(record.channel(control), at, signal_unit(control))
    return found


def _log_likelihood(
    draws: Draws, posterior: Posterior, records: Sequence[Record], places: np.ndarray
) -> "dict[str, DataArray]":
    """Return the log density of each measurement of the fitted records, nats, by channel and record."""
    table = pointwise_log_likelihood(posterior, draws.thinned(places).values)
    over = {"chain": np.arange(table.shape[0]), "draw": places}
    given, found, begin = {record.label: record for record in records}, {}, 0
    for trial, label in enumerate(posterior.likelihood.labels):
        for channel, shown in zip(posterior.likelihood.channels, posterior.data.channels, strict=True):
            fitted = np.asarray(shown.measured[trial])[np.asarray(shown.present[trial]) > 0]
            end = begin + fitted.size
            if label in given:
                record, name = given[label], f"{channel}[{label}]"
                measured = record.channel(channel)
                there = np.isfinite(measured)
                if not np.array_equal(measured[there], fitted):
                    raise _not_fitted(f'another "{name}" than was fitted', posterior)
                at = {**over, f"time_{name}": record.time[there]}
                found[name] = _variable(table[..., begin:end], at, "nat")
            begin = end
    if other := [label for label in given if label not in posterior.likelihood.labels]:
        raise _not_fitted(f'"{other[0]}", which was not fitted', posterior)
    return found


def _not_fitted(found: str, posterior: Posterior) -> InputError:
    return InputError(
        "records, with log_likelihood",
        found=found,
        expected="records that were fitted: " + ", ".join(posterior.likelihood.labels),
        remedy="give those of `make_posterior`, or leave log_likelihood out",
    )


def _variable(values: np.ndarray, at: Mapping[str, np.ndarray], unit: str) -> "DataArray":
    from xarray import DataArray

    return DataArray(values, dict(at), tuple(at), attrs={"units": unit})
