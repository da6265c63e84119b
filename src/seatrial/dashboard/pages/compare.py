"""Two campaigns side by side: the value to quote of each coefficient, and its difference in joint standard deviations.

The difference is (a - b) / sqrt(sd_a^2 + sd_b^2), and each sd contains what the models may lack.
"""

from dataclasses import replace
from math import hypot, nan
from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.store.results import Results
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.store.summary import Summary
from seatrial.cli.campaign_text import written_units
from seatrial.core.coefficients import is_coefficient
from seatrial.core.display_units import shown_as_written
from seatrial.dashboard.app_context import AppContext, markup, saying
from seatrial.dashboard.page_layout import LOOK, link, section, table
from seatrial.report.labels import label_html
from seatrial.report.numbers import decimals, unit_html, with_sd
from seatrial.selection.verdict import StoredAverage

MOST = 12
"""Campaigns without results that are named."""
FAR = 3.0
"""Joint standard deviations from which two values contradict each other."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    there = [name for name in context.campaign_paths.campaigns() if name != campaign]
    others = [name for name in there if Store(context.campaign_paths.folder(name)).summary.is_file()]
    with section(
        "Two campaigns side by side",
        "Two coefficients contradict each other if they differ by over 3 joint standard deviations, for the same vehicle and water; "
        "Noise, bias and current belong to the sensors and the day: they are listed, not judged.",
    ):
        if not Store(folder).summary.is_file():
            words = '<p>This campaign has no results of <code>seatrial run</code> yet: <a href="{}">Run</a>.</p>'
            markup(Markup(words).format(link("run", campaign)))
            return
        if not others:
            markup(nothing_beside(there, context.campaign_paths.root))
            return
        form = ui.select(others, value=others[0], label="Compare with").props(LOOK).classes("wide")
        holder = ui.element("div")

        def show() -> None:
            with saying(holder):
                there = context.campaign_paths.folder(str(form.value))
                ours, theirs = (Results(one).summary() for one in (folder, there))
                shown = shown_as_written(dict(written_units(folder)))
                ours, theirs = (
                    replace(one, quote=tuple(row.in_unit(*shown(row.name, row.unit)) for row in one.quote))
                    for one in (ours, theirs)
                )
                markup(side_by_side(ours, theirs, campaign if campaign != "." else folder.name, str(form.value)))

        form.on_value_change(show)
        show()


def nothing_beside(others: list[str], root: Path) -> Markup:
    """Return why no campaign can stand beside this one: there is no other, or none that was run, each with a link to run it.

    Args:
        others: campaigns that were not run.
        root: folder that is served.
    """
    if not others:
        return Markup("<p>No other campaign is in {}. Serve a folder that contains several.</p>").format(root)
    listed = Markup("").join(
        Markup('<li><a href="{}">Run {}</a></li>').format(link("run", name), root.name if name == "." else name)
        for name in others[:MOST]
    )
    more = Markup("<li>{} more</li>").format(len(others) - MOST) if len(others) > MOST else ""
    words = "<p>No other campaign in {} has results of <code>seatrial run</code> yet. Continue with one of these:</p><ul>{}{}</ul>"
    return Markup(words).format(root, listed, more)


def side_by_side(ours: Summary, theirs: Summary, here: str, there: str) -> Markup:
    """The tables of two summaries."""
    rows: dict[bool, list[list[str | Markup]]] = {True: [], False: []}
    tables = [{row.name: row for row in one.quote} for one in (ours, theirs)]
    for name in dict.fromkeys([*tables[0], *tables[1]]):
        pair = [one.get(name) for one in tables]
        known = [one for one in pair if one is not None]
        cells = ["not in its model" if one is None else with_sd(one.mean, one.sd) for one in pair]
        unit = Markup(", ").join(map(unit_html, dict.fromkeys(one.unit for one in known)))
        named = label_html(known[0].label) + Markup(" <small>{}</small>").format(name)
        judged = [_judged(joint_difference(*pair))] * is_coefficient(name)
        rows[is_coefficient(name)].append([named, *judged, *cells, unit])
    head, summaries = [here, there, "unit"], (ours, theirs)
    shares = [{one.label: one.probability for one in summary.structures} for summary in summaries]
    bests = [summary.next_trial.best for summary in summaries]
    doubts = [["alarms about it", *("; ".join(one.choice_alarms) for one in summaries)]]
    facts = [
        ["model", *(f"{one.chosen}: {' '.join(one.terms)}" for one in summaries)],
        ["probability of it", *(decimals(s.get(one.chosen, nan), 2) for s, one in zip(shares, summaries, strict=True))],
        *doubts * any(one.choice_alarms for one in summaries),
        [
            "information of the next trial",
            *("none is designed" if best is None else f"{best.gain_nat:.2f} nat" for best in bests),
        ],
        ["alarms", *(str(len(one.alarms)) for one in summaries)],
        ["cautions", *(str(len(one.cautions)) for one in summaries)],
    ]
    vehicle = ["coefficient", "difference, joint sd", *head]
    html = table(vehicle, rows[True], "Coefficients of the vehicle", stacks=True)
    if rows[False]:
        html += table(["parameter", *head], rows[False], "Of sensors, runs and water", stacks=True)
    return html + table(["of the whole", here, there], [list(row) for row in facts], "In all", left=3, stacks=True)


def _judged(apart: float | None) -> str | Markup:
    if apart is None:
        return ""
    words = decimals(apart, 1)
    return Markup('<span class="verdict fail">{}</span>').format(words) if abs(apart) > FAR else words


def joint_difference(a: StoredAverage | None, b: StoredAverage | None) -> float | None:
    """Difference of two estimates in joint standard deviations; None if one is missing, both are exact, or units differ.

    A campaign with an unknown mass estimates coefficients per unit of effective mass: of another dimension.
    """
    if a is None or b is None or a.unit != b.unit:
        return None
    joint = hypot(a.sd, b.sd)
    return (a.mean - b.mean) / joint if joint > 0 else None
