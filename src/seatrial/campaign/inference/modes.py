"""Posterior modes of all structures of a campaign, each looked for where the others have theirs too, and checks of a mode.

A search that begins from the prior may end on a lower peak. A structure that contains another cannot have a lower maximum than the other's
with its further terms at zero, so the modes of all structures check each other, and are starts that cost nothing.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.compute.workers import LocalWorkers, Workers
from seatrial.campaign.data.check import likely_causes
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError, NumericalError, SeatrialError
from seatrial.core.findings import Finding
from seatrial.core.record import SIMULATED, Record
from seatrial.core.reporter import Progress
from seatrial.estimation.diagnostics.prior_checks import NOT_NEEDED, prior_excluding_data
from seatrial.estimation.posterior.mode import Mode, find_mode, higher_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.step_shift import check_step, shorter_step, step_shift
from seatrial.messages.render import remedy, sentences, statement
from seatrial.selection.structures import Structure

HERE = LocalWorkers()  # This machine's cores
EXCHANGES = 3  # Times at most that modes are exchanged, until none is higher than before
Modes = Mapping[Structure, Mode | NumericalError]  # Mode of each structure, or why there is none


class _Known(NamedTuple):
    """The highest mode known of a structure, None where none is, and those of the others."""

    structure: Structure
    mode: Mode | None
    others: tuple[Mode, ...]


def structure_modes(study: Study, workers: Workers = HERE) -> Modes:
    """Find the posterior mode of every structure, and exchange them."""
    structures, modes = study.campaign.structures, dict[Structure, Mode | NumericalError]()

    def done(index: int, mode: Mode | NumericalError) -> None:
        modes[structures[index]] = mode

    workers.run(_find, study, structures, done)
    return exchange_modes(study, modes, workers)


def exchange_modes(study: Study, modes: Modes, workers: Workers = HERE) -> Modes:
    """Return the modes, those replaced to which a mode of another structure shows a higher one; the others are the same objects."""
    known = dict(modes)
    for _ in range(EXCHANGES):
        there = {one: mode for one, mode in known.items() if isinstance(mode, Mode)}
        others = {one: tuple(mode for other, mode in there.items() if other != one) for one in known}
        items = [_Known(one, there.get(one), modes) for one, modes in others.items() if modes]
        if not items:
            break
        higher = dict[Structure, Mode]()

        def done(index: int, mode: Mode | None, items: list[_Known] = items, higher: dict = higher) -> None:
            if mode is not None:
                higher[items[index].structure] = mode

        workers.run(_exchange, study, items, done)
        if not higher:
            break
        known |= higher
    return known


def long_steps(posterior: Posterior, mode: Mode, records: Sequence[Record]) -> list[Finding]:
    """Return which parameters the steps of the records move by more than a standard deviation, and which step helps.

    Args:
        posterior: of the records.
        mode: its mode, with the parameters that are absent.
        records: fitted; of simulated ones, which the same steps have made, nothing is said.
    """
    if any(record.provenance.source == SIMULATED for record in records):
        return []
    counts = [record.provenance.options.get("averaged", {}) for record in records]
    averaged = np.array([[of_one.get(name, 1.0) for name in posterior.likelihood.channels] for of_one in counts])
    shift = step_shift(posterior, mode, averaged)
    if shift is None:
        return []
    step = max(float(np.median(np.diff(record.time))) for record in records)
    return check_step(posterior, shift, step, shorter_step(step, averaged))


def check_prior_of(study: Study, posterior: Posterior, mode: Mode) -> None:
    """Check that the priors of a campaign contain what its records say; arguments as `prior_excluding_data`.

    Raises:
        InputError: naming the parameter, and first of its remedies what `seatrial check` finds, where a fault of a record may be the cause.
    """
    finding = prior_excluding_data(posterior, mode)
    if finding is None:
        return
    causes, advice = [], remedy(finding)
    if finding.remedies[0] not in NOT_NEEDED.values():  # no fault of a record makes a noise small, or a lag none
        with suppress(SeatrialError):  # of a record that cannot be judged nothing is added
            causes = sentences(likely_causes(study.campaign, study.records))
    if causes:
        advice = f"`seatrial check` finds a likely cause: {'. '.join(causes)}. If that is not it: {advice}"
    where = study.campaign.where_of_prior(f"prior.{finding.subject[0]}")
    raise InputError(where, found=statement(finding), expected="a prior that contains what the data say", remedy=advice)


def _find(study: Study, structure: Structure, report: Progress) -> Mode | NumericalError:
    try:
        return find_mode(study.posterior(structure), random_key(study.campaign.seed, f"mode {structure.terms}"))
    except NumericalError as error:
        return error


def _exchange(study: Study, item: _Known, report: Progress) -> Mode | None:
    return higher_mode(study.posterior(item.structure), item.mode, item.others)
