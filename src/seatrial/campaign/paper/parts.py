"""Every part of the study by name, the longest first, so that two cores are busy to the end."""

from functools import partial

from seatrial.campaign.paper.compute.chains import starts_part, table_3_part, table_6_part
from seatrial.campaign.paper.compute.designs import chosen_doublet_part, ekf_sweep_part, relay_part, sweep_part
from seatrial.campaign.paper.compute.equations import equations_part
from seatrial.campaign.paper.compute.evidence import evidence_part, listing_part, odds_part
from seatrial.campaign.paper.compute.filters import filters_part
from seatrial.campaign.paper.compute.iteration import iteration_part
from seatrial.campaign.paper.compute.readings import readings_part
from seatrial.campaign.paper.compute.tuning import tuning_part
from seatrial.campaign.paper.compute.vehicle import vehicle_part
from seatrial.campaign.paper.study import Part
from seatrial.sampling import adaptive_metropolis, metropolis

PARTS: dict[str, Part] = {
    "listing-4": partial(listing_part, table=4),
    "listing-5": partial(listing_part, table=5),
    "chain-3-metropolis": partial(table_3_part, sampler=metropolis),
    "evidence-4": partial(evidence_part, table=4),
    "evidence-5": partial(evidence_part, table=5),
    "odds": odds_part,
    "chain-3": partial(table_3_part, sampler=adaptive_metropolis),
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
