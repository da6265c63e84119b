"""Stored results for pages, from the files alone: nothing here knows a vehicle, so nothing heavy is imported."""

import re
import tempfile
from contextlib import suppress
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
from markupsafe import escape

from seatrial.campaign.store.answer_cache import latest
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import Store, decoding, read_result
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset, write_dataset
from seatrial.core.errors import InputError
from seatrial.core.findings import LEVELS, Finding
from seatrial.dashboard.view_models import Checked, CheckedRecord, CheckRow, EstimatedStructure
from seatrial.design.results import SweptDesigns
from seatrial.messages.catalogue import ENTRIES, REMEDIES
from seatrial.messages.entry import filled_in
from seatrial.messages.render import remedy, sentences

# All that a report is made of: nothing of this runs, loads or sends anything.
_TAG = re.compile(
    "a|abbr|br|clippath|code|dd|defs|desc|details|div|dl|dt|figcaption|figure|g|h2|h3|i|li|ol|p|path|pattern|pre|rect|section|small|span"
    "|strong|sub|summary|sup|svg|table|tbody|td|text|th|thead|title|tr|tspan|ul|use"
)
_ATTRIBUTE = re.compile(
    "aria-[a-z]+|class|clip-path|colspan|d|data-head|fill|focusable|height|href|id|patternunits|role|scope|style|tabindex|title|transform"
    "|viewbox|width|x|xlink:href|y"
)
STYLES = ("clip-path", "fill", "style")
# A style that leads out of the page, or hides where it leads.
_OUTWARD = re.compile(r"url\((?!#)|\\", re.IGNORECASE)


def ready() -> bool:
    """Return True once everything is imported, also what reading a file imports."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "nothing.nc"
        write_dataset(path, Dataset({"nothing": ("name", np.zeros(1))}, {"name": ["nothing"]}))
        open_dataset(path)
    return True


def swept(path: Path) -> SweptDesigns:
    """Read a sweep.

    Raises:
        InputError: missing or damaged.
    """
    return read_result(SweptDesigns, path, "seatrial design")


def estimated(paths: tuple[Path, ...]) -> tuple[EstimatedStructure, ...]:
    """Read the parameters of stored posteriors, one file for each structure.

    Raises:
        InputError: missing or damaged.
    """
    structures = []
    for path in paths:
        estimate = read_result(Estimate, path, "seatrial estimate")
        with decoding(path, "seatrial estimate"):
            columns = (estimate.data[name].values.tolist() for name in ("label", "unit", "mean", "sd"))
            rows = tuple(
                (name, *row, estimate.causes.get(name, "")) for name, *row in zip(estimate.names, *columns, strict=True)
            )
        structure, remarks = estimate.structure, sentences(estimate.cause_findings)
        structures.append(EstimatedStructure(structure.label, structure.terms, rows, estimate.alarms, tuple(remarks)))
    return tuple(structures)


def checked(folder: Path) -> Checked | None:
    """Return what the last check said, each finding as a row, the gravest first; None if there was none, or one of another version."""
    path = Store(folder).answer("check")
    if (kept := latest(path)) is None:
        return None
    with suppress(InputError), decoding(path, "seatrial check"):
        told = kept[0]["told"]
        records = tuple(_checked_record(one, told["files"]) for one in told["result"]["records"])
        return Checked(records, tuple(told["cautions"]), kept[1])
    return None


def _checked_record(one: dict, files: dict) -> CheckedRecord:
    rows = [_check_row(row) for row in one["findings"] if row["level"] != "pass"]
    rows += [CheckRow("caution", "", text) for text in one["cautions"]]
    rows.sort(key=lambda row: LEVELS.index(row.level))  # pyright: ignore[reportArgumentType]
    picture = Path(files[f"raw plot of {one['label']}"]).name
    return CheckedRecord(one["label"], one["level"], (*rows, *_passed(one["findings"])), picture)


def _check_row(row: dict) -> CheckRow:
    """Return a finding as the page shows it: its remedy names fields of the dashboard."""
    finding = _finding(row)
    views = [view for name in finding.remedies if (view := REMEDIES[name].view)]
    return CheckRow(finding.level, finding.code, row["message"], remedy(finding, "page"), views[0] if views else "")


def _passed(rows: list[dict]) -> list[CheckRow]:
    """Return what passes, one row for each check, with all signals of which it does."""
    passed: dict[tuple[str, str], list[str]] = {}
    for finding in (_finding(row) for row in rows if row["level"] == "pass"):
        name = filled_in(ENTRIES[finding.code].template("pass"), finding.subject, finding.values)
        passed.setdefault((finding.code, name), []).extend(finding.subject)
    return [CheckRow("pass", code, f"{name} of {', '.join(of)}") for (code, name), of in passed.items()]


def _finding(row: dict) -> Finding:
    """Return a finding as it was before JSON made lists of its tuples."""

    def tuples(value):
        return tuple(map(tuples, value)) if isinstance(value, list) else value

    values = {name: tuples(value) for name, value in row["values"].items()}
    return Finding(row["code"], row["level"], tuple(row["subject"]), values, tuple(row["remedies"]))


def report_sections(path: Path) -> dict[str, str]:
    """Read the answer of a report and its sections, by id.

    The file may have come with a campaign from anybody, and a page of the dashboard may run scripts: so each tag is read, and written
    again with its text escaped.

    Raises:
        InputError: no report, or one that holds something else than reports do.
    """
    reader = _Sections(path)
    try:
        reader.feed(path.read_text(encoding="utf-8", errors="replace"))
    except FileNotFoundError:
        raise reader.refusal("no report") from None
    return {name: "".join(parts) for name, parts in reader.sections.items()}


class _Sections(HTMLParser):
    """Collects the parts of a report that are shown elsewhere."""

    def __init__(self, path: Path):
        super().__init__()
        self.path, self.sections, self.within = path, {}, []

    def refusal(self, found: str) -> InputError:
        """Return why the file is not shown."""
        remedy = "write it again under Report and export"
        return InputError(str(self.path), found=found, expected="the report of this campaign", remedy=remedy)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begin a part, or go on with one."""
        texts = {key: value or "" for key, value in attrs}
        if not self.within:
            if tag != "section" and texts.get("id") != "answer":
                return
            self.sections[texts.get("id", "")] = []
        for key, text in texts.items():
            leads_out = not text.startswith("#") if key.endswith("href") else key in STYLES and _OUTWARD.search(text)
            if not _ATTRIBUTE.fullmatch(key) or leads_out:
                raise self.refusal(f"<{tag}> with {key}={text[:40]}")
        if not _TAG.fullmatch(tag):
            raise self.refusal(f"<{tag}>")
        self._write("".join([f"<{tag}", *(f' {key}="{escape(text)}"' for key, text in texts.items()), ">"]))
        if tag != "br":
            self.within.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """End what was begun last."""
        if self.within and tag != "br":
            if self.within[-1] != tag:
                raise self.refusal(f"</{tag}> within <{self.within[-1]}>")
            self._write(f"</{tag}>")
            self.within.pop()

    def handle_data(self, data: str) -> None:
        """Write text."""
        if self.within:
            self._write(str(escape(data)))

    def _write(self, text: str) -> None:
        next(reversed(self.sections.values())).append(text)
