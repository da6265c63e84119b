"""An address behind which there is nothing is answered by a page of the dashboard, which says what is missing and leads back."""

from html import unescape

import httpx
import pytest

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

from tests.campaign.small import write_small
from tests.dashboard.served import served

BACK = '<a href="/">Back to the campaigns</a>'


@pytest.mark.proof
def test_where_there_is_nothing_a_page_says_so_and_leads_back(tmp_path):
    write_small(tmp_path / "served" / "boat")
    with served(tmp_path / "served") as (address, _):
        for place, status, words in (
            ("nowhere", 404, "There is no page /nowhere"),
            ("results/boat", 404, "There is no page /results/boat"),
            ("download?campaign=boat&file=report.html", 404, "report.html"),
            ("results?campaign=no+boat", 404, "no boat"),
        ):
            answer = httpx.get(f"{address}{place}", timeout=60)
            assert answer.status_code == status, place
            assert "Not found" in answer.text, place
            assert words in answer.text, place
            assert BACK in unescape(answer.text).replace("\\", ""), place
        assert "<script>x" not in httpx.get(f"{address}%3Cscript%3Ex", timeout=60).text


@pytest.mark.proof
def test_names_turn_no_page_around(tmp_path):
    """A mark that turns the text around it stands in the address only, in the name of a folder and in its campaign's."""
    name = "bo\u202eat"
    write_small(tmp_path / "served" / name, ('name = "small"', 'name = "s\\u202emall"'))
    with served(tmp_path / "served") as (address, _):
        for place in (
            "",
            f"run?campaign={name}",
            f"file?campaign={name}",
            f"nowhere{name}",
            f"results?campaign=x{name}",
        ):
            text = httpx.get(f"{address}{place}", timeout=60).text
            assert "\u202e" not in text.replace(f"campaign={name}", ""), place
            assert "bo" in text
