"""Every part and every item of the study by its key, in the order of the paper, and the parts each item rests on."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from seatrial.core.errors import InputError, nearest
from studies.remus100 import (
    chain_verdicts,
    design_verdicts,
    equations,
    evidence,
    filter_verdicts,
    iteration,
    tuning,
    vehicle,
)
from studies.remus100.chains import starts_part, table_3_part, table_6_part
from studies.remus100.designs import chosen_doublet_part, ekf_sweep_part, relay_part, sweep_part
from studies.remus100.equations import equations_part
from studies.remus100.evidence import evidence_part, listing_part, odds_part
from studies.remus100.filters import filters_part
from studies.remus100.iteration import iteration_part, readings_part
from studies.remus100.study import Item, Part, Study
from studies.remus100.tuning import tuning_part
from studies.remus100.vehicle import vehicle_part

# Every part of the study by name, the longest first, so that two cores are busy to the end.

PARTS: dict[str, Part] = {
    "listing-4": partial(listing_part, table=4),
    "listing-5": partial(listing_part, table=5),
    "chain-3-metropolis": partial(table_3_part, sampler="metropolis"),
    "evidence-4": partial(evidence_part, table=4),
    "evidence-5": partial(evidence_part, table=5),
    "odds": odds_part,
    "chain-3": partial(table_3_part, sampler="adaptive-metropolis"),
    "chain-6-full": partial(table_6_part, full=True),
    "chain-6-reduced": partial(table_6_part, full=False),
    "filters": filters_part,
    "readings": readings_part,
    "tuning": tuning_part,
    "relay": relay_part,
    "sweep-short": partial(sweep_part, window="short"),
    "sweep-medium": partial(sweep_part, window="medium"),
    "sweep-long": partial(sweep_part, window="long"),
    "sweep-ekf": ekf_sweep_part,
    "starts": starts_part,
    "chosen-doublet": chosen_doublet_part,
    "vehicle": vehicle_part,
    "iteration": iteration_part,
    "equations": equations_part,
}


# Every item of the study by its key, in the order of the paper, and the parts it rests on.

SWEEPS = ("sweep-short", "sweep-medium", "sweep-long")
CHAINS_6 = ("chain-6-full", "chain-6-reduced")


class Entry(NamedTuple):
    """How an item is judged, and the parts that are computed first."""

    judge: Callable[[Study], Item]
    parts: tuple[str, ...]


ENTRIES: dict[str, Entry] = {
    "equations-2": Entry(equations.equations_2, ("equations",)),
    "vehicle": Entry(vehicle.vehicle, ("vehicle",)),
    "table-1": Entry(filter_verdicts.table_1, ("filters",)),
    "figure-1": Entry(filter_verdicts.figure_1, ("filters",)),
    "claim-filters-equal": Entry(filter_verdicts.claim_filters_equal, ("filters",)),
    "claim-ekf-faster": Entry(filter_verdicts.claim_ekf_faster, ("filters",)),
    "claim-ekf-better": Entry(filter_verdicts.claim_ekf_better, ("filters",)),
    "claim-stability": Entry(filter_verdicts.claim_stability, ("filters",)),
    "table-2": Entry(filter_verdicts.table_2, ("filters",)),
    "figure-2": Entry(filter_verdicts.figure_2, ("filters",)),
    "claim-clipping": Entry(filter_verdicts.claim_clipping, ("filters",)),
    "claim-transient": Entry(filter_verdicts.claim_transient, ("filters",)),
    "claim-only-square-root": Entry(filter_verdicts.claim_only_square_root, ("filters",)),
    "claim-large-p": Entry(tuning.claim_large_p, ("tuning",)),
    "claim-large-q": Entry(tuning.claim_large_q, ("tuning",)),
    "claim-large-r": Entry(tuning.claim_large_r, ("tuning",)),
    "claim-noise": Entry(tuning.claim_noise, ("tuning",)),
    "equations-3": Entry(equations.equations_3, ("equations",)),
    "figure-3": Entry(design_verdicts.figure_3, (*SWEEPS, "sweep-ekf")),
    "claim-amplitude": Entry(design_verdicts.claim_amplitude, SWEEPS),
    "claim-ten-seconds": Entry(design_verdicts.claim_ten_seconds, (*SWEEPS, "iteration")),
    "claim-ridges": Entry(design_verdicts.claim_ridges, SWEEPS),
    "claim-quiet-time": Entry(design_verdicts.claim_quiet_time, SWEEPS),
    "figure-4": Entry(design_verdicts.figure_4, ("chosen-doublet",)),
    "relay": Entry(design_verdicts.relay, ("relay", "sweep-medium", "chosen-doublet")),
    "claim-single-pass": Entry(chain_verdicts.claim_single_pass, ("chain-3", "sweep-medium")),
    "equations-4": Entry(equations.equations_4, ("equations", "chain-6-reduced", "evidence-4")),
    "figure-5": Entry(chain_verdicts.figure_5, ()),
    "table-3": Entry(chain_verdicts.table_3, ("chain-3",)),
    "figure-6": Entry(chain_verdicts.figure_6, ("chain-3",)),
    "claim-near-normal": Entry(chain_verdicts.claim_near_normal, ("chain-3",)),
    "claim-sampler": Entry(chain_verdicts.claim_sampler, ("chain-3", "chain-3-metropolis")),
    "claim-start": Entry(chain_verdicts.claim_start, ("starts",)),
    "listing-1": Entry(evidence.listing_1, ("listing-4", "listing-5", "evidence-4", "evidence-5")),
    "table-4": Entry(evidence.table_4, ("listing-4", "evidence-4")),
    "table-5": Entry(evidence.table_5, ("listing-5", "evidence-5")),
    "odds": Entry(evidence.odds, ("odds",)),
    "table-6": Entry(chain_verdicts.table_6, CHAINS_6),
    "figure-7": Entry(chain_verdicts.figure_7, ("chain-6-full",)),
    "figure-8": Entry(chain_verdicts.figure_8, ("chain-6-reduced",)),
    "claim-extra-term": Entry(chain_verdicts.claim_extra_term, ("chain-6-full",)),
    "claim-tighter": Entry(chain_verdicts.claim_tighter, CHAINS_6),
    "claim-criteria-favour": Entry(chain_verdicts.claim_criteria_favour, CHAINS_6),
    "claim-criteria-insensitive": Entry(chain_verdicts.claim_criteria_insensitive, CHAINS_6),
    "iteration": Entry(iteration.iteration, ("iteration", "relay")),
    "readings": Entry(iteration.readings, ("readings",)),
}


def chosen_items(only: Sequence[str]) -> tuple[str, ...]:
    """Keys of the items asked for, all if none, in the order of the paper.

    Raises:
        InputError: an unknown key, or a list without any; all keys are listed.
    """
    wanted = {name.strip() for text in only for name in text.split(",") if name.strip()}
    for name in sorted(wanted) or [""] * bool(only):
        if name not in ENTRIES:
            close = nearest(name, ENTRIES)
            raise InputError(
                "--only",
                found=f'"{name}"',
                expected="items among " + ", ".join(ENTRIES),
                remedy=close if close.startswith("did") else "choose from the list",
            )
    return tuple(key for key in ENTRIES if not wanted or key in wanted)
