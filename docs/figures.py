"""Draw loop.svg, report.png and zigzag.png.

The first two are of the REMUS 100 demonstration, whose report Chromium photographs; the last is of measured zigzags of a ship model, and
needs SEATRIAL_DATA. Results that are there are read.
"""

import os
import re
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import seatrial as st
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.report.drawing import Drawing, draw, labels_of, record_curves, truth_of, units_of
from seatrial.report.figures.fit import draw_fit
from seatrial.report.figures.posterior import draw_marginal
from seatrial.report.figures.style import (
    BLUE,
    FONT,
    INK,
    MUTED,
    NARROW,
    PALETTE,
    PAPER,
    label_axes,
    new_figure,
    own_settings,
    sized_figure,
    style_axes,
)
from seatrial.report.labels import label_mathtext
from seatrial.report.sections.designs import sweep_drawings
from seatrial.report.sections.fits import first_run
from seatrial.report.sections.parameters import prior_of
from seatrial.report.term_figures import term_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOCS = Path(__file__).parent
DEMO, SHIP = (DOCS.parent / "outputs" / name for name in ("remus100", "ship_yaw"))
COLUMNS, GAP, TITLE = 2, 16, 22
BROWSER = Path("/usr/bin/chromium")
SCREEN = {"width": 1100, "height": 970}
"""Of the report's first screen, pixels."""


def main() -> None:
    """Write the pictures; without Chromium or the data only those that need neither, and say so."""
    st.configure()
    if os.environ.get("SEATRIAL_DATA"):
        SHIP.mkdir(parents=True, exist_ok=True)
        shutil.copy(DOCS.parent / "examples" / "ship_yaw" / "campaign.toml", SHIP)
        with own_settings():
            zigzag(st.run_loop(st.load_campaign(SHIP))).savefig(DOCS / "zigzag.png", dpi=130, facecolor=PAPER)
    else:
        print("SEATRIAL_DATA is not set: docs/zigzag.png was not drawn again")
    demo = Path(sys.argv[1]) if len(sys.argv) > 1 else DEMO
    if not (demo / "campaign.toml").exists():
        st.init_campaign(demo, "remus100")
    outcome = st.run_loop(st.load_campaign(demo))
    (DOCS / "loop.svg").write_text(sheet(panels(outcome)), encoding="utf-8")
    if not BROWSER.exists():
        sys.exit(f"there is no {BROWSER}: docs/report.png was not drawn again")
    photograph(st.write_report(outcome), DOCS / "report.png")


