"""Words of the glossary are explained where a section uses them first, with the texts of the page of the docs."""

import re
from pathlib import Path

from seatrial.messages.glossary import GLOSSARY
from seatrial.report.glossary import with_meanings

PAGE = Path(__file__).parents[2] / "docs" / "glossary.md"


def test_meanings_are_those_of_the_page():
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", PAGE.read_text(encoding="utf-8")).replace("`", "")
    paragraphs = "\n".join(" ".join(one.split()) for one in text.split("\n\n"))
    entries = dict(re.findall(r"(?m)^\*\*([\w -]+)\*\*(?: or \*\*[\w -]+\*\*)?: (.*)$", paragraphs))
    assert {name: word.meaning for name, word in GLOSSARY.items()} == {name: entries.get(name) for name in GLOSSARY}


def test_the_first_use_in_a_section_is_explained():
    html = with_meanings("<section><h2>Nat</h2><p>2 nats, one nat, R-hat.</p></section><section><p>A nat</p></section>")
    assert re.findall(r'title="([\w-]+): [^"]*">([^<]*)<', html) == [
        ("nat", "nats"),
        ("R-hat", "R-hat"),
        ("nat", "nat"),
    ]
    assert html.count('tabindex="0"') == 3


def test_what_is_quoted_clicked_or_explained_stays_as_it_is():
    kept = '<a href="mode">mode</a><code>prior</code><svg><text>band</text></svg><abbr title="x">trim</abbr><p title="nat">x-nat</p>'
    assert with_meanings(kept) == kept
