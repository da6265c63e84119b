"""How the chosen model stands beside simple predictors on the held-back records."""

from typing import Any

from seatrial.campaign.inference.baselines import NOTHING_HELD_BACK, refused_words
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.display_units import shown_unit
from seatrial.estimation.baseline_comparison import Comparison, PooledScore
from seatrial.report.labels import sentence_html
from seatrial.report.numbers import percent, short, unit_text
from seatrial.report.sections.fits import LOOKS


def baselines_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `baselines.html` prints."""
    refused = [] if outcome.baselines is None else refused_words(outcome.baselines)
    return {
        "findings": [{"kind": LOOKS[one.level], "text": sentence_html(one.sentence, {})} for one in outcome.compared],
        "tables": [_table(one) for one in outcome.compared],
        "refused": [sentence_html(text, {}) for text in refused],
        "nothing": NOTHING_HELD_BACK if outcome.baselines is None else "",
        "structure": outcome.chosen.structure.label,
    }


def _table(one: Comparison) -> dict[str, Any]:
    return {
        "channel": one.channel,
        "rows": [_row(one.channel, score, score is one.ours) for score in (one.ours, *one.baselines)],
    }


def _row(channel: str, score: PooledScore, is_ours: bool) -> dict[str, Any]:
    factor, unit = shown_unit(channel)
    worse = score.explained < 0
    return {
        "words": score.words,
        "ours": is_ours,
        "diverges": score.diverges,
        "explained": "worse than the runs' own means" if worse else percent(score.explained),
        "crps": f"{short(score.crps * factor)} {unit_text(unit)}",
        "log_score": f"{score.log_score:.2f}",
    }
