"""Priors that a campaign does not write out: of published coefficients, and of campaigns that came before it.

A staged plan is a chain of campaigns, surge before heave and pitch, say: what an earlier one found is a normal prior where it is sought
again, and fixed where it is not. Their correlations are left behind. Records that an earlier stage was fitted to must not be
fitted again with its result as prior: they would count twice.
"""

from dataclasses import replace
from pathlib import Path

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.named_files import find
from seatrial.campaign.config.schema import PriorTable
from seatrial.campaign.store.files import Store
from seatrial.campaign.store.structures import read_summary
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError


def with_earlier(campaign: Campaign) -> Campaign:
    """The campaign with those priors and values written out, so that every key of its results knows them.

    Raises:
        InputError: an earlier campaign without results, a share that is not positive, or a published value of zero.
    """
    vehicle, found = campaign.source.vehicle, _found_before(campaign)
    sought = {CoefficientName.parse(term): CoefficientName.parse(term).text for term in campaign.full.terms}
    priors, fixed = dict(campaign.source.prior), {}
    for name, (mean, sd) in found.items():
        text = sought.get(CoefficientName.parse(name))
        if text is None:
            fixed[name] = mean
        elif text not in priors:
            priors[text] = PriorTable(distribution="normal", mean=mean, sd=sd)
    if vehicle.published_to is not None:
        before = len(priors)
        for name, value in campaign.vehicle.published.items():
            text = sought.get(CoefficientName.parse(name))
            if text is not None and text not in priors:
                priors[text] = _about(campaign, vehicle.published_to, text, value)
        if len(priors) == before:
            raise InputError(
                campaign.where("vehicle.published_to"),
                found="a key without effect: no coefficient that is sought is both published and without a prior of its own",
                expected="keys that something reads",
                remedy="remove it, or the priors that it is to stand for",
            )
    if priors == campaign.source.prior and not fixed:
        return campaign
    known = vehicle.model_copy(update={"fixed": {**fixed, **vehicle.fixed}}) if fixed else vehicle
    return replace(campaign, source=campaign.source.model_copy(update={"prior": priors, "vehicle": known}))


def _found_before(campaign: Campaign) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of every coefficient that earlier campaigns found, SI; the last one counts."""
    found = {}
    for item in campaign.source.vehicle.known_from:
        where = campaign.where("vehicle.known_from")
        folder = find(campaign.folder, item, where)
        store = Store(folder)
        if not folder.is_dir():
            raise InputError(
                where,
                found=f"the file {item}",
                expected="the folder of a campaign that has been run, relative to this one's folder",
                remedy="correct the path",
            )
        if store.summary.exists():  # a link may lead outside
            find(campaign.folder, str(Path(item) / store.summary.relative_to(folder)), where)
        summary = read_summary(store.summary, f"seatrial run {folder}")
        found |= {row.name: (row.mean, row.sd) for row in summary.coefficients if row.name in summary.terms}
    return found


def _about(campaign: Campaign, text: str | float, name: str, value: float) -> PriorTable:
    share = campaign.si(text, "1", "vehicle.published_to")
    if not (0 < share < 10 and value != 0):
        raise InputError(
            campaign.where("vehicle.published_to"),
            found=f"{text} of {name} = {value:g}",
            expected="a positive share of a value that is not zero",
            remedy=f'for example "30 %", and [prior.{name}] of its own where nothing is published',
        )
    return PriorTable(distribution="normal", mean=value, sd=share * abs(value))
