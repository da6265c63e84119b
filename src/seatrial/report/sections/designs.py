"""The trial that was run and the next one: how informative each design is, what it looks like, and what the records cover."""

from math import floor, log10
from typing import Any

import numpy as np
from markupsafe import Markup

from seatrial.campaign.data.simulate import chosen_of
from seatrial.campaign.data.true_vehicle import FIRST
from seatrial.campaign.workflow.next_trial import propose
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.design.trial_design import TrialDesign
from seatrial.manoeuvres.schedule import schedule_of
from seatrial.report.drawing import (
    Drawing,
    draw,
    factors_of,
    labels_of,
    model_said,
    schedule_figure,
    sentence_of,
    signal_axis,
    signal_symbol,
    units_of,
)
from seatrial.report.figures.records import covered
from seatrial.report.figures.style import unit_label
from seatrial.report.figures.surface import design_surface
from seatrial.report.labels import label_html
from seatrial.report.numbers import common_exponent, decimals, percent, short, times_ten, unit_html
from seatrial.report.sections.parameters import verdict_findings


def trial_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `next.html` and `method.html` print of the first trial and the records."""
    first = outcome.first
    imported = outcome.campaign.imports is not None
    return {
        "imported": imported,
        "was_run": any(record.label == FIRST for record in outcome.trials.fit),
        "records": record_rows(outcome),
        "design": None if first is None else _designed(outcome, first),
        "coverage": _coverage(outcome) if imported else [],
    }


def next_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `next.html` prints; nothing if no trial is designed."""
    trial = outcome.summary.next_trial.best
    if outcome.next is None or trial is None:
        return {}
    proposal = propose(outcome)
    return {
        "figures": sweep_drawings(outcome, outcome.next, "next"),
        "families": _families(outcome.next),
        "stop": proposal.trial is None,
        "decides": proposal.trial not in (None, chosen_of(outcome.next.best, outcome.next.best.best)),
        "said": [sentence_of(outcome, line) for line in (*proposal.standing[1:], *proposal.expected[1:])],
        "best": best_words(outcome.next),
        "model": model_said(outcome, outcome.chosen.structure.label),
        "rows": _sd_rows(outcome, [*trial.sd_before], [*trial.sd_before.values()], [*trial.sd_after.values()]),
    }


def sweep_drawings(outcome: Outcome, designs: TrialDesign, name: str) -> list[Drawing]:
    """Surface and chosen control of the best family's sweep."""
    sweep = designs.best
    control = sweep.family.control
    factor, unit = shown_unit(control)
    forbidden = int(np.isnan(sweep.gain).sum())
    caption = f"Each of {sweep.gain.size} designs, the best marked by a star"
    caption += f"; hatched: {forbidden} designs that break a limit." if forbidden else "; none breaks a limit."
    if edge := designs.at_edge:
        caption += f" {edge[0].upper()}{edge[1:]}."
    surface = design_surface(
        sweep.period,
        sweep.amplitude * factor,
        sweep.gain,
        sweep.best,
        (unit_label(sweep.family.shape.period_is, "s"), unit_label(f"amplitude of {signal_symbol(control)}", unit)),
    )
    schedule = schedule_of(sweep.best_manoeuvre(), sweep.family.sample_time)
    chosen = schedule_figure(schedule, outcome.campaign.control_limits)
    return [
        draw(
            surface,
            f"{name}-surface",
            f"Entropy reduction over period and amplitude of the {sweep.family.words}",
            caption,
            "Information of each design",
        ),
        draw(
            chosen,
            f"{name}-input",
            "Control of the best design over time",
            f"{best_words(designs)}.",
            "The best design",
        ),
    ]


def best_words(designs: TrialDesign) -> str:
    """Name the best design, as a sentence begins."""
    words = designs.best.words(*designs.best.best)
    return words[:1].upper() + words[1:]


