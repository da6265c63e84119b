"""Every page at two widths in each of its colours: nothing sticks out, nothing is asked of other hosts, and axe finds no violation.

axe-core is not part of this repository. `npm pack axe-core` gets it; SEATRIAL_AXE names its axe.min.js.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from seatrial.dashboard.page_layout import VIEWS
from tests.campaign.small import NO_X_U, write_small
from tests.dashboard.served import served

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")
pytestmark = pytest.mark.proof
AXE = os.environ.get("SEATRIAL_AXE")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two campaigns that were run, and one that was not."""
    folder = tmp_path_factory.mktemp("accessible") / "served"
    boat = write_small(folder / "boat", *NO_X_U, ("points = 4", "points = 3"))
    done = subprocess.run(
        [sys.executable, "-m", "seatrial", "run", str(boat), "--quiet"], capture_output=True, text=True
    )
    assert done.returncode in (0, 3), done.stderr
    shutil.copytree(boat, folder / "other boat")
    write_small(folder / "new boat")
    return folder


def places():
    return [
        "",
        "new",
        *(f"new?case={one}" for one in ("log", "plan", "bag")),
        *(f"{view}?campaign={name}" for name in ("boat", "new boat") for view in VIEWS),
    ]


def test_pages_fit_their_width_and_ask_nobody_else(folder, page):
    with served(folder) as (address, _):
        for width in (1440, 390):
            page.set_viewport_size({"width": width, "height": 900})
            for place in places():
                page.goto(f"{address}{place}")
                page.locator("h1").wait_for()
                assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), (place, width)
    assert page.said == []
    hosts = {urlsplit(url).hostname for url in page.asked if not url.startswith(("data:", "blob:", "about:"))}
    assert hosts == {"127.0.0.1"}


@pytest.mark.skipif(
    not AXE, reason="no SEATRIAL_AXE: axe.min.js of axe-core is not here, pages are not looked at by it"
)
@pytest.mark.parametrize("theme", ["light", "dark", "sun"])
def test_axe_finds_no_violation(folder, page, theme):
    axe = Path(str(AXE)).read_text(encoding="utf-8")
    page.add_init_script(f"localStorage.setItem('seatrial-theme', '{theme}')")
    found = []
    with served(folder) as (address, _):
        for width in (1440, 390):
            page.set_viewport_size({"width": width, "height": 900})
            report = (folder / "boat" / "report.html").as_uri()  # as it is served it may run no script, axe included
            for place in [*(f"{address}{one}" for one in [*places(), "nowhere"]), report]:
                page.goto(place)
                page.locator("h1").wait_for()
                page.wait_for_function("!document.querySelector('.waiting')")
                page.evaluate(axe)
                said = page.evaluate("axe.run()")
                assert len(said["passes"]) > 20, place
                found += [(place, width, one["id"], one["nodes"][0]["html"][:200]) for one in said["violations"]]
    assert found == []
