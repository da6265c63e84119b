"""Equations as SVG drawn by matplotlib: no script from elsewhere, no LaTeX, and the colour of the text around them."""

import io
import re

from docutils import nodes
from matplotlib import rcParams
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.path import Path as Outline
from matplotlib.textpath import TextPath

NAME = "mathtext"
SIZE = 16.0
"""Size of the letters, pixels, for text of the same size."""


def register(app) -> None:
    """Make this the way in which `html_math_renderer` draws."""
    app.add_html_math_renderer(NAME, inline_renderers=(_inline, None), block_renderers=(_block, None))


def equation_svg(tex: str) -> tuple[str, float]:
    """One equation, and how far it reaches below the line of writing, pixels.

    Raises:
        ValueError: TeX that matplotlib cannot draw.
    """
    text = f"${tex.strip()}$"
    rcParams["mathtext.fontset"] = "cm"
    parsed = MathTextParser("path").parse(text, 72, FontProperties(size=SIZE))
    width, height, depth = float(parsed.width), float(parsed.height), float(parsed.depth)
    outline = _as_svg_path(TextPath((0.0, 0.0), text, size=SIZE))
    pad = 1.0
    box = f"{-pad:g} {-(height - depth) - pad:.2f} {width + 2 * pad:.2f} {height + 2 * pad:.2f}"
    label = tex.strip().replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    size = f'width="{(width + 2 * pad) / SIZE:.3f}em" height="{(height + 2 * pad) / SIZE:.3f}em"'
    return f'<svg {size} viewBox="{box}" role="img" aria-label="{label}"><path d="{outline}"/></svg>', depth + pad


def _as_svg_path(path: Outline) -> str:
    """Commands of SVG, y pointing downwards."""
    commands = {
        Outline.MOVETO: "M",
        Outline.LINETO: "L",
        Outline.CURVE3: "Q",
        Outline.CURVE4: "C",
        Outline.CLOSEPOLY: "Z",
    }
    out = io.StringIO()
    for points, code in path.iter_segments(curves=True, simplify=False):
        letter = commands[code]
        pairs = [f"{points[i]:.2f} {-points[i + 1]:.2f}" for i in range(0, len(points), 2)]
        out.write("Z" if letter == "Z" else letter + " ".join(pairs))
    return out.getvalue()


def _inline(translator, node) -> None:
    svg, depth = equation_svg(node.astext())
    translator.body.append(f'<span class="equation-inline" style="vertical-align:{-depth / SIZE:.3f}em">{svg}</span>')
    raise nodes.SkipNode


def _block(translator, node) -> None:
    lines = [line for line in re.split(r"\\\\", node.astext()) if line.strip()]
    drawn = "<br>".join(equation_svg(line.replace(r"\frac", r"\dfrac"))[0] for line in lines)
    translator.body.append(f'<div class="equation">{drawn}</div>')
    raise nodes.SkipNode
