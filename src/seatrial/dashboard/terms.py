"""Terms that a model may have: their kinds by axis, and of each its equation and a drawing of the force and the motions."""

from collections.abc import Collection
from itertools import pairwise
from math import cos, radians, sin

from markupsafe import Markup

from seatrial.core.coefficients import AXES, CoefficientName
from seatrial.core.signals import ANGULAR_RATE, FORCE, SIGNALS, SPEEDS, motion_name
from seatrial.report.labels import label_html
from seatrial.report.numbers import unit_html

PRODUCTS = {
    "X": ("vr", "wq"),
    "Y": ("uv", "ur", "r", "uudelta_r"),
    "Z": ("uw", "uq", "q", "uudelta_s"),
    "K": ("uv", "ur"),
    "M": ("uw", "uq", "w", "uudelta_s"),
    "N": ("uv", "ur", "v", "uudelta_r"),
}
"""Products of motions and controls on which a force or moment often depends, in addition to its own motion."""
OF_PROPULSION = {
    "T_nabsn": "thrust of the propeller",
    "T_un": "loss of thrust with speed ahead",
    "T_f": "gain of the thrusters",
    "T_absf": "difference of thrust ahead and astern",
    "T_fdV": "effect of a volt on the thrust",
    "Q_nabsn": "torque of the propeller",
}
VIEWS = {"from above": "xyz", "from starboard": "xzy", "from astern": "yzx"}
"""Axes of a drawing to the right, down and through the paper."""
_ALONG = dict(zip("XYZKMNTQ", "xyzxyzxx", strict=True)) | dict(zip("uvwpqr", "xyzxyz", strict=True))
_TURNS = {"from above": 1, "from starboard": -1, "from astern": 1}
"""Sense in which a positive turn goes: 1 for that of a clock."""


def kinds_of(axis: str) -> dict[str, str]:
    """Return the usual terms of an axis, each with its meaning."""
    if axis not in SPEEDS:
        return {name: words for name, words in OF_PROPULSION.items() if name.startswith(axis)}
    own, force = SPEEDS[axis], "force" if AXES[axis][0] == FORCE else "moment"
    kinds = {
        f"{axis}_{own}": "linear damping",
        f"{axis}_{own}abs{own}": "quadratic damping",
        f"{axis}_{own}3": "cubic damping",
        f"{axis}_{own}dot": "added mass" if force == "force" else "added inertia",
        f"{axis}_0": f"constant {force}",
        f"{axis}_tau_{axis}": f"share of the commanded {force} that acts",
    }
    return kinds | {f"{axis}_{product}": _words_of(f"{axis}_{product}") for product in PRODUCTS[axis]}


def words_of(name: str) -> str:
    """Return the meaning of a term; empty if it is none of the usual ones."""
    return kinds_of(name[0]).get(name, "")


def usual_terms(moves: Collection[str], controls: Collection[str]) -> tuple[str, ...]:
    """Return the usual terms of a vehicle.

    Args:
        moves: speeds and rates that it has.
        controls: that drive it.
    """
    known = {*moves, *controls, *("f" for one in controls if one.startswith("f_"))}
    axes = [axis for axis in AXES if SPEEDS.get(axis) in {*moves, None}]
    return tuple(
        name for axis in axes for name in kinds_of(axis) if known.issuperset(CoefficientName.parse(name).signals)
    )


def term_html(name: str) -> Markup:
    """Return the equation of a term, its unit, and its drawing."""
    term = CoefficientName.parse(name)
    force = (
        label_html(term.axis)
        if term.axis in SPEEDS
        else Markup("{} ({})").format(label_html(term.axis), AXES[term.axis][1])
    )
    html = '<p class="equation">{} = … + {} {}</p><p class="note">Unit of {}: {}. {}</p>{}'
    product = label_html("".join(factor.label for factor in term.factors))
    symbols = [f"{one} is the {SIGNALS[one].meaning}" for one in term.signals]
    meanings = "; ".join([f"{term.axis} is the {AXES[term.axis][1]}", *symbols]) + "."
    return Markup(html).format(
        force, label_html(term.label), product, name, unit_html(term.unit), meanings, drawing_html(term)
    )


