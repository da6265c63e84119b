"""Two campaigns side by side: each coefficient, and its difference in joint standard deviations, (a - b) / sqrt(sd_a^2 + sd_b^2)."""

from math import hypot
from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.dashboard.app_context import AppContext, markup, say
from seatrial.apps.dashboard.page_layout import section, table
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.store.structures import StoredCoefficient, Summary, read_summary
from seatrial.core.errors import SeatrialError
from seatrial.report.labels import label_html
from seatrial.report.numbers import decimals, unit_html, with_sd

FAR = 3.0
"""Joint standard deviations from which two values contradict each other."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    others = [
        name
        for name in context.campaign_paths.campaigns()
        if name != campaign and Store(context.campaign_paths.folder(name)).summary.is_file()
    ]
    with section(
        "Two campaigns side by side",
        "Beyond 3 joint standard deviations the two contradict each other, if they tell of the same vehicle and water.",
    ):
        if not Store(folder).summary.is_file():
            markup("<p>This campaign has no results yet.</p>")
            return
        if not others:
            markup(
                Markup("<p>No other campaign with results in {}. Serve a folder that holds several.</p>").format(
                    context.campaign_paths.root
                )
            )
            return
        form = (
            ui.select(others, value=others[0], label="Compare with")
            .props("outlined options-dense hide-bottom-space")
            .classes("wide")
        )
        holder = ui.element("div")

        def show() -> None:
            holder.clear()
            with holder:
                try:
                    there = context.campaign_paths.folder(str(form.value))
                    sides = [read_summary(Store(one).summary, f"seatrial run {one}") for one in (folder, there)]
                except (SeatrialError, OSError) as error:
                    say(error)
                    return
                markup(side_by_side(sides[0], sides[1], campaign if campaign != "." else folder.name, str(form.value)))

        form.on_value_change(show)
        show()


def side_by_side(ours: Summary, theirs: Summary, here: str, there: str) -> Markup:
    """The tables of two summaries."""
    rows = []
    tables = [{row.name: row for row in one.coefficients} for one in (ours, theirs)]
    for name in dict.fromkeys([*tables[0], *tables[1]]):
        a, b = (one.get(name) for one in tables)
        known = a or b
        assert known is not None
        apart = joint_difference(a, b)
        words = "" if apart is None else decimals(apart, 1)
        if apart is not None and abs(apart) > FAR:
            words = Markup('<span class="verdict fail">{}</span>').format(words)
        name_cell = label_html(known.label) + Markup(" <small>{}</small>").format(name)
        rows.append([name_cell, words, _value(a), _value(b), unit_html(known.unit)])
    head = ["parameter", "difference, joint sd", here, there, "unit"]
    facts = [
        ["model", _model(ours), _model(theirs)],
        ["probability of it", *(_probability(one) for one in (ours, theirs))],
        ["next trial would teach", *(f"{one.next_trial.gain_nat:.2f} nat" for one in (ours, theirs))],
        ["alarms", *(str(len(one.alarms)) for one in (ours, theirs))],
        ["cautions", *(str(len(one.cautions)) for one in (ours, theirs))],
    ]
    return table(head, rows, "Coefficients") + table(["", here, there], [list(row) for row in facts], "In all", left=3)


def joint_difference(a: StoredCoefficient | None, b: StoredCoefficient | None) -> float | None:
    """Difference of two estimates in joint standard deviations; None where one is missing or both are exact."""
    if a is None or b is None:
        return None
    joint = hypot(a.sd, b.sd)
    return (a.mean - b.mean) / joint if joint > 0 else None


def _value(row: StoredCoefficient | None) -> str:
    return "not in its model" if row is None else with_sd(row.mean, row.sd)


def _model(summary: Summary) -> str:
    return f"{summary.chosen}: {' '.join(summary.terms)}"


def _probability(summary: Summary) -> str:
    found = next((one.probability for one in summary.structures if one.label == summary.chosen), float("nan"))
    return decimals(found, 2)