def photograph(report: Path, picture: Path) -> None:
    """Write the first screen of a report as PNG."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=str(BROWSER), args=["--no-sandbox"])
        page = browser.new_page(viewport=SCREEN, color_scheme="light")
        page.goto(report.resolve().as_uri())
        page.screenshot(path=str(picture))
        browser.close()


def zigzag(outcome: Outcome) -> "Figure":
    """Draw the held-back run that moves most beside the values to quote.

    Each value stands over a tenth of the standard deviation of its prior: in this campaign, the value with which its force alone would
    make all of the motion.
    """
    from matplotlib.collections import Collection
    from matplotlib.lines import Line2D

    index = first_run(outcome)
    runs = [*outcome.trials.fit, *outcome.trials.predict]
    time, channels, controls = record_curves(outcome, index, runs[index])
    figure = sized_figure(720, 290)
    boxes = (0.075, 0.36, 0.42, 0.53), (0.075, 0.14, 0.42, 0.17), (0.62, 0.14, 0.36, 0.75)
    yaw, rudder, values = (style_axes(figure.add_axes(box)) for box in boxes)
    draw_fit([yaw, rudder], time, channels[1:2], controls[:1], held_back=True)
    yaw.set_xlim(rudder.get_xlim())
    yaw.tick_params(labelbottom=False)
    dots, *others = yaw.get_legend_handles_labels()[0]
    assert isinstance(dots, Collection)
    dots = Line2D([], [], color=tuple(dots.get_edgecolor()[0]), linewidth=3, label="measured")
    yaw.legend(
        handles=[dots, *others], loc="upper right", ncols=3, fontsize=8, frameon=False, bbox_to_anchor=(1.0, 1.1)
    )
    yaw.set_title("Zigzag 25/5, held back", loc="left", fontsize=FONT, color=INK, fontweight="bold", pad=14)
    rows = [row for row in outcome.summary.quote if row.name in outcome.chosen.structure.terms]
    whole = [float(outcome.chosen.data.sel(parameter=row.name)["prior_sd"].values) / 10 for row in rows]
    place = np.arange(len(rows))[::-1]
    mean, sd = (np.array([getattr(row, part) for row in rows]) / whole for part in ("mean", "sd"))
    values.axvline(0.0, color=MUTED, linewidth=0.8)
    values.errorbar(mean, place, xerr=sd, fmt="o", color=BLUE, markersize=4, elinewidth=1.5, capsize=2.5)
    values.set_yticks(place, [label_mathtext(labels_of(outcome)[row.name]) for row in rows], fontsize=FONT)
    values.set_ylim(-0.7, len(rows) - 0.3)
    values.margins(x=0.08)
    values.set_title("Coefficients ± 1 sd", loc="left", fontsize=FONT, color=INK, fontweight="bold", pad=14)
    label_axes(values, "force or moment, 1 if it makes all of the motion alone")
    return figure


def panels(outcome: Outcome) -> list[tuple[str, Drawing]]:
    """The loop in four pictures, with their headings."""
    terms = term_figures(outcome.campaign.units, outcome.selection, None, None)[0]
    return [
        (
            "1. The most informative doublet (entropy reduction, nat)",
            sweep_drawings(outcome, outcome.first, "first")[0],
        ),
        ("2. Quadratic drag before and after the trial", posterior_of(outcome, "X_uabsu")),
        ("3. Which terms the data support", draw(terms.figure, "terms", terms.heading)),
        ("4. What to run next", sweep_drawings(outcome, outcome.next, "next")[1]),
    ]


def posterior_of(outcome: Outcome, name: str) -> Drawing:
    """Draw one parameter of the chosen structure over its prior."""
    row = outcome.chosen.data.sel(parameter=name)
    item = next(item for item in outcome.summary.coefficients if item.name == name)
    figure, (axes,) = new_figure(NARROW, [128], left=14, right=14, bottom=38)
    draw_marginal(
        axes,
        outcome.chosen.draws([name])[:, 0],
        label_mathtext(labels_of(outcome)[name]),
        units_of(outcome)[name],
        prior=prior_of(outcome, name),
        interval=(item.lower_95, item.upper_95),
        normal=(float(row["mode"]), float(row["laplace_sd"])),
        truth=truth_of(outcome).get(name),
    )
    return draw(figure, "posterior", f"Posterior of {name}")


def sheet(drawings: list[tuple[str, Drawing]]) -> str:
    """Arrange drawings in columns on white, in the light palette."""
    sizes = [size_of(drawing) for _, drawing in drawings]
    width = max(w for w, _ in sizes)
    rows = [sizes[i : i + COLUMNS] for i in range(0, len(sizes), COLUMNS)]
    heights = [max(h for _, h in row) + TITLE + GAP for row in rows]
    body = []
    for index, ((title, drawing), (w, h)) in enumerate(zip(drawings, sizes, strict=True)):
        x, y = GAP + index % COLUMNS * (width + GAP), GAP + sum(heights[: index // COLUMNS])
        body.append(f'<text x="{x:g}" y="{y + 13:g}" font-size="13" font-weight="600" fill="{ink()}">{title}</text>')
        body.append(
            str(drawing.svg).replace("<svg ", f'<svg x="{x:g}" y="{y + TITLE:g}" width="{w:g}" height="{h:g}" ', 1)
        )
    total = (COLUMNS * (width + GAP) + GAP, sum(heights) + GAP)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 {total[0]:g} {total[1]:g}"'
    text = "".join(
        [f'{head} font-family="sans-serif"><rect width="100%" height="100%" fill="#ffffff"/>', *body, "</svg>\n"]
    )
    text = text.replace("var(--figure-font)", "sans-serif")
    return re.sub(r"var\(--([a-z]+)\)", lambda match: PALETTE[match[1]][0], text)


def size_of(drawing: Drawing) -> tuple[float, float]:
    """Width and height, points."""
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', drawing.svg)
    assert box is not None
    return float(box[1]), float(box[2])


def ink() -> str:
    """Colour of text."""
    return PALETTE["ink"][0]


if __name__ == "__main__":
    main()
