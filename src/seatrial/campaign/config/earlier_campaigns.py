"""Priors that a campaign does not write out: of published coefficients, and of campaigns that came before it.

A staged plan is a chain of campaigns, surge before heave and pitch, say: what an earlier one found is a normal prior where it is sought
again, and fixed where it is not. Their correlations are left behind. Records that an earlier stage was fitted to must not be
fitted again with its result as prior: they would count twice.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import NamedTuple

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.named_files import find
from seatrial.campaign.config.schema import CampaignFile, PriorTable
from seatrial.campaign.config.templates import example_of
from seatrial.campaign.config.toml import FileKeys, parse_toml, read_text
from seatrial.campaign.config.vehicle_table import UNKNOWN, VehicleTable
from seatrial.campaign.store.estimates import StoredMode
from seatrial.campaign.store.stored_result import FILE_NAME, Store, read_result
from seatrial.campaign.store.summary import Summary
from seatrial.core.coefficients import CoefficientName, base_name, configuration_of
from seatrial.core.errors import InputError
from seatrial.core.files import is_there
from seatrial.core.signals import signal_unit
from seatrial.estimation.priors import physical_support

# Correlation, either way, from which its loss is told: the best-known combination had 0.55 of the spread that it has
# without it.
STRONG = 0.7
# Mean and standard deviation of coefficients and of a vehicle's other unknowns, SI.
Found = Mapping[str, tuple[float, float]]


def found_before(folder: Path, table: VehicleTable, keys: FileKeys) -> Found:
    """Return what earlier campaigns found of every coefficient and every other unknown of the vehicle; the last one counts.

    That is the result of the finished run, or the posterior mode if there is none.

    Args:
        folder: of this campaign.
        table: `[vehicle]`, which names the folders of the others.
        keys: of the file.

    Raises:
        InputError: an earlier campaign that is not there or has no results, one of another trim, or one in which a coefficient differs
            between configurations.
    """
    estimates: dict[str, tuple[float, float]] = {}
    where = keys.where("vehicle.priors_from")
    for item in table.priors_from:
        earlier = _earlier(folder, item, where)
        if any(CoefficientName.parse(name).trim_signals for name in earlier.terms):
            _check_trim(find(folder, str(Path(item) / FILE_NAME), where), earlier.terms, table, where)
        if differing := [n for n in earlier.found if configuration_of(n) and base_name(n) in earlier.terms]:
            raise InputError(
                where,
                found=f"{item}, in which {base_name(differing[0])} differs between configurations: {', '.join(differing)}",
                expected="a campaign with one value of each coefficient",
                remedy="fit its records here too, or write the priors of these coefficients from its report, without priors_from",
            )
        estimates |= {n: pair for n, pair in earlier.found.items() if n in earlier.terms or UNKNOWN.fullmatch(n)}
    return estimates


def lost_correlations(campaign: Campaign) -> list[str]:
    """Return which priors were taken from an earlier campaign that found them strongly correlated, and what that does."""
    lines = []
    for item in campaign.priors_from:
        earlier = _earlier(campaign.folder, item, campaign.where("vehicle.priors_from"))
        taken = {
            n for n, (mean, _) in earlier.found.items() if n in campaign.priors and campaign.priors[n].mean == mean
        }
        lines += [
            f"priors_from {item}: {first} and {second} were found with a correlation of {r:+.2f}, but their priors here have none, so "
            f"their combination is less certain here. If that matters, fit both records in one campaign"
            for first, second, r in earlier.correlated
            if {first, second} <= taken
        ]
    return lines


class _Earlier(NamedTuple):
    """What one earlier campaign found.

    Attributes:
        terms: of its structure.
        found: value and standard deviation of every parameter, SI.
        correlated: pairs of parameters with a correlation of `STRONG` or more, either way, and the correlation.
    """

    terms: tuple[str, ...]
    found: Found
    correlated: tuple[tuple[str, str, float], ...]


def _earlier(folder: Path, item: str, where: str) -> _Earlier:
    """Read the finished run of an earlier campaign, or its posterior mode if there is none.

    Raises:
        InputError: it is not there, or has neither.
    """
    there = find(folder, item, where)
    store = Store(there)
    if not there.is_dir():
        raise InputError(
            where,
            found=f"the file {item}",
            expected="the folder of a finished campaign, relative to the folder of this one",
            remedy="correct the path",
        )
    result = next((path for path in (store.summary, store.mode) if is_there(path)), None)
    if result is None:
        raise InputError(
            where,
            found=f"{item}, a campaign without a finished run and without a posterior mode",
            expected="one of them, with the mean and standard deviation of each coefficient",
            remedy=f"run `seatrial run {there}`, or `seatrial estimate {there} --by mode` for a first answer",
        )
    find(folder, str(Path(item) / result.relative_to(there)), where)  # a link may lead outside
    if result == store.mode:
        mode = read_result(StoredMode, result, f"seatrial estimate {there} --by mode")
        return _Earlier(mode.terms, mode.found, _strong(mode.correlations))
    summary = read_result(Summary, result, f"seatrial run {there}")
    pairs = ((one.name, one.partner, one.correlation) for one in summary.known.parameters if one.partner)
    return _Earlier(summary.terms, {row.name: (row.mean, row.sd) for row in summary.coefficients}, _strong(pairs))


def _strong(pairs: Iterable[tuple[str, str, float]]) -> tuple[tuple[str, str, float], ...]:
    """Return the strongly correlated pairs, each once."""
    kept = {frozenset((a, b)): (a, b, r) for a, b, r in pairs if abs(r) >= STRONG}
    return tuple(kept.values())


def _check_trim(path: Path, terms: Sequence[str], table: VehicleTable, where: str) -> None:
    """Check that terms which are changes from trim, such as T_fdV, have one trim here and in the earlier file."""
    trim = parse_toml(path, read_text(path), CampaignFile, example_of).vehicle.trim
    for name in terms:
        for signal in CoefficientName.parse(name).trim_signals:
            before = trim.get(signal)
            now, unit = table.trim.get(signal), signal_unit(signal)
            here, there = ("nothing" if one is None else f"{one:g} {unit}" for one in (now, before))
            if now is None or before is None or now != before:
                raise InputError(
                    where,
                    found=f"{name} about {signal} = {there}, and here a trim of {here}",
                    expected="the same trim: the coefficient refers to it, and so do others, such as T_f with T_fdV",
                    remedy=f'give trim = {{ {signal} = "{there}" }} to [vehicle] here'
                    if before is not None
                    else "give it in both",
                )


def unknowns_before(found: Found) -> dict[str, PriorTable]:
    """Return the priors of what no coefficient is: of a gain, a share, a lag or a tether log-normal, of what may have either sign normal.

    Args:
        found: by earlier campaigns.
    """
    return {
        name: PriorTable(distribution="log-normal", median=mean, factor=1.0 + sd / mean)
        if name.startswith(("gain_", "reverse_", "dead_", "lag_", "tether_")) and mean > 0
        else PriorTable(distribution="normal", mean=mean, sd=sd)
        for name, (mean, sd) in found.items()
        if UNKNOWN.fullmatch(name)
    }


def with_fixed(table: VehicleTable, found: Found, terms: Sequence[str]) -> VehicleTable:
    """Return `[vehicle]` with what earlier campaigns found and this one does not seek fixed."""
    sought = {CoefficientName.parse(term) for term in terms}
    fixed = {
        name: mean
        for name, (mean, _) in found.items()
        if not UNKNOWN.fullmatch(name) and CoefficientName.parse(name) not in sought
    }
    return table.model_copy(update={"fixed": {**fixed, **table.fixed}}) if fixed else table


def with_known(
    tables: Mapping[str, PriorTable],
    found: Found,
    published: Mapping[str, float],
    published_prior_sd: float | None,
    keys: FileKeys,
    terms: Sequence[str],
) -> dict[str, PriorTable]:
    """Return the tables of priors, with one for each coefficient that is known from elsewhere and has none.

    Args:
        tables: as written.
        found: by earlier campaigns.
        published: coefficients of the vehicle, SI.
        published_prior_sd: share to which those are believed; None if they are not.
        keys: of the file.
        terms: to estimate.

    Raises:
        InputError: a share that is not positive, a published value of zero, or none that a prior could be made of.
    """
    sought = {CoefficientName.parse(term): CoefficientName.parse(term).text for term in terms}
    priors = dict(tables)
    for name, (mean, sd) in found.items():
        if UNKNOWN.fullmatch(name):
            continue
        text = sought.get(CoefficientName.parse(name))
        if text is not None and text not in priors:
            priors[text] = PriorTable(distribution="normal", mean=mean, sd=sd)
    if published_prior_sd is None:
        return priors
    before = len(priors)
    for name, value in published.items():
        text = sought.get(CoefficientName.parse(name))
        if text is not None and text not in priors:
            priors[text] = _about(keys, published_prior_sd, text, value)
    if len(priors) == before:
        raise InputError(
            keys.where("vehicle.published_prior_sd"),
            found="a key without effect: each estimated coefficient has a prior here or is not published",
            expected="keys that have an effect",
            remedy="remove it, or the priors that it replaces",
        )
    return priors


def _about(keys: FileKeys, share: float, name: str, value: float) -> PriorTable:
    """Return the prior of a published coefficient, cut where damping would drive the vehicle unless the published value does."""
    if not (0 < share < 10 and value != 0):
        raise InputError(
            keys.where("vehicle.published_prior_sd"),
            found=f"{100 * share:g} % of {name} = {value:g}",
            expected="a positive share of a value that is not zero",
            remedy=f'for example "30 %", and [prior.{name}] for each coefficient that is not published',
        )
    has_side = value < 0 and physical_support(CoefficientName.parse(name), inf) is not None
    return PriorTable(distribution="normal", mean=value, sd=share * abs(value), dissipative=has_side)
