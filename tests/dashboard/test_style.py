"""All themes can be read: contrast as WCAG 2.2 counts it, 4.5 for text (AA) and 7 in sunlight (AAA); and nothing comes from elsewhere."""

import re
from pathlib import Path

import pytest

import seatrial.dashboard as package
from seatrial.report.figures.style import PALETTE

FOLDER = Path(package.__file__).parent
STYLE = (FOLDER / "style.css").read_text()
TEXTS = ("ink", "muted", "blue", "alarm", "caution", "good")
GROUNDS = ("paper", "ground", "shade", "alarm-ground", "finding-ground")


def colours(theme):
    found = {name: pair[theme == "dark"] for name, pair in PALETTE.items()}
    for block in (r":root \{", *([rf':root\[data-theme="{theme}"\] \{{'] if theme else [])):
        match = re.search(block + r"(.*?)\}", STYLE, re.DOTALL)
        assert match is not None
        found |= dict(re.findall(r"--([a-z-]+):\s*(#[0-9a-f]{3,6})\b", match[1]))
    return found


def luminance(colour):
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    shares = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("theme", "least"), [("", 4.5), ("dark", 4.5), ("sun", 7.0)])
def test_text_stands_out_from_its_ground(theme, least):
    found = colours(theme)
    for text in TEXTS:
        for ground in GROUNDS:
            assert contrast(found[text], found[ground]) >= least, (text, ground)
    assert contrast(found["orange"], found["paper"]) >= 4.5  # the ring of what has the focus
    assert contrast(found["blue"], found["paper"]) >= 4.5  # words on buttons
    assert contrast(found["alarm"], found["paper"]) >= 4.5
    assert contrast(found["dots"], found["paper"]) >= (7.0 if theme == "sun" else 3.0)


def mixed(ground, over, share):
    """A colour of which so much lies over another."""
    digits = [one[1:] if len(one) == 7 else "".join(2 * digit for digit in one[1:]) for one in (ground, over)]
    pairs = [[int(one[i : i + 2], 16) for i in (0, 2, 4)] for one in digits]
    return "#" + "".join(f"{round(a * (1 - share) + b * share):02x}" for a, b in zip(*pairs, strict=True))


@pytest.mark.parametrize(("theme", "least"), [("", 4.5), ("dark", 4.5), ("sun", 7.0)])
def test_a_button_that_is_pointed_at_can_be_read(theme, least):
    """Quasar lays 15 % of a colour over it: of the words where nothing else is said, which on a filled button takes contrast away."""
    found = colours(theme)
    assert ".q-btn.bg-primary > .q-focus-helper { background: var(--ink); }" in STYLE
    assert contrast(found["paper"], mixed(found["blue"], found["ink"], 0.15)) >= max(
        least, contrast(found["paper"], found["blue"])
    )
    share = re.search(r"\.q-btn > \.q-focus-helper \{ background: color-mix\(in srgb, currentColor (\d+)%", STYLE)
    assert share is not None
    assert contrast(found["blue"], mixed(found["paper"], found["blue"], 0.15 * int(share[1]) / 100)) >= least


def test_whatever_has_the_focus_has_the_same_ring():
    """The library takes the outline from what lies inside a field: the field as a whole has it then."""
    rings = re.findall(r"^([^{}\n]*:focus-visible[^{}\n]*) \{ outline: 3px solid var\(--orange\)", STYLE, re.MULTILINE)
    assert any(".q-field:has(:focus-visible)" in one for one in rings)
    assert any(one.startswith(":focus-visible") for one in rings)


def test_nothing_is_asked_of_the_internet():
    for path in FOLDER.rglob("*"):
        if path.suffix in (".py", ".css"):
            addresses = set(re.findall(r"https?://[^\s\"'{}]+", path.read_text())) - {"http://www.w3.org/2000/svg"}
            assert not addresses, path
