"""What of a campaign is current, stale or missing; nothing is computed, and of large results only the stamp is read."""

import re
from pathlib import Path

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.store.stored_result import StepState, Store, seal_of
from seatrial.campaign.workflow.steps import LOOP, Workflow, stored_summary
from seatrial.core.files import is_there

HEAD_CHARACTERS = 4096  # Characters of a page in which its head says what it was drawn from


def standing(folder: Path) -> tuple[StepState, ...]:
    """Say of every step whether its results belong to the campaign file and logs as they are now.

    Raises:
        InputError: a campaign file that cannot be used.
    """
    campaign = load_campaign(folder)
    flow, states = Workflow(campaign), []
    for step in LOOP:
        if step.listed:
            records = "simulate" if campaign.is_simulated else "import"
            name, command = (records, records) if step.name == "trials" else (step.listed, step.command)
            state = flow.state(step.name)
            states.append(StepState(name, state, command, _alarms(flow, step.name) if state == "current" else ()))
    design, *others = states
    states = others if campaign.imports is not None and design.state == "missing" else states
    return (*states, _page(flow))


def _alarms(flow: Workflow, name: str) -> tuple[str, ...]:
    """Read the alarms of the posteriors, or of the evidence; of a step that is current."""
    if name == "estimates":
        estimates = [one.read() for one in flow.stored(name)]
        return tuple(f"{one.structure.label}: {text}" for one in estimates for text in one.alarms)
    if name == "selection":
        return tuple(text for one in flow.stored(name) for text in one.read().alarms)
    return ()


def _page(flow: Workflow) -> StepState:
    """Judge the page: it is current if it was drawn from the summary as that is stored now, and that is current.

    A first answer, which is drawn from no summary, is none yet.
    """
    store = Store(flow.campaign.folder)
    if not is_there(store.report) or not (drawn_from(store.report) or is_there(store.summary)):
        return StepState("report", "missing", "report")
    summary = stored_summary(flow)
    if summary.state() != "current" or drawn_from(store.report) != seal_of(store.summary):
        return StepState("report", "stale", "report")
    return StepState("report", "current", "report", tuple(summary.read().alarms))


def drawn_from(page: Path) -> str:
    """Return the seal of the summary that a page was drawn from, as its head says; empty if it says none."""
    with page.open(encoding="utf-8", errors="replace") as stream:
        match = re.search(r'<meta name="seatrial-summary" content="([0-9a-f]+)">', stream.read(HEAD_CHARACTERS))
    return match[1] if match else ""
