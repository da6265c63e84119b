"""The campaign file as text: all of it, also what no form has a field for, and a file that can no longer be read as a campaign."""

import asyncio
import re
from difflib import unified_diff
from functools import partial
from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.cli.campaign_text import CAMPAIGN, read_file, write_file
from seatrial.core.errors import SeatrialError
from seatrial.dashboard.app_context import AppContext, cautions_html, error_html, keep_form, markup, say, saying
from seatrial.dashboard.page_layout import button, link, section

_MARK = """(() => {{
  const area = document.querySelector("#main textarea"), lines = area.value.split("\\n"), at = {line} - 1;
  const start = lines.slice(0, at).join("\\n").length + (at > 0);
  area.focus();
  area.setSelectionRange(start, start + lines[at].length);
  area.scrollTop = Math.max(0, at - 3) * area.scrollHeight / lines.length;
}})()"""
"""Script that selects a line of the text and brings it into sight."""
_ASK = 'window.onbeforeunload = (e) => { e.preventDefault(); e.returnValue = "unsaved"; }'
"""Script by which the browser asks before it leaves the page."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    words = "All keys, also those without a field in a form. The whole file is checked before it is written."
    with section(str(folder.name) + "/" + CAMPAIGN, words):
        messages = ui.element("div")
        await keep_form(
            folder / CAMPAIGN,
            lambda: asyncio.to_thread(read_file, folder),
            partial(FileForm, context, campaign, folder, messages),
        )
        messages.move()


class FileForm:
    """A field that holds the whole file; it is checked as a whole before anything is written.

    Args:
        context: what is served.
        campaign: name of the campaign below the root.
        folder: of it.
        said: element for what is said; it stays when the form is built again, as after each save.
        text: of the file.
    """

    def __init__(self, context: AppContext, campaign: str, folder: Path, messages: ui.element, text: str) -> None:
        self.context, self.campaign, self.folder, self.said, self.seen = context, campaign, folder, messages, text
        self.text = ui.textarea("campaign.toml, as TOML", value=text).props('outlined spellcheck="false"')
        self.text.classes("mono wide whole").style("width: 100%")
        with ui.element("div").classes("line"):
            button("Check and save", self._save, main=True)
            button("Undo my changes", self._take_back)
        self.is_guarded = False
        self.text.on_value_change(self._guard)

    @property
    def is_edited(self) -> bool:
        """Whether something was typed that is not saved."""
        return self.text.value != self.seen

    def _guard(self) -> None:
        """Have the browser ask before it leaves the page while something is not saved."""
        if self.is_guarded != self.is_edited:
            self.is_guarded = self.is_edited
            ui.run_javascript(_ASK if self.is_guarded else "window.onbeforeunload = null")

    def _take_back(self) -> None:
        self.said.clear()
        self.text.value = self.seen

    async def _show_difference(self) -> None:
        """Show what saving would change of the file as it is now; from then on the typed text may take its place."""
        with saying(self.said):
            there = await asyncio.to_thread(read_file, self.folder)
            now, typed = there.splitlines(), str(self.text.value).splitlines()
            lines = "\n".join(unified_diff(now, typed, "the file as it is now", "your text", lineterm=""))
            self.seen = there
            self._guard()
            if not lines:
                markup('<p class="note" role="status">The file is now the same as your text.</p>')
                return
            words = (
                '<p class="note" role="status">"Check and save" writes your text: lines marked - are removed, lines marked + are added. '
                'To keep a line of the changed file, put it into your text first.</p><pre tabindex="0">{}</pre>'
            )
            markup(Markup(words).format(lines))

    async def _save(self) -> None:
        self.said.clear()
        text = str(self.text.value)
        try:
            cautions = await self.context.worker_pool.think("check", str(self.folder), text)
            there = await asyncio.to_thread(read_file, self.folder)
            if text != self.seen and there != self.seen:
                with self.said:
                    words = "The file was changed after you began. Your text stays in the field. Look at the differences before you save."
                    markup(error_html(words, "Nothing was written."))
                    button("Show the difference", self._show_difference, main=True)
                return
            if text != self.seen:
                write_file(self.folder, text, self.seen)
        except (SeatrialError, OSError) as error:
            with self.said:
                say(error)
            if line := re.search(rf"{re.escape(CAMPAIGN)}:(\d+)", str(error)):
                ui.run_javascript(_MARK.format(line=line[1]))
            return
        is_new, self.seen = text != self.seen, text
        self._guard()
        with self.said:
            if is_new:
                words = '<p class="done" role="status">Saved. Earlier results may be stale now: <a href="{}">run again</a>.</p>'
                markup(Markup(words).format(link("run", self.campaign)))
            else:
                markup('<p class="note" role="status">The file is valid. Nothing was changed.</p>')
            markup(cautions_html(cautions))
