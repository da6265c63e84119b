"""What a log is to a campaign, and the channel map that is drafted for it; the campaign file stays as it is."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.campaign.config.templates import has_placeholders
from seatrial.campaign.config.toml_edit import written_tables
from seatrial.cli.campaign_text import read_file
from seatrial.core.errors import SeatrialError
from seatrial.dashboard import channel_map
from seatrial.dashboard.channel_map import File

if TYPE_CHECKING:
    from seatrial.dashboard.logs import Column, Looked

CHANGE, OWN_FIT, OWN_PREDICT, FILE, INSTEAD = "change", "fit", "predict", "file", "instead"
"""What a log is: one that the map reads, a run with a separate map, a further file of a run, or a run in the place of all."""


@dataclass
class MapDraft:
    """A channel map as it stands in the form, of one log or more.

    Attributes:
        folder: of the campaign.
        saved: text of the campaign file as it was last read or written.
        files: the map of the form.
        others: logs that only other runs read, which are kept.
        logs: what was found in each previewed log, by its path from the folder.
        purpose: what the log is.
        purposes: what it may be, in words.
        label: of the run.
        reader: run that read the log before; empty if none did.
        begun_with: purpose, label and `files` as they were before anybody chose or typed; None before. A purpose that somebody chose is "".
        dropped: logs whose map was begun and is not kept, since the log that was previewed last is no part of it.
    """

    folder: Path
    saved: str = ""
    files: list[File] = field(default_factory=list)
    others: list[File] = field(default_factory=list)
    logs: "dict[str, Looked]" = field(default_factory=dict)
    purpose: str = CHANGE
    purposes: dict[str, str] = field(default_factory=dict)
    label: str = ""
    reader: str = ""
    begun_with: tuple[str, str, list[File]] | None = None
    dropped: tuple[str, ...] = ()

    @property
    def channels(self) -> dict[str, dict[str, Any]]:
        """Channels of the map by name, as `channels_of`."""
        return channel_map.channels_of(self.files)

    @property
    def is_own(self) -> bool:
        """Whether the map is that of one run alone."""
        return self.purpose in (OWN_FIT, OWN_PREDICT)

    @property
    def columns(self) -> "dict[str, tuple[str, Column]]":
        """Columns that a channel may have, by key, each with its log."""
        return {
            f"{log}|{one.table}|{one.name}": (log, one)
            for log, looked in self.logs.items()
            for one in looked.columns
            if one.table in looked.heads and one.spread
        }

    def clocks_of(self, log: str, runs: Sequence[str]) -> dict[str | None, str]:
        """Return the column of time that the map names for each table of a log, which may not have been previewed yet."""
        try:
            files = self.files or channel_map.files_of(read_file(self.folder))
        except SeatrialError:  # shown by the other forms
            return {}
        mine = [one for one in files if log in {channel_map.path_of(one, run) for run in runs or ("",)}]
        clocks = {one.get("table"): str(one.get("time", {}).get("column") or "") for one in mine}
        return {table: column for table, column in clocks.items() if column}

    @property
    def is_begun(self) -> bool:
        """Whether somebody has chosen what the log is, typed a name or changed the map since that was drawn or saved."""
        return self.begun_with is not None and (self.purpose, self.label, self.files) != self.begun_with

    def keep(self, is_chosen: bool = False) -> None:
        """Take the draft as it is for the one that nobody has changed, but for a purpose that somebody chose."""
        self.begun_with = "" if is_chosen else self.purpose, self.label, self.files

    def choose(self, purpose: str) -> bool:
        """Make the draft that of a run of another purpose; returns whether that is possible with the map as it is."""
        is_possible = not self.reader and {self.purpose, purpose} <= {OWN_FIT, OWN_PREDICT, INSTEAD}
        if is_possible:
            self.purpose = purpose
        return is_possible

    def add(self, name: str, log: "Looked", purpose: str | None = None) -> tuple[str, ...]:
        """Take a log into the map, with the channels that its columns seem to hold; logs that were previewed before stay choices.

        A log goes on with the run that was begun, if somebody chose, typed or changed something of it, or if each of the two has channels
        that the other lacks.

        Args:
            name: path of the log from the campaign's folder.
            log: what was found in it.
            purpose: what the log is; None for what it seems to be.

        Returns:
            the logs whose place it takes in the map.
        """
        if not self.logs:
            self.saved = read_file(self.folder)
            self.files = channel_map.files_of(self.saved)
        lost = tuple(one for one in self.logs if one != name) if self.is_begun or self.is_own else ()
        self.logs[name], self.dropped = log, ()
        gone, is_begun_again = self._begin(name, log, purpose)
        mapped = self.channels
        for one in log.guesses:
            if one.channel not in mapped:
                head = self.head(name, one.table)
                values = {"unit": one.unit, "scale": None if one.scale == 1.0 else one.scale, "between": one.between}
                mapped_column = channel_map.Mapped(head, one.column, values)
                self.files = channel_map.with_channel(self.files, one.channel, mapped_column)
        if is_begun_again:
            self.dropped = lost
            self.keep(is_chosen=purpose is not None)
        return gone

    def _begin(self, name: str, log: "Looked", purpose: str | None) -> tuple[tuple[str, ...], bool]:
        """Begin the map by what a log is to the campaign, or go on with it.

        Returns:
            the logs whose place it takes, and whether the map was begun again.
        """
        saved, runs = channel_map.files_of(self.saved), channel_map.runs_of(self.saved)
        readers = channel_map.runs_reading(self.saved, name)
        if self._is_example(saved, runs):
            self.label = self._run_of(name)
            if has_placeholders(written_tables("import.files", self.files)):
                self.files = []
            self.files, gone = channel_map.with_newer_log(self.files, name, log, runs)
            return gone, self.begun_with is None
        if readers and purpose is None and self.is_begun and self.purpose in (CHANGE, FILE):
            return (), False
        whose = (readers or runs)[0]
        mine, others = channel_map.map_of_run(saved, whose)
        if readers:
            of_log = [one for one in mine if channel_map.path_of(one, whose) == name]
            has_all = all(channel_map.has_columns(log, one) for one in of_log)
            sharers = [one for one in runs if channel_map.map_of_run(saved, one)[0] == mine]
            self.purposes = {CHANGE: f"run {whose}, by the map of run {', '.join(sharers)}"}
            if len(sharers) > 1:
                self.purposes[OWN_FIT] = f"run {whose}, with a separate map"
            usual = CHANGE if has_all or len(sharers) == 1 else OWN_FIT
        else:
            mapped, guessed = channel_map.channels_of(mine), {one.channel for one in log.guesses}
            own = self._own_map(mine, name, log, runs)
            has, there = guessed | channel_map.channels_of(own).keys(), self.channels.keys()
            goes_on = self.is_begun or (self.is_own and bool(has - there) and bool(there - has))
            self.purposes = {
                OWN_FIT: "another run, to fit, with a separate map",
                OWN_PREDICT: "another run, held back to predict, with a separate map",
                FILE: f"a further file of run {whose if others else ', '.join(runs)}",
                INSTEAD: f"the only run, instead of {', '.join(runs)}",
            }
            usual = FILE if guessed and guessed.isdisjoint(mapped) else OWN_FIT
            if purpose is None and goes_on:
                self.purpose = FILE if self.purpose == CHANGE else self.purpose
                if self.purpose != FILE and all(one.get("path") != name for one in self.files):
                    self._add_own(own)
                return (), False
        self.purpose, self.others, self.reader = purpose or usual, others, whose if readers else ""
        self.label = self._run_of(name)
        if self.purpose in (CHANGE, FILE):
            self.files = mine
            return (), True
        self.logs = {name: log}
        if readers:
            mine = [{**one, "path": channel_map.path_of(one, whose)} for one in mine]
        self.files = self._own_map(mine, name, log, runs)
        return (), True

    def _own_map(self, earlier: list[File], name: str, log: "Looked", runs: Sequence[str]) -> list[File]:
        """Return the map of a log alone, after that of an earlier log of which it has every column; empty if there is none."""
        newer, _ = channel_map.with_newer_log(earlier, name, log, runs)
        own = [one for one in newer if one.get("path") == name]
        return own if all(channel_map.has_columns(log, one) for one in own) else []

    def _add_own(self, own: list[File]) -> None:
        """Add the map of a further log of the run, without the channels that another of its logs has."""
        for channel in self.channels.keys() & channel_map.channels_of(own).keys():
            own = channel_map.with_channel(own, channel, None)
        self.files = [*self.files, *own]

    def _is_example(self, files: list[File], runs: Sequence[str]) -> bool:
        """Whether a map names no log that may exist, as that of a template, or that of no run; a variable in a name is not looked up."""
        paths = [channel_map.path_of(one, run) for one in files for run in runs]
        return not any(any(mark in path for mark in "$~") or (self.folder / path).exists() for path in paths)

    def _run_of(self, name: str) -> str:
        """Return the run that a log is, as the campaign names it or as the names of the logs tell it."""
        if self.purpose == FILE:
            return channel_map.runs_of(self.saved)[0]
        if readers := channel_map.runs_reading(self.saved, name):
            return readers[0]
        further = channel_map.further_run(self.saved, name)
        return further.label if further else re.sub(r"[^A-Za-z0-9_-]", "_", Path(name).stem)[:40] or "run"

    def named(self, log: str) -> str:
        """Return the path by which the map names a log, which may have `{run}`; that of the log where it does not name it."""
        run = self.reader or "{run}"
        return next((str(one.get("path")) for one in self.files if channel_map.path_of(one, run) == log), log)

    def head(self, log: str, table: str) -> File:
        """Return the `[[import.files]]` of a table of a log without channels, by the path by which the map names the log."""
        return {**self.logs[log].heads[table], "path": self.named(log)}

    def file_of(self, log: str, table: str) -> dict[str, Any]:
        """Return what the map says of a table of a log, as its `[[import.files]]`; where it says nothing, what the log itself tells."""
        own = self.logs[log].heads[table]
        identity = self.named(log), own.get("table")
        entry = next((one for one in self.files if channel_map.identity_of(one) == identity), {})
        return {**own, **entry, "time": {**own["time"], **entry.get("time", {})}}

    def head_of(self, channel: str) -> File:
        """Return the `[[import.files]]` that a channel of the map stands in, without channels: as the campaign file names it."""
        mapped = self.channels[channel]
        return {key: mapped[key] for key in ("path", "table") if mapped[key] is not None}

    def quantity_of(self, key: str) -> str:
        """Return the channel of a column, by the map or by a guess; its name if there is none."""
        log, column = self.columns[key]
        mapped = {(str(one["path"]), one.get("column")): name for name, one in self.channels.items()}
        guessed = self.logs[log].quantities.get((column.table, column.name))
        return mapped.get((self.named(log), column.name)) or guessed or column.name

    def further(self, name: str) -> channel_map.FurtherRun | None:
        """Return the run that a log is by the saved map as it stands; None if that asks for other columns, or names do not tell it."""
        has_all = all(channel_map.has_columns(self.logs[name], one) for one in channel_map.files_of(self.saved))
        return channel_map.further_run(self.saved, name) if has_all else None

    def replaced(self) -> str:
        """Return what saving does to the runs and logs that the campaign file names; nothing if it replaces none."""
        run, runs, saved = self.label, channel_map.runs_of(self.saved), channel_map.files_of(self.saved)
        if self._is_example(saved, runs):
            return ""
        before = _logs_of(saved, run)
        if self.is_own and run in runs:
            return f"Saving gives run {run} this map instead of that of {', '.join(before)}."
        if self.is_own:
            where = "to fit" if self.purpose == OWN_FIT else "held back to predict"
            return f"Saving adds run {run}, {where}, with this map. Run {', '.join(runs)} keeps its map."
        if run in runs:
            kept = {channel_map.path_of(one, run) for one in self.files}
            lost = ", ".join(one for one in before if one not in kept)
            return f"Saving takes {lost} out of the map of run {run}." if lost else ""
        logs = dict.fromkeys(log for label in runs for log in _logs_of(saved, label))
        return (
            f"Saving removes run {', '.join(runs)} from the campaign file, with the map of {', '.join(logs)}. "
            f"Run {run} is then the only run, to fit."
        )

    def is_saved(self, files: list[File]) -> bool:
        """Whether the campaign file gives the run this map."""
        saved = channel_map.map_of_run(channel_map.files_of(self.saved), self.label)[0]
        return self.label in channel_map.runs_of(self.saved) and saved == files

    def text(self) -> str:
        """Return the campaign file with the map, by what the log is; errors as `with_map` and `with_own_map`."""
        if self.is_own:
            return channel_map.with_own_map(self.folder, self.saved, self.label, self.purpose, self.files)
        has_others = self.purpose != INSTEAD and self.label in channel_map.runs_of(self.saved)
        files = [*self.others, *self.files] if has_others and self.files else self.files
        return channel_map.with_map(self.folder, self.saved, self.label, files)


def _logs_of(files: list[File], run: str) -> list[str]:
    """Return the paths of the logs that a run reads, each once, in their order."""
    return list(dict.fromkeys(channel_map.path_of(one, run) for one in channel_map.map_of_run(files, run)[0]))
