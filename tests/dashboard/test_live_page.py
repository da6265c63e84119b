"""The page that shows a trial while it runs: what it says of a look, and how it looks on a phone in sunlight."""

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

from seatrial.campaign.live.session_files import LAST_LOOK, last_look
from seatrial.core.errors import InputError
from seatrial.dashboard.jobs import Jobs
from seatrial.dashboard.pages.live import look_html
from seatrial.dashboard.session import Session
from tests.campaign.test_live import write_campaign
from tests.dashboard.served import served

BROWSER = Path("/usr/bin/chromium")
LOOK = {
    "run": "one",
    "at": 1000.0,
    "time_s": 90.0,
    "samples": 900,
    "coefficients": [
        {"name": "X_u", "unit": "kg/s", "mean": -1.2, "sd": 0.2, "goal": 0.1, "excited": True},
        {"name": "T_nabsn", "unit": "<b>", "mean": 6e-4, "sd": 1e-5, "goal": None, "excited": False},
    ],
    "innovations": {"u": 1.02, "w": None},
    "discount": 1.0,
    "kind": "go on",
    "advice": "continue; goal in about 46 s",
}
MAVLINK = """
[import]
fit = ["1"]

[[import.files]]
path = "{run}.tlog"
table = "RPM"
channels.n = { column = "rpm1", unit = "rpm" }

[[import.files]]
path = "{run}.tlog"
table = "VFR_HUD"
channels.u = { column = "groundspeed", unit = "m/s" }
"""


def test_a_look_is_told_as_it_is():
    html = look_html(LOOK, 1001.0)
    assert "continue; goal in about 46 s" in html
    assert 'value="0.500" aria-label="X_u: 50% of the way to its goal"' in html
    assert "-1.2 ± 0.2 kg/s (16.7%)" in html
    assert "goal ± 0.1; excited" in html
    assert "not excited" in html
    assert "u 1.02" in html
    assert "w " not in html.partition("innovations")[2].partition("<")[0]
    assert "<b>" not in html
    doubt = look_html({**LOOK, "kind": "check", "advice": "check u: knots?"}, 1001.0)
    assert '<p class="advice check" role="status"><span aria-hidden="true">!</span> check u: knots?</p>' in doubt
    met = {**LOOK, "coefficients": [{**LOOK["coefficients"][0], "sd": 0.09}]}
    assert "goal ± 0.1: met" in look_html(met, 1001.0)


def test_a_look_that_is_old_is_no_advice():
    html = look_html(LOOK, 1034.0)
    assert "nothing new for 34 s; the last advice was: continue" in html
    assert 'class="advice silent"' in html


def test_a_trial_is_followed_from_a_file_of_the_folder_or_a_port(tmp_path, monkeypatch):
    (tmp_path / "run 1.csv").write_text("t,u\n")
    begun = []
    monkeypatch.setattr(Session, "start", lambda self, line, log: begun.append(line))
    jobs = Jobs()
    jobs.follow(tmp_path, "run 1.csv")
    jobs.follow(tmp_path, "14550")
    jobs.follow(tmp_path, "ros2")
    jobs.close()
    assert [line[:3] for line in begun] == [
        ["live", str(tmp_path), str(tmp_path / "run 1.csv")],
        ["live", str(tmp_path), "udp:0.0.0.0:14550"],
        ["live", str(tmp_path), "ros2"],
    ]
    for source in ("", "../log.csv", "/etc/passwd", "-", "0", "65536", "14550 ", "--import", "no.csv"):
        with pytest.raises(InputError, match="source of the trial"):
            jobs.follow(tmp_path, source)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"run": "one"}'])
def test_a_damaged_look_is_none(tmp_path, text):
    assert last_look(tmp_path) is None
    (tmp_path / LAST_LOOK).parent.mkdir(parents=True)
    (tmp_path / LAST_LOOK).write_text(text)
    assert last_look(tmp_path) is None
    (tmp_path / LAST_LOOK).write_text(json.dumps(LOOK))
    assert last_look(tmp_path) == LOOK


@pytest.mark.proof
@pytest.mark.skipif(not BROWSER.exists(), reason=f"no {BROWSER}: the browser test is skipped")
def test_a_vehicle_over_mavlink_is_followed_on_a_phone_in_sunlight(tmp_path):
    mavutil = pytest.importorskip("pymavlink.mavutil")
    playwright = pytest.importorskip("playwright.sync_api")
    folder = tmp_path / "served" / "boat"
    write_campaign(folder, more=MAVLINK)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    log = (tmp_path / "live.log").open("w")
    command = [sys.executable, "-m", "seatrial", "live", str(folder), f"udp:127.0.0.1:{port}", "--no-library"]
    live = subprocess.Popen(
        [*command, "--every", "1"], stdout=log, stderr=log, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )
    sender = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", dialect="ardupilotmega", source_system=1)
    try:
        with served(tmp_path / "served", kill=True) as (address, _), playwright.sync_playwright() as tool:
            browser = tool.chromium.launch(executable_path=str(BROWSER), args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 390, "height": 844}, device_scale_factor=2)
            said = []
            page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
            page.goto(address)
            page.goto(address.partition("?")[0] + "live?campaign=boat")
            page.get_by_text("No trial has been followed yet").wait_for()
            page.get_by_text(f"your_logger | seatrial live {folder} -").wait_for()
            page.locator("select.theme").select_option("sun")
            deadline = time.monotonic() + 90
            while "listening" not in (tmp_path / "live.log").read_text():
                assert time.monotonic() < deadline
                time.sleep(0.1)
            u, begun = 1.3, time.monotonic()
            while (passed := time.monotonic() - begun) < 25:
                rpm = 1194 + (200 if int(passed / 4) % 2 else -200)
                u += 0.05 * (0.9 * 6.28e-4 * (rpm * 0.10472) ** 2 - 2.93 * u * abs(u)) / 31.41
                sender.mav.rpm_send(float(rpm), 0.0)
                sender.mav.vfr_hud_send(0.0, u, 0, 0, 0.0, 0.0)
                time.sleep(0.05)
            page.locator(".advice").wait_for()
            if keep := os.environ.get("SEATRIAL_SCREENSHOTS"):
                page.screenshot(path=f"{keep}/live.png", full_page=True)
            assert page.locator(".bars.live > div").count() == 2
            assert page.evaluate("document.documentElement.scrollWidth") <= 390
            text = page.locator(".advice").inner_text()
            assert "nothing new" not in text
            assert any(words in text for words in ("continue", "the goal is met", "this input", "model is wrong"))
            page.get_by_text("nothing new for").wait_for(timeout=30_000)  # the sender has stopped
            assert said == []
            browser.close()
    finally:
        sender.close()
        live.terminate()
        live.wait(30)
        log.close()
