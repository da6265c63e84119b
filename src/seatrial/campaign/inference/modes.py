"""Posterior modes of all structures of a campaign, each looked for where the others have theirs too.

A search that begins from the prior may end on a lower peak. A structure that contains another cannot have a lower maximum than the other's
with its further terms at zero, so the modes of all structures check each other, and are starts that cost nothing.
"""

from collections.abc import Mapping
from typing import NamedTuple

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.compute.workers import LocalWorkers, Workers
from seatrial.campaign.inference.posterior import random_key
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress
from seatrial.estimation.posterior.mode import Mode, find_mode, higher_mode
from seatrial.selection.structures import Structure

HERE = LocalWorkers()
"""This machine's cores."""
EXCHANGES = 3
"""Times at most that modes are exchanged, until none is higher than before."""
Modes = Mapping[Structure, Mode | NumericalError]
"""Mode of each structure, or why there is none."""


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


def _find(study: Study, structure: Structure, report: Progress) -> Mode | NumericalError:
    try:
        return find_mode(study.posterior(structure), random_key(study.campaign.seed, f"mode {structure.terms}"))
    except NumericalError as error:
        return error


def _exchange(study: Study, item: _Known, report: Progress) -> Mode | None:
    return higher_mode(study.posterior(item.structure), item.mode, item.others)
