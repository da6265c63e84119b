"""The page of the study: complete, safe, the same bytes each time, and honest about sizes."""

import re
from dataclasses import fields, replace

import pytest

from studies.remus100.figures import FIGURES
from studies.remus100.page import SECTIONS, SIZES, write_paper
from studies.remus100.registry import ENTRIES
from studies.remus100.study import FULL, QUICK, Sizes
from studies.remus100.tests.made_up import made_up_study, make_items
from studies.remus100.tests.studies import A
from tests.report.test_page import Page

pytestmark = pytest.mark.proof

EVIL = "<script>alert(1)</script> & <b>AUV</b>"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return made_up_study(folder=tmp_path_factory.mktemp("paper"), sizes=QUICK)


@pytest.fixture(scope="module")
def html(study):
    return write_paper(study, make_items()).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


def rendered(folder, keys, reading=A, **sizes) -> str:
    study = made_up_study(reading=reading, folder=folder, sizes=QUICK)
    return write_paper(replace(study, **sizes), make_items(keys)).read_text(encoding="utf-8")


def test_every_item_stands_on_the_page_once_and_once_in_the_summary(page):
    ids = [attributes["id"] for tag, attributes in page.elements if tag == "article"]
    assert ids == list(ENTRIES)
    links = [attributes.get("href") for tag, attributes in page.elements if tag == "a"]
    assert [link for link in links if link[1:] in ENTRIES] == [f"#{key}" for key in ENTRIES]
    assert "".join(page.text).count("Title of table-6") == 2


def test_items_stand_in_the_sections_of_the_paper(html):
    headings = re.findall(r'<h2 id="[a-z-]+-heading">([^<]*)</h2>', html)
    assert headings[0] == "Verdicts"
    assert headings[1:-2] == [title for _, title in SECTIONS.values()]
    assert html.index('id="iii-filters"') < html.index('id="figure-2"') < html.index('id="iii-design"')


def test_reasons_and_numbers_are_typeset(html):
    assert "Reason 1; more of <span" in html
    assert "<i>u</i>|<i>u</i>|" in html
    assert '−1.1243 <span class="sd">± 0.0026</span>' in html
    assert "m/s²" in html
    assert '<th scope="col">Printed</th>' in html


def test_every_figure_is_there_inline_and_as_files(study, html, page):
    assert len([tag for tag, _ in page.elements if tag == "svg"]) == len(FIGURES)
    files = sorted(path.name for path in (study.folder / "figures").iterdir())
    assert files == sorted(f"{key}.{kind}" for key in FIGURES for kind in ("svg", "pdf"))
    assert (study.folder / "figures" / "figure-1.pdf").read_bytes().startswith(b"%PDF")
    assert not list(study.folder.rglob("*.part"))


def test_nothing_is_loaded_from_elsewhere_and_every_reference_has_its_target(html, page):
    assert not re.search(r"https?://", html)
    assert not re.search(r"@import|url\((?!#)", html)
    assert not {tag for tag, _ in page.elements} & {
        "script",
        "iframe",
        "object",
        "embed",
        "img",
        "image",
        "form",
        "base",
    }
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    references = {a or b for a, b in re.findall(r'url\(#([^)]*)\)|href="#([^"]*)"', html)}
    assert references <= set(ids)


def test_the_same_study_gives_the_same_bytes_in_every_file(tmp_path):
    keys = ("figure-3", "figure-6")
    for place in ("one", "two"):
        rendered(tmp_path / place, keys)
    one, two = (
        {p.name: p.read_bytes() for p in (tmp_path / place).rglob("*.*") if p.suffix != ".nc"}
        for place in ("one", "two")
    )
    assert len(one) == 5
    assert one == two


def test_only_what_was_judged_is_drawn(tmp_path):
    html = rendered(tmp_path, ("table-3", "odds"))
    assert html.count("<svg") == 1
    assert [path.name for path in sorted((tmp_path / "figures").iterdir())] == ["odds.pdf", "odds.svg"]
    assert "II. Vehicle model" not in html
    assert f"2 of {len(ENTRIES)} items of" in html


def test_quick_sizes_are_said_to_be_quick(html, tmp_path):
    assert "This is a quick look" in html
    assert f'<td class="value">{QUICK.burn_in}</td><td>{FULL.burn_in}</td>' in html
    full = rendered(tmp_path, ("table-3",), sizes=FULL)
    assert "quick" not in full.lower()


def test_every_sample_size_is_listed():
    assert list(SIZES) == [field.name for field in fields(Sizes)]


def test_a_vehicles_name_is_text(tmp_path):
    html = rendered(tmp_path, ("table-3",), replace(A, title=EVIL))
    assert "<script" not in html
    assert "<b>" not in html
    assert EVIL in "".join(Page(html).text)
