"""Draw the pictures of the README: runs the REMUS 100 demonstration (or reads it) and writes SVG files beside this one."""

import re
from pathlib import Path

import seatrial as st
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.report.drawing import Drawing
from seatrial.report.figures.style import PALETTE
from seatrial.report.sections import designs, models, posteriors

DOCS = Path(__file__).parent
DEMO = DOCS.parent / "outputs" / "remus100"
COLUMNS, GAP, TITLE = 2, 16, 22


def main() -> None:
    """Write all pictures."""
    st.configure()
    if not (DEMO / "campaign.toml").exists():
        st.init_campaign(DEMO, "remus100")
    outcome = st.run_loop(st.load_campaign(DEMO))
    (DOCS / "loop.svg").write_text(sheet(panels(outcome)), encoding="utf-8")


def panels(outcome: Outcome) -> list[tuple[str, Drawing]]:
    """The loop in four pictures, with their headings."""
    marginals = posteriors.posteriors_section(outcome)["figures"]
    quadratic = outcome.chosen.names.index("X_uabsu")
    return [
        (
            "1. Which doublet teaches most (entropy reduction, nat)",
            designs.sweep_drawings(outcome, outcome.first, "first")[0],
        ),
        ("2. What the trial taught about quadratic drag", marginals[quadratic]),
        ("3. Which terms the data support", models.models_section(outcome)["figures"][1]),
        ("4. What to run next", designs.sweep_drawings(outcome, outcome.next, "next")[1]),
    ]


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
