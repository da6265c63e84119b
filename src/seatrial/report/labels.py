r"""Printed labels: the small LaTeX of coefficient names, such as `X_{\Delta u^3}`, as HTML and as text for figures.

    label = item*        item = symbol | "{" label "}" | ("_" | "^") item | "\dot" item | "\mathrm" item | "[" anything

Single letters are variables and lean; digits, bars and what stands in `\mathrm` are upright. Everything from the first
`[` on is the user's (the run of `u_0[run 1]`) and is kept to the letter.
"""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from markupsafe import Markup, escape

from seatrial.core.coefficients import CoefficientName, base_name
from seatrial.core.errors import InputError
from seatrial.core.signals import GAUGE_CHANNELS, SIGNALS, is_thruster, signal_label
from seatrial.report.numbers import typeset

GREEK = {
    "Delta": "Δ",
    "alpha": "α",
    "beta": "β",
    "delta": "δ",
    "eta": "η",
    "nu": "ν",
    "phi": "φ",
    "psi": "ψ",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "theta": "θ",
}
# What stands for the first word of a parameter's name; `?` is the label of the rest.
LETTERS = {
    "sigma": r"\sigma_{?}",
    "tau": r"\tau_{?}",
    "dof": r"\nu_{?}",
    "bias": "b_{?}",
    "lag": r"t_{\mathrm{lag},?}",
    "process": "q_{?}",
    "spread": "s_{?}",
    "dev": r"\delta_{?}",
}
DOT_ABOVE = "\u0307"
_STRUCTURE = re.compile(r"\bM-\d+\b")
_CODE = re.compile(r"`([^`]+)`")
_TOKEN = re.compile(r"\\[A-Za-z]+|.", re.DOTALL)
_TAGS = {"sub": "sub", "sup": "sup", "variable": "i"}


class Node(NamedTuple):
    """A piece of a label: `kind` is `variable`, `upright`, `sub`, `sup`, `dot` or `group`; content is text or nodes."""

    kind: str
    content: "str | tuple[Node, ...]"


def label_html(label: str) -> Markup:
    """Return a label as safe HTML: `X_{u|u|}` gives `<i>X</i><sub><i>u</i>|<i>u</i>|</sub>`."""
    nodes, suffix = _parse(label)
    return Markup(f'<span class="symbol">{"".join(map(_html, nodes))}{escape(suffix)}</span>')


def label_mathtext(label: str) -> str:
    """Return a label for Matplotlib; the user's part stands outside the dollars, if nothing is a command."""
    nodes, suffix = _parse(label)
    return f"${''.join(map(_mathtext, nodes))}$" + suffix.replace("$", r"\$")


def name_mathtext(name: str) -> str:
    """Return the label of a parameter for a figure, by its name alone: `sigma_u` gives `$\\sigma_{u}$`."""
    base = base_name(name)
    of_part, (head, _, of) = name[len(base) :], base.partition("_")
    label = LETTERS[head].replace("?", _label_of(of)) if head in LETTERS and of else _label_of(base)
    return label_mathtext(label + (f"[{of_part[1:]}]" if of_part.startswith("@") else of_part))


def _label_of(name: str) -> str:
    """Return the LaTeX of a coefficient, of a signal or its rate; the name itself of what is none of these."""
    if is_thruster(name) or name.removesuffix("dot") in (*SIGNALS, *GAUGE_CHANNELS):
        return signal_label(name)
    try:
        return CoefficientName.parse(name).label
    except InputError:
        return rf"\mathrm{{{name.replace('_', ' ')}}}"


