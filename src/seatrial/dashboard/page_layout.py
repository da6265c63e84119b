"""The frame of every page: where you are, the views of a campaign, what is at work, and light, dark or sunlight colours."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlencode

from markupsafe import Markup, escape
from nicegui import ui

from seatrial.core.visible import visible
from seatrial.dashboard.app_context import AppContext, change_of, fill, keep_current, markup, say
from seatrial.dashboard.next_step import NextStep, find_next_step
from seatrial.dashboard.run_bar import RunBar
from seatrial.report.glossary import with_meanings

VIEWS = {
    "import": "Records",
    "model": "Model",
    "design": "Design",
    "live": "Live",
    "run": "Run",
    "results": "Results",
    "tweak": "Tweak",
    "compare": "Compare",
    "report": "Report and export",
    "file": "Campaign file",
}
"""Views of a campaign, in the order of the work."""
_THEME = """<script>
(function () {
  const root = document.documentElement, dark = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = "";
  root.lang = "en";
  try { chosen = localStorage.getItem("seatrial-theme") || ""; } catch (e) {}
  const show = () => { root.dataset.theme = chosen || (dark.matches ? "dark" : "light"); };
  const mark = () => document.querySelectorAll(".theme").forEach((one) => { one.value = chosen; });
  show();
  dark.addEventListener("change", show);
  window.seatrialTheme = function (theme) {
    chosen = theme;
    try { localStorage.setItem("seatrial-theme", theme); } catch (e) {}
    show();
  };
  const showView = () => document.querySelectorAll("nav a[aria-current]").forEach((one) => {
    one.closest("ul").scrollLeft = one.offsetLeft - one.closest("ul").clientWidth / 2;
  });
  window.addEventListener("load", () => setTimeout(() => { mark(); showView(); }, 0));
})();
</script>"""


def link(view: str, campaign: str = "", **more: str) -> str:
    """Address of a view."""
    query = urlencode({"campaign": campaign, **more}) if campaign else ""
    return f"/{view}" + (f"?{query}" if query else "")


def links_html(links: Iterable[tuple[str, str]]) -> Markup:
    """Return links in a row, each by its address and its words."""
    made = Markup("").join(Markup('<a href="{}">{}</a>').format(address, words) for address, words in links)
    return Markup('<p class="links">{}</p>').format(made)


@contextmanager
def frame(
    context: AppContext, view: str, campaign: str = "", folder: Path | None = None, title: str = ""
) -> Iterator[None]:
    """Lay out a page around the block.

    Args:
        context: what is served.
        view: key of `VIEWS`, or empty for the overview.
        campaign: its name below the root.
        folder: of the campaign, to show what is at work on it.
        title: of the page; that of the view where none is given.
    """
    ui.add_head_html(_THEME)
    title = title or VIEWS.get(view, "New campaign" if view == "new" else "Campaigns")
    place = campaign if campaign not in ("", ".") else context.campaign_paths.root.name
    ui.page_title(visible(f"{title} · {place} · seatrial"))
    markup('<a class="skip" href="#main">Skip to the content</a>')
    with ui.element("header").classes("top"):
        markup(_top(context, campaign))
    if folder is not None:
        RunBar(context, folder, link("run", campaign))
    if campaign:
        links = Markup("").join(
            Markup('<li><a href="{}"{}>{}</a></li>').format(
                link(key, campaign), Markup(' aria-current="page"') if key == view else "", name
            )
            for key, name in VIEWS.items()
        )
        markup(Markup('<nav aria-label="Views of the campaign"><ul>{}</ul></nav>').format(links))
    with ui.element("div").props('id=main tabindex="-1"'):  # NiceGUI lays a <main> around the whole page
        markup(Markup("<h1>{}</h1>").format(title))
        yield


async def next_part(context: AppContext, view: str, campaign: str, folder: Path) -> None:
    """Show the next step of a campaign in one line, with a link to where it is done, and keep that up to date.

    Nothing is shown while a command runs: the bar says that.
    """

    async def show() -> None:
        if not context.look(folder).running:
            asked = find_next_step(context, folder)
            await fill(ui.element("div"), asked, lambda step: markup(next_html(step, view, campaign)), "next step …")

    await keep_current(lambda: (change_of(folder), context.look(folder).running), show)


def next_html(step: NextStep, view: str, campaign: str) -> Markup:
    """Return the next step in one line; without a link on the view where it is done."""
    words = Markup('<p class="next"><strong>Next step</strong> {}{}</p>')
    there = f'<a href="{{}}">{VIEWS[step.view]}</a>'
    return words.format(
        step.words, Markup(": " + there).format(link(step.view, campaign)) if step.view != view else "."
    )


def missing_page(context: AppContext, error: BaseException | str) -> None:
    """Build the page of an address behind which there is nothing: what is missing, in words, and the way back to the start page."""
    with frame(context, "", title="Not found"):
        say(error)
        markup(links_html([("/", "Back to the campaigns")]))


@contextmanager
def section(title: str, note: str = "") -> Iterator[ui.element]:
    """A titled part of a page."""
    with ui.element("section") as part:
        markup(
            Markup("<h2>{}</h2>").format(title)
            + (with_meanings(Markup('<p class="note">{}</p>').format(note)) if note else "")
        )
        yield part


LOOK = "outlined options-dense hide-bottom-space"
"""Properties of a field."""


def button(words: str, action, *, main: bool = False) -> ui.button:
    """A button that reads as what it does."""
    kind = "unelevated color=primary text-color=paper" if main else "outline color=primary"
    return ui.button(words, on_click=action).props(f"no-caps {kind}").classes("button")


LONG = 40
"""Characters from which a cell is text that may be broken over lines."""


def table(
    head: list[str], rows: list[list[str | Markup]], caption: str = "", left: int = 1, stacks: bool = False
) -> Markup:
    """A table that scrolls inside its own frame; the first `left` columns are text, as is every column with a long cell.

    One that `stacks` shows on a narrow screen each row as a block, every cell under the head of its column.
    """
    long = {i for row in rows for i, cell in enumerate(row) if len(escape(cell).striptags()) > LONG}

    def cells(row: list[str | Markup], tag: str) -> Markup:
        parts = []
        for i, cell in enumerate(row):
            kind = "th" if i == 0 or tag == "th" else "td"
            scope = Markup(' scope="{}"').format("col" if tag == "th" else "row") if kind == "th" else ""
            parts.append(
                Markup("<{}{}{}{}>{}</{}>").format(
                    Markup(kind),
                    scope,
                    Markup(' class="text"') if i < left or i in long else "",
                    Markup(' data-head="{}"').format(head[i]) if stacks and kind == "td" else "",
                    cell,
                    Markup(kind),
                )
            )
        return Markup("<tr>{}</tr>").format(Markup("").join(parts))

    body = Markup("").join(cells(row, "td") for row in rows)
    title = Markup("<caption>{}</caption>").format(caption) if caption else ""
    made = Markup(
        '<div class="scroll" tabindex="0" role="region" aria-label="{}"><table{}>{}<thead>{}</thead><tbody>{}</tbody></table></div>'
    ).format(caption or "table", Markup(' class="stacks"') if stacks else "", title, cells(list(head), "th"), body)
    return with_meanings(made)


def _top(context: AppContext, campaign: str) -> Markup:
    place = context.campaign_paths.root.name if campaign in ("", ".") else campaign
    return Markup(
        '<a class="brand" href="/">seatrial</a><span class="place" title="{}">{}</span>'
        '<select class="theme" aria-label="Colours" onchange="seatrialTheme(this.value)"><option value="">As the system</option>'
        '<option value="light">Light</option><option value="dark">Dark</option><option value="sun">Sunlight</option></select>'
    ).format(context.campaign_paths.root, place if campaign else "")
