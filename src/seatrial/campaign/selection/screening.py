"""Screening of a campaign: every structure that the rules allow, in closed form, and the shortlist that is worth simulating."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import StructureTable
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.inference.quick_estimates import ignored
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.dataset import Dataset
from seatrial.core.errors import InputError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.regression.row_fit import delayed, likely_delay
from seatrial.estimation.regression.weak_form import MIN_WINDOW_STEPS, where_measured
from seatrial.selection.screened import Screened
from seatrial.selection.screening import ModeScreening, Screening, TermPrior, screen, screen_about_mode
from seatrial.selection.structure_prior import log_prior_by_size
from seatrial.selection.structures import count_structures, label_structures
from seatrial.selection.verdict import Shortlist

NARROWEST = 1.0  # Width of the first windows, s; they are doubled until residuals no longer follow one another
_LAYOUT = "with prior and delay"  # What a stored screening has that an older one had not
KEPT = 50  # Structures that are kept, most probable first


def prior_in_key(campaign: Campaign) -> str:
    """Return what the key of a result has for a prior of the structures that is not the usual one."""
    prior = campaign.selection.structure_prior
    return "" if prior == "equal" else f", prior of structures by {prior}"


def stored_screening(campaign: Campaign, trials: HasKey) -> StoredResult[Screened]:
    """Return where the screening is kept, and what it depends on."""
    layout = _LAYOUT + prior_in_key(campaign)
    believed = campaign.structure, campaign.vehicle, campaign.sensors, campaign.mounts, campaign.priors
    path, key = Store(campaign.folder).screening, key_of("screening", layout, trials.key, believed, campaign.seed)
    return StoredResult(path, key, Screened, f"seatrial select {campaign.folder}")


def screen_terms(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> Screened:
    """Screen every structure on the fitted records; a current result is read.

    Raises:
        InputError: a vehicle whose added mass is sought, velocities not measured, records that cannot tell the terms apart, or terms that
            differ between configurations.
    """
    if differing := _differing(campaign):
        raise InputError(
            campaign.where("estimation.by_configuration"),
            found=f"{', '.join(differing)}, with more structures than can be simulated",
            expected="terms that all configurations share, because structures are screened",
            remedy="leave optional terms out, or take these out of by_configuration",
        )

    def compute() -> Screened:
        progress = reporter.progress(f"screen {count_structures(campaign.rules)} structures")
        progress(0, 1)
        coupled = not campaign.vehicle.equations(campaign.full)
        data = (_screen_about_mode if coupled else _screen_rows)(campaign, trials)
        progress(1, 1)
        return Screened(data)

    return stored_screening(campaign, trials).read_or_make(compute)


def can_be_screened(campaign: Campaign) -> bool:
    """Whether there is something to decide, about a vehicle that is linear in its coefficients and whose velocities are measured.

    One whose axes are coupled is screened where it has too many structures to simulate each.
    """
    rates = {equation.rate for equation in campaign.vehicle.equations(campaign.full)}
    if not rates or _differing(campaign):
        return campaign.is_large
    linear = not any(term.is_added_mass for term in campaign.model(campaign.full).coefficients)
    return bool(campaign.rules.optional) and linear and rates <= set(campaign.channels)


def _differing(campaign: Campaign) -> list[str]:
    """Return the terms that differ between configurations, of which a regression of all records knows nothing."""
    return [name for name in campaign.by_configuration(campaign.model(campaign.full)) if name in campaign.full.terms]


def screening_of(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> tuple[Screened | None, list[str]]:
    """The screening, and what it cautions of if structures are chosen by it; where it cannot be had and is not needed, only why.

    Raises:
        InputError: as `screen_terms`, if there are too many structures to do without.
    """
    if not can_be_screened(campaign):
        return None, []
    try:
        screened = screen_terms(campaign, trials, reporter)
    except InputError as error:
        if campaign.is_large:
            raise
        why = f"{error.where}: {error.sentence()}"
        return None, [f"the structures are simulated without a screening in closed form, which failed: {why}"]
    return screened, screened.cautions if campaign.is_large else []


def with_shortlist(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> Campaign:
    """The campaign with what a screening leaves of its structures, if there are too many to simulate each."""
    if campaign.shortlist or not campaign.is_large:
        return campaign
    screened = screen_terms(campaign, trials, reporter)
    best = [screened.terms(rank) for rank in range(min(campaign.structure.shortlist, screened.data.sizes["model"]))]
    order = campaign.full.terms
    sets = [tuple(term for term in order if term in terms) for terms in sorted(best, key=len, reverse=True)]
    return replace(campaign, shortlist=label_structures(sets))


def shortlist_of(campaign: Campaign, trials: Trials) -> Shortlist | None:
    """What the screening says beyond the structures that are simulated; None if all of them are."""
    if not (campaign.is_large and campaign.shortlist):
        return None
    screened = screen_terms(campaign, trials)
    listed = {frozenset(screened.terms(rank)): rank for rank in range(screened.data.sizes["model"])}
    inclusion = {term: float(screened.data["inclusion"].sel(term=term)) for term in screened.optional}
    ranks = [listed[frozenset(one.terms)] for one in campaign.shortlist]
    return Shortlist(inclusion, [float(screened.data["probability"][rank]) for rank in ranks])


def _screen_rows(campaign: Campaign, trials: Trials) -> Dataset:
    """Screen the equations of single axes, by regression rows."""
    equations = campaign.vehicle.equations(campaign.full)
    rates = [equation.rate for equation in equations]
    if missing := [rate for rate in rates if rate not in campaign.channels]:
        raise InputError(
            campaign.where("sensors"),
            found=f"no sensor of {', '.join(missing)}",
            expected="the velocities of the estimated equations, for the rows of a screening",
            remedy=f"map the channel {missing[0]}, or leave at most 64 structures, which need no screening",
        )
    terms = campaign.full.terms
    priors = {name: campaign.prior(name) for name in terms}
    believed = {name: TermPrior(float(prior.mean), float(prior.sd)) for name, prior in priors.items()}
    noise = campaign.noise
    used = [name for equation in equations for name in equation.signals if name in campaign.channels]
    records = [where_measured(record, list(dict.fromkeys([*rates, *used]))) for record in trials.fit]
    slowest = max(float(np.median(record.step)) for record in records)
    narrowest = max(NARROWEST, MIN_WINDOW_STEPS * slowest)
    delay = None
    if campaign.has_delay:
        delay = likely_delay(records, equations, narrowest, *campaign.prior("delay").bounds)
        records = [delayed(record, delay) for record in records]
    key, g = random_key(campaign.seed, "screening"), campaign.structure.g
    screening = screen(equations, campaign.rules, records, noise, believed, key, narrowest, g, _log_prior(campaign))
    columns = [screening.rows.names.index(name) for name in screening.posterior.names]
    by_term = {
        "fit": screening.fit.values[columns],
        "fit_sd": screening.fit.sd[columns],
        "bias": screening.bias.bias[columns],
        "bias_error": screening.bias.error[columns],
    }
    attributes = {
        "delay": "" if delay is None else f"commands act {delay:.3g} s late, which explains the rows best",
        "rows": screening.fit.status,
        "noise": screening.bias.status,
        "left_out": ignored(campaign, campaign.full),
        "r2": float(screening.rows.r2[0]),
    }
    return _dataset(campaign.structure, screening, by_term, attributes)


def _screen_about_mode(campaign: Campaign, trials: Trials) -> Dataset:
    """Screen a vehicle whose axes are coupled, about the mode of all terms; noise is in the sensors alone there."""
    posterior = build_posterior(campaign, campaign.full, trials.fit)
    mode = find_mode(posterior, key=random_key(campaign.seed, "screening"))
    screening = screen_about_mode(posterior, mode, campaign.rules, campaign.structure.g, _log_prior(campaign))
    nothing = np.zeros(screening.values.size)
    by_term = {"fit": screening.values, "fit_sd": screening.sd, "bias": nothing, "bias_error": nothing}
    attributes = {
        "delay": "about the mode of all terms, all other unknowns integrated out",
        "rows": "",
        "noise": "",
        "left_out": "",
    }
    return _dataset(campaign.structure, screening, by_term, {**attributes, "r2": np.nan})


def _log_prior(campaign: Campaign) -> Float[np.ndarray, " k1"]:
    """Return the log prior of a structure by the number of terms that the rules leave optional; those they force count as there."""
    optional, rules = campaign.structure.optional, campaign.rules
    forced = len(set(optional).intersection(rules.always))
    whole = log_prior_by_size(campaign.selection.structure_prior, len(optional))
    return whole[forced : forced + len(rules.optional) + 1]


def _dataset(
    table: StructureTable,
    found: Screening | ModeScreening,
    by_term: dict[str, np.ndarray],
    attributes: dict[str, str | float],
) -> Dataset:
    always = table.compiled().always
    posterior, best = found.posterior, min(KEPT, found.posterior.structures.size)
    names = list(posterior.names)
    member = np.array([[name in posterior.terms(rank) for name in names] for rank in range(best)])
    averaged = posterior.coefficients()
    factor = found.sensitivity.log_bayes_factor
    return Dataset(
        {
            "always": ("term", [name in always for name in names]),
            "inclusion": ("term", posterior.inclusion),
            "mean": ("term", averaged.mean),
            "within": ("term", averaged.within),
            "between": ("term", averaged.between),
            **{name: ("term", values) for name, values in by_term.items()},
            "joint": (("term", "other"), posterior.joint),
            "probability": ("model", posterior.probability[:best]),
            "log_evidence": ("model", posterior.log_evidence[:best]),
            "member": (("model", "term"), member),
            "inclusion_by_unit_information": ("term", found.unit_information),
            "inclusion_at": (("scale", "term"), found.sensitivity.inclusion),
            "mean_at": (("scale", "term"), found.sensitivity.mean),
            "log_bayes_factor": ("scale", factor if factor.size else np.full(found.sensitivity.scales.size, np.nan)),
        },
        coords={"term": names, "other": names, "scale": found.sensitivity.scales},
        attrs={
            "count": posterior.count,
            "prior": "" if table.g is None else f"under a g-prior, g = {table.g}",
            "sampling": "" if posterior.monte_carlo is None else posterior.monte_carlo.status,
            **attributes,
        },
    )
