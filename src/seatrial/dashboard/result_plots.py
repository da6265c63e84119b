"""Stored results for pages, from the files alone: nothing here knows a vehicle, so nothing heavy is imported."""

import re
import tempfile
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
from markupsafe import escape

from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import decoding, read_result
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset, write_dataset
from seatrial.core.errors import InputError
from seatrial.dashboard.view_models import EstimatedStructure
from seatrial.design.results import SweptDesigns
from seatrial.messages.render import sentences

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