def record_rows(outcome: Outcome) -> list[dict[str, Any]]:
    """Return one row for each record: how it was used, how long it is and what it covers."""
    fitted = {record.label for record in outcome.trials.fit}
    return [
        {
            "label": record.label,
            "held_back": record.label not in fitted,
            "seconds": f"{record.time[-1] - record.time[0]:.1f}",
            "samples": record.time.size,
            "step": _step(record),
            "ranges": [(name, *_range(record, name)) for name in (*record.controls, *record.measured)],
        }
        for record in (*outcome.trials.fit, *outcome.trials.predict)
    ]


def _designed(outcome: Outcome, first: TrialDesign) -> dict[str, Any]:
    """Return the trial as it was designed, beside what the records gave."""
    filtered = [str(name) for name in outcome.filter["coefficient"].values]
    full = outcome.estimates[0]
    before = [float(full.data.sel(parameter=name)["prior_sd"]) for name in filtered]
    reached = [float(full.data.sel(parameter=name)["draws_sd"]) for name in filtered]
    promised = dict(zip(first.names, first.best.final_sd[first.best.best], strict=True))
    return {
        "figures": sweep_drawings(outcome, first, "first"),
        "words": best_words(first),
        "families": _families(first),
        "model": model_said(outcome, full.structure.label),
        "rows": _sd_rows(outcome, filtered, before, [promised[name] for name in filtered], reached),
        "foreseen": [] if outcome.promised is None else verdict_findings(outcome, outcome.promised),
    }


def _families(designs: TrialDesign) -> list[str]:
    """Return the best of every family, where there is more than one."""
    several = len(designs.sweeps) + len(designs.refused) > 1
    return designs.lines() if several else designs.diverging()


def _step(record: Record) -> str:
    step = np.diff(record.time)
    return (
        short(float(np.median(step)))
        if np.ptp(step) <= 1e-6 * step[0]
        else f"{short(step.min())} to {short(step.max())}"
    )


def _range(record: Record, name: str) -> tuple[str, str]:
    factor, unit = shown_unit(name)
    values = record.channel(name) * factor
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    count = max(0, 2 - floor(log10(max(abs(low), abs(high), 1e-300))))
    return f"{decimals(low, count)} to {decimals(high, count)}", unit


def _coverage(outcome: Outcome) -> list[Drawing]:
    control, channel = outcome.trials.fit[0].controls[0], outcome.campaign.channels[0]
    factors = shown_unit(control)[0], shown_unit(channel)[0]
    groups = [
        [(record.channel(control) * factors[0], record.channel(channel) * factors[1]) for record in records]
        for records in (outcome.trials.fit, outcome.trials.predict)
    ]
    figure = covered(groups[0], groups[1], (signal_axis(control), signal_axis(channel)))
    return [
        draw(
            figure,
            "covered",
            f"Measured {channel} against control {control} of all records",
            "All samples of the fitted records, and of those held back. Predictions of held-back samples outside the fitted ones are "
            "extrapolations.",
            "Range of the records",
        )
    ]


def _sd_rows(
    outcome: Outcome, names: list[str], before: list[float], after: Any, reached: list[float] | None = None
) -> list[dict[str, Any]]:
    """Return a row for each coefficient: its standard deviations, two digits each, and what is left of the first."""
    labels, units, rows = labels_of(outcome), units_of(outcome), []
    for index, name in enumerate(names):
        factor = factors_of(outcome)[name]
        exponent = common_exponent(factor * before[index])
        columns = (before[index], after[index], *([reached[index]] if reached else []))
        power = Markup(times_ten(exponent).removeprefix(" × ") + " ") if exponent else Markup("")
        rows.append(
            {
                "label": label_html(labels.get(name, name)),
                "unit": power + unit_html(units[name]),
                "numbers": [short(factor * value * 10.0**-exponent, 2) for value in columns],
                "left": percent(after[index] / before[index]),
            }
        )
    return rows
