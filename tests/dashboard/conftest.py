"""A page of a real browser that keeps what its console said and what it asked for."""

from pathlib import Path

import pytest

BROWSER = Path("/usr/bin/chromium")
SLOW = 180_000
"""Milliseconds that anything may take on a busy machine."""


@pytest.fixture
def page():
    """A page of Chromium; what it said of errors is in `said`, the addresses it asked for in `asked`."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no Playwright: the browser test is skipped")
    if not BROWSER.exists():
        pytest.skip(f"no {BROWSER}: the browser test is skipped")
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=str(BROWSER), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1000, "height": 900})
        page.set_default_timeout(SLOW)
        page.said, page.asked = [], []
        page.on(
            "console", lambda message: page.said.append(message.text) if message.type in ("error", "warning") else None
        )
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.on("request", lambda request: page.asked.append(request.url))
        yield page
        browser.close()
