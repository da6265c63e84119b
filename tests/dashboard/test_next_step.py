"""The next step of a campaign, whatever of it is current."""

import pytest

from seatrial.campaign.store.stored_result import StepState
from seatrial.dashboard.next_step import next_step
from seatrial.dashboard.page_layout import next_html
from seatrial.dashboard.view_models import Checked, CheckedRecord

AFTER = ("estimate", "select", "predict", "next", "report")


def steps(records, current=(), stale=(), alarms=(), design=True):
    names = (*(("design",) if design else ()), records, *AFTER)
    return [
        StepState(
            name,
            "current" if name in current else "stale" if name in stale else "missing",
            name,
            ("bad",) if name in alarms else (),
        )
        for name in names
    ]


def check(level="pass", is_current=True):
    return Checked((CheckedRecord("1", level, (), "check-1.svg"),), (), is_current)


ALL = ("design", "import", *AFTER)


@pytest.mark.parametrize(
    ("states", "checked", "words", "view"),
    [
        (steps("simulate"), None, "Design the first trial", "design"),
        (steps("simulate", ["design"]), None, "Run the campaign: it simulates", "run"),
        (steps("simulate", ["design", "simulate"]), None, "Run the campaign: it estimates", "run"),
        (steps("import", ["design"]), None, "Run the trial, then add its log", "import"),
        (steps("import", design=False), None, "Add the log", "import"),
        (steps("import", stale=["import"], design=False), None, "Import the records again", "import"),
        (steps("import", ["import"], design=False), None, "Check the records", "import"),
        (steps("import", ["import"], design=False), check(is_current=False), "Check the records again", "import"),
        (steps("import", ["import"], design=False), check("alarm"), "Correct the findings of the checks", "import"),
        (steps("import", ["import"], design=False), check("caution"), "Run the campaign: it estimates", "run"),
        (
            steps("import", ["import", "estimate"], design=False),
            None,
            "Run the rest of the campaign: it chooses",
            "run",
        ),
        (steps("import", ALL, design=False)[:-1] + steps("import")[-1:], check(), "Write the report", "run"),
        (steps("import", ["import", "estimate"], AFTER[1:]), None, "select, predict, next and report do not", "run"),
        (steps("import", ALL, alarms=["estimate"]), None, "Read the alarms", "results"),
        (steps("import", ALL), None, "Read the results, and run the proposed trial", "results"),
    ],
)
def test_the_first_step_that_is_not_current_is_next(states, checked, words, view):
    step = next_step(states, checked)
    assert words in step.words
    assert step.view == view


def test_a_log_that_is_there_is_imported():
    step = next_step(steps("import", design=False), None, has_log=True)
    assert (step.words, step.view) == ("Check which column is which channel, then import the records", "import")


def test_after_the_last_trial_the_vehicle_is_exported():
    step = next_step(steps("import", ALL), None, stop=True)
    assert step.view == "report"
    assert '<a href="/report?campaign=boat">Report and export</a>' in next_html(step, "results", "boat")
    assert "href" not in next_html(step, "report", "boat")
