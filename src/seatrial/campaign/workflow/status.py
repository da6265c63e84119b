"""What of a campaign is current, stale or missing; nothing is computed, and of large results only the stamp is read."""

from pathlib import Path
from typing import NamedTuple

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.store.stored_result import State, Store
from seatrial.campaign.workflow.steps import LOOP, NotCurrent, Workflow, stored_summary


class StepState(NamedTuple):
    """One step of a campaign: its name, whether its results are current, and the command that makes them so."""

    name: str
    state: State
    command: str


def standing(folder: Path) -> tuple[StepState, ...]:
    """Say of every step whether its results belong to the campaign file and logs as they are now.

    Raises:
        InputError: a campaign file that cannot be used.
    """
    campaign = load_campaign(folder)
    flow, found = Workflow(campaign), []
    for step in LOOP:
        if step.listed:
            records = "simulate" if campaign.is_simulated else "import"
            name, command = (records, records) if step.name == "trials" else (step.listed, step.command)
            found.append(StepState(name, flow.state(step.name), command))
    design, *others = found
    found = others if campaign.imports is not None and design.state == "missing" else found
    return (*found, StepState("report", _page(campaign, flow), "report"))


def _page(campaign: Campaign, flow: Workflow) -> State:
    """The page is as current as the summary it was drawn from, if it is not older."""
    store = Store(campaign.folder)
    if not store.report.is_file():
        return "missing"
    try:
        summary = stored_summary(campaign, flow.seen("estimates"))
    except NotCurrent:
        return "stale"
    fresh = flow.state("selection") == summary.state() == "current"
    return "current" if fresh and store.report.stat().st_mtime >= store.summary.stat().st_mtime else "stale"