def drawing_html(term: CoefficientName) -> Markup:
    """Draw the vehicle with the positive directions of a force and of the motions that it depends on."""
    motions = [one for one in term.signals if one in SPEEDS.values()]
    view = max(VIEWS, key=lambda one: sum(_is_seen(part, one) for part in (*9 * term.axis, *motions)))
    right, down, _ = VIEWS[view]
    hull = '<circle r="24"/>' if "x" not in (right, down) else '<path d="M-62-12Q70-28 70 0Q70 28-62 12zM-62-20V20"/>'
    drawn = [_arrow(term.axis, view, "force", 0)]
    drawn += [_arrow(one, view, "motion", 1 + i) for i, one in enumerate(motions) if _is_seen(one, view)]
    said = [
        f"{term.axis}, {AXES[term.axis][1]}",
        *(f"{one}, {SIGNALS[one].meaning}" for one in motions if _is_seen(one, view)),
    ]
    caption = f"Seen {view}; positive directions of {'; '.join(said)}."
    caption += " Damping and added mass are below zero." if SPEEDS.get(term.axis) in motions else ""
    svg = '<figure class="term"><svg viewBox="-110 -62 220 124" role="img" aria-label="{}">{}{}</svg><figcaption>{}</figcaption></figure>'
    return Markup(svg).format(caption, Markup(hull), Markup("").join(drawn), caption)


def _words_of(name: str) -> str:
    """Return a product of motions or a deflection in words."""
    term = CoefficientName.parse(name)
    *_, last = term.signals
    if last.startswith("delta"):
        return SIGNALS[last].meaning.removesuffix(" angle")
    own = SPEEDS[term.axis]
    others = [motion_name(one) for one in term.signals if one != own]
    if own in term.signals:
        return "damping that grows with speed ahead"
    return "coupling with " + " and ".join(others)


def _is_seen(name: str, view: str) -> bool:
    right, down, through = VIEWS[view]
    return _ALONG[name] == through if _turns(name) else _ALONG[name] in (right, down)


def _turns(name: str) -> bool:
    return name in "KMNQ" if name in AXES else SIGNALS[name].dimension == ANGULAR_RATE


def _arrow(name: str, view: str, kind: str, place: int) -> Markup:
    """Draw an arrow, or an arc about the vehicle; each further motion has a separate place."""
    if _turns(name):
        size, sense = 52 - 9 * place, _TURNS[view]
        points = [(size * cos(radians(a)), sense * size * sin(radians(a))) for a in range(-60, 61, 5)]
        label = size - 13 if place else size + 5, 4.0
    elif _ALONG[name] == VIEWS[view][0]:
        y = -30 * place if place else 0
        points = [(-95, y), (-66, y)] if name == "T" else [(30, y), (100, y)]
        label = points[1][0] - 12, y - 6.0
    else:
        points = [(18 * place, -8), (18 * place, 56)]
        label = 18 * place + 7, 56.0
    (x0, y0), (x, y) = list(pairwise(points))[-1][0], points[-1]
    size = ((x - x0) ** 2 + (y - y0) ** 2) ** 0.5
    a, b = (x - x0) / size, (y - y0) / size
    head = [(x, y), (x - 8 * a - 4 * b, y - 8 * b + 4 * a), (x - 8 * a + 4 * b, y - 8 * b - 4 * a)]
    line, tip = ("L".join(f"{one:.1f},{two:.1f}" for one, two in part) for part in (points, head))
    return Markup(
        '<path class="{}" d="M{}"/><path class="{} tip" d="M{}z"/><text x="{:.0f}" y="{:.0f}">{}</text>'
    ).format(kind, line, kind, tip, *label, name)
