"""What of a campaign is current, stale or missing; nothing is computed, and of large results only the stamp is read."""

from pathlib import Path
from typing import NamedTuple

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.selection.evidence import stored_alarms
from seatrial.campaign.store.stored_result import State, Store
from seatrial.campaign.workflow.steps import LOOP, NotCurrent, Workflow, stored_summary


class StepState(NamedTuple):
    """One step of a campaign.

    Attributes:
        name: of the step.
        state: whether its results are current.
        command: that makes them so.
        alarms: why current results are not to be used: checks of the chains or of the evidence that they have failed.
    """

    name: str
    state: State
    command: str
    alarms: tuple[str, ...] = ()


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
            state = flow.state(step.name)
            found.append(StepState(name, state, command, _alarms(flow, step.name) if state == "current" else ()))
    design, *others = found
    found = others if campaign.imports is not None and design.state == "missing" else found
    return (*found, _page(campaign, flow))


def _alarms(flow: Workflow, name: str) -> tuple[str, ...]:
    """Read the alarms of the posteriors, or of the evidence; of a step that is current."""
    if name == "estimates":
        estimates = [one.read(one.path) for one in flow.stored(name)]
        return tuple(f"{one.structure.label}: {text}" for one in estimates for text in one.alarms)
    if name == "selection":
        return tuple(text for one in flow.stored(name) for text in stored_alarms(one.read(one.path)))
    return ()


def _page(campaign: Campaign, flow: Workflow) -> StepState:
    """Judge the page: it is as current as the summary it was drawn from, if it is not older."""
    store = Store(campaign.folder)
    if not store.report.is_file():
        return StepState("report", "missing", "report")
    try:
        summary = stored_summary(campaign, flow.seen("estimates"))
    except NotCurrent:
        return StepState("report", "stale", "report")
    fresh = flow.state("selection") == summary.state() == "current"
    if not fresh or store.report.stat().st_mtime < store.summary.stat().st_mtime:
        return StepState("report", "stale", "report")
    return StepState("report", "current", "report", tuple(summary.read(summary.path).alarms))
