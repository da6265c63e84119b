"""The next step of a campaign in one line, derived from which of its steps are current, with a link to where it is done."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from seatrial.campaign.store.results import Results
from seatrial.campaign.store.stored_result import StepState
from seatrial.cli.campaign_text import CAMPAIGN, read_file
from seatrial.core.display_units import listed
from seatrial.core.errors import SeatrialError
from seatrial.dashboard.app_context import AppContext
from seatrial.dashboard.channel_map import files_of, path_of, runs_of
from seatrial.dashboard.view_models import Checked

RECORDS = ("import", "simulate")
"""Names of the step that makes records."""


class NextStep(NamedTuple):
    """What to do next.

    Attributes:
        words: the step, as a command that begins with a verb.
        view: key of the view on which it is done.
    """

    words: str
    view: str


async def find_next_step(context: AppContext, folder: Path) -> NextStep:
    """Look at the files of a campaign and return what to do next."""
    try:
        steps, checked = await asyncio.gather(context.steps(folder), context.checked(folder))
        stop = all(one.state == "current" for one in steps) and Results(folder).summary().next_trial.stop
        text = read_file(folder)
        logs = {path_of(one, run) for one in files_of(text) for run in runs_of(text)}
    except (SeatrialError, OSError) as error:
        if CAMPAIGN in str(error):
            return NextStep("Correct the campaign file", "file")
        return NextStep("Run the campaign again: a result cannot be read", "run")
    return next_step(steps, checked, stop, any((folder / log).exists() for log in logs))


def next_step(
    steps: Sequence[StepState], checked: Checked | None, stop: bool = False, has_log: bool = False
) -> NextStep:
    """Return what to do next.

    Args:
        steps: of the campaign, in their order.
        checked: what the last check of its records says; None if there was none.
        stop: whether the results propose no further trial.
        has_log: whether a log is there that the campaign names.
    """
    states = {one.name: one.state for one in steps}
    records = next(name for name in RECORDS if name in states)
    after = [one for one in steps if one.name not in ("design", records)]
    if states[records] != "current":
        return _records_step(states, records, has_log)
    if records == "import" and states["estimate"] != "current" and (found := _check_step(checked)):
        return found
    if stale := [one.name for one in after if one.state == "stale"]:
        verb = "does" if len(stale) == 1 else "do"
        return NextStep(f"Run the campaign again: {listed(stale)} {verb} not belong to its file as it is now", "run")
    if missing := [one.name for one in after if one.state == "missing"]:
        return NextStep(WORDS[missing[0]], "run")
    if any(one.alarms for one in after):
        return NextStep("Read the alarms before you use a number", "results")
    if stop:
        return NextStep("Export the vehicle: no further trial is proposed", "report")
    return NextStep("Read the results, and run the proposed trial", "results")


WORDS = {
    "estimate": "Run the campaign: it estimates the coefficients, chooses the model and writes the report",
    "select": "Run the rest of the campaign: it chooses the model and writes the report",
    "predict": "Run the rest of the campaign: it tests predictions and writes the report",
    "next": "Run the rest of the campaign: it designs the next trial and writes the report",
    "report": "Write the report",
}
"""What to do where a step is the first that is missing."""


def _records_step(states: dict[str, str], records: str, has_log: bool) -> NextStep:
    """Return how records are made that are missing or stale."""
    if states[records] == "stale":
        return NextStep(f"{records.capitalize()} the records again: the campaign file or a log has changed", "import")
    if has_log and records == "import":
        return NextStep("Check which column is which channel, then import the records", "import")
    if states.get("design", "current") != "current":
        return NextStep("Design the first trial", "design")
    if records == "simulate":
        return NextStep("Run the campaign: it simulates the trial and estimates the coefficients", "run")
    has_plan = "design" in states
    return NextStep("Run the trial, then add its log" if has_plan else "Add the log and import it", "import")


def _check_step(checked: Checked | None) -> NextStep | None:
    """Return what the checks of the records ask for; None if the records can be used."""
    if checked is None:
        return NextStep("Check the records", "import")
    if not checked.is_current:
        return NextStep("Check the records again: something has changed since the last check", "import")
    return NextStep("Correct the findings of the checks", "import") if checked.has_alarms else None
