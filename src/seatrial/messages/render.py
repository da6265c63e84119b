"""Findings in words: one sentence each, its remedies, and groups of equal findings."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from seatrial.core.display_units import listed
from seatrial.core.findings import Finding, Message
from seatrial.messages.catalogue import ENTRIES, REMEDIES
from seatrial.messages.entry import Form, filled_in

MAX_RUNS_NAMED = 6
"""Runs that one sentence names."""


def statement(finding: Finding, also: Sequence[str] = ()) -> str:
    """Return a finding in one sentence without a final stop.

    Args:
        finding: to put into words.
        also: other runs with an equal finding.
    """
    text = filled_in(ENTRIES[finding.code].template(finding.level), finding.subject, finding.values)
    if finding.level == "pass" and isinstance(ENTRIES[finding.code].sentence, Mapping):
        return f"{text} of {listed(finding.subject)} passes"
    if controls := finding.values.get("closed_loop"):
        text = f"{text}; not judged, because {listed(controls)} is computed from measured channels"
    if likewise := finding.values.get("likewise"):
        text = f"{text}; likewise {_runs_alike(finding.subject, likewise)}"
    if isinstance(outside := finding.values.get("outside"), tuple) and outside:
        text = f"{text}; outside the fitted range: {', '.join(map(str, outside))}"
    if ahead := finding.values.get("ahead"):
        text = f"{text}; {ahead}"
    if run := finding.values.get("run"):
        text = f"{'held-back ' if finding.values.get('held_back') else ''}run {run}: {text}"
    if structure := finding.values.get("structure"):
        text = f"{structure}: {text}"
    if finding.is_accepted:
        text = f"accepted: {text}"
    named = ", ".join(also[:MAX_RUNS_NAMED])
    more = f" and {len(also) - MAX_RUNS_NAMED} more" if len(also) > MAX_RUNS_NAMED else ""
    return f"{text} (in {len(also) + 1} runs, also {named}{more})" if also else text


def remedy(finding: Finding, form: Form = "command") -> str:
    """Return the remedy, without a final stop; empty if there is none."""
    texts = [filled_in(REMEDIES[name].of(form), finding.subject, finding.values) for name in finding.remedies]
    if finding.values.get("first"):
        return "; if the finding remains, ".join([f"first {texts[0]}", "; or ".join(texts[1:])])
    return "; or ".join(texts)


def sentence(finding: Finding, form: Form = "command", also: Sequence[str] = ()) -> str:
    """Return finding and remedy, without a final stop; `also` as in `statement`."""
    text, do = statement(finding, also), remedy(finding, form)
    return f"{text}. {do[:1].upper()}{do[1:]}" if do else text


def _runs_alike(subject: tuple[str, ...], likewise: Any) -> str:
    """Return the other runs and channels with the same finding: `b, c; likewise r of a, b`."""
    parts = []
    for channel, runs in likewise:
        named = ", ".join([*runs[:MAX_RUNS_NAMED], *(["others"] if len(runs) > MAX_RUNS_NAMED else [])])
        parts.append(named if channel == subject[0] else f"{channel} of {named}")
    return "; likewise ".join(parts)


def grouped(findings: Iterable[Finding]) -> list[tuple[Finding, tuple[str, ...]]]:
    """Return the findings, of those that differ in run and numbers only the first, with the runs of the others."""
    groups: dict[tuple, list[Finding]] = {}
    for one in findings:
        where = (one.values.get("structure"), "run" in one.values, one.values.get("held_back"))
        key = (one.code, one.level, one.subject, one.remedies, *where, one.is_accepted)
        groups.setdefault(key, []).append(one)
    return [
        (first, tuple(str(other.values["run"]) for other in others if "run" in other.values))
        for first, *others in groups.values()
    ]


def sentences(messages: Iterable[Message], form: Form = "command") -> list[str]:
    """Return the sentences of messages, equal findings over runs as one, each sentence once."""
    return [text if not do else f"{text}. {do}" for text, do in _parts(messages, form)]


def blocks(messages: Iterable[Message], form: Form = "command") -> list[str]:
    """Return messages as `sentences` does, but each remedy on a separate line, below the last finding that has it."""
    parts = _parts(messages, form)
    later = [{do for _, do in parts[at + 1 :]} for at in range(len(parts))]
    return [
        f"{text}\n  {do}." if do and do not in others else text for (text, do), others in zip(parts, later, strict=True)
    ]


def _parts(messages: Iterable[Message], form: Form) -> list[tuple[str, str]]:
    """Return finding and remedy of each message that differs in more than its run and its numbers."""
    items = list(messages)
    groups = {id(first): also for first, also in grouped(one for one in items if isinstance(one, Finding))}
    parts = []
    for one in items:
        if isinstance(one, str):
            parts.append((one, ""))
        elif id(one) in groups:
            do = remedy(one, form)
            parts.append((statement(one, groups[id(one)]), do[:1].upper() + do[1:]))
    return list(dict.fromkeys(parts))


def row_of(finding: Finding) -> dict[str, Any]:
    """Return a finding with its sentence and its remedy, as `--json` has it."""
    return {**vars(finding), "message": statement(finding), "remedy": remedy(finding)}