def name_html(text: str, labels: Mapping[str, str]) -> Markup:
    """Escape a sentence, print every parameter name in it by its label, and what stands in backticks as code.

    Args:
        text: a sentence for the user.
        labels: LaTeX label of each name.
    """
    words, *rest = _CODE.split(text, maxsplit=1)
    if rest:
        code = Markup("<code>{}</code>").format(rest[0])
        return name_html(words, labels) + code + name_html(rest[1], labels)
    if not labels:
        return escape(text)
    names = "|".join(re.escape(name) for name in sorted(labels, key=len, reverse=True))
    pieces, last = [], 0
    for match in re.finditer(rf"(?<![\w.])({names})(?![\w\[])", text):
        pieces += [escape(text[last : match.start()]), label_html(labels[match[1]])]
        last = match.end()
    return Markup("").join([*pieces, escape(text[last:])])


def sentence_html(text: str, labels: Mapping[str, str]) -> Markup:
    """Typeset a sentence: parameter names by their labels, a capital unless it begins with one, a full stop."""
    if text.split(" ", 1)[0] not in labels:
        text = text[:1].upper() + text[1:]
    return name_html(typeset(text), labels) + escape("" if text.endswith(".") else ".")


def sentence_about(text: str, names: Mapping[str, str], labels: Mapping[str, str]) -> Markup:
    """Typeset a sentence about structures and parameters.

    Args:
        text: the sentence, with structures by their labels, such as M-1.
        names: of the structures, by label; put into quotes.
        labels: LaTeX label of each parameter.
    """
    named = _STRUCTURE.sub(lambda found: f"“{names[found[0]]}”" if found[0] in names else found[0], text)
    return sentence_html(named, labels)


def _parse(label: str) -> tuple[tuple[Node, ...], str]:
    body, bracket, rest = label.partition("[")
    tokens = _TOKEN.findall(body)
    nodes = []
    while tokens:
        nodes.append(_item(tokens))
    return tuple(nodes), bracket + rest


def _item(tokens: list[str]) -> Node:
    """Take one item off the front; braces that do not match are forgiven."""
    token = tokens.pop(0) if tokens else ""
    if token == "{":
        inside = []
        while tokens and tokens[0] != "}":
            inside.append(_item(tokens))
        if tokens:
            tokens.pop(0)
        return Node("group", tuple(inside))
    if token in ("_", "^"):
        return Node("sub" if token == "_" else "sup", (_item(tokens),))
    if token == r"\dot":
        return Node("dot", (_item(tokens),))
    if token == r"\mathrm":
        return Node("upright", _text(_item(tokens)))
    name = token.removeprefix("\\")
    if len(name) == 1:
        return Node("variable" if name.isalpha() else "upright", "" if name.isspace() or name == "}" else name)
    symbol = GREEK.get(name, name)
    return Node("upright" if symbol == "Δ" or name not in GREEK else "variable", symbol)


def _html(node: Node) -> str:
    if isinstance(node.content, str):
        return f"<i>{escape(node.content)}</i>" if node.kind == "variable" else str(escape(node.content))
    inside = "".join(map(_html, node.content))
    if node.kind == "dot":
        return f"<i>{escape(_texts(node.content))}{DOT_ABOVE}</i>"
    return f"<{_TAGS[node.kind]}>{inside}</{_TAGS[node.kind]}>" if node.kind in _TAGS else inside


def _mathtext(node: Node) -> str:
    if isinstance(node.content, str):
        text = "".join(f"\\{character}" if character in "_%#&{}$" else character for character in node.content)
        return text if node.kind == "variable" or len(text) == 1 else rf"\mathrm{{{text}}}" if text else ""
    inside = "".join(map(_mathtext, node.content))
    return {"sub": f"_{{{inside}}}", "sup": f"^{{{inside}}}", "dot": rf"\dot{{{inside}}}"}.get(node.kind, inside)


def _text(node: Node) -> str:
    if isinstance(node.content, str):
        return node.content
    inside = _texts(node.content)
    return {"sub": f" {inside}", "sup": f"^{inside}", "dot": inside + DOT_ABOVE}.get(node.kind, inside)


def _texts(nodes: Sequence[Node]) -> str:
    return "".join(map(_text, nodes))
