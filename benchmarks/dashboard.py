"""How quick the dashboard is: a click on a design, its first page, every view and zoom of ten million samples, and twenty viewers at once.

    python benchmarks/dashboard.py [--campaign outputs/remus100] [--samples 10000000] [--viewers 20]
    python benchmarks/dashboard.py --clicks                 from a click to its answer alone

A copy of the campaign is served on loopback, its record replaced by such a long one. A view counts from the
request until nothing in the browser is waited for any more, a zoom from the click until the finer curves have arrived. Viewers are
sockets as a browser opens them, and go from view to view. "CPU" is the processor time of the server and its processes, which other
work on the machine does not lengthen.
"""

import argparse
import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import socketio
from socketio.exceptions import SocketIOError

from seatrial.campaign.store.stored_result import Store
from seatrial.core.dataset_file import open_dataset, write_dataset

VIEWS = ("import", "design", "run", "results", "compare", "report")
BROWSER = "/usr/bin/chromium"
REPEATS, ZOOMS = 5, 16


def main() -> None:
    """Measure and print."""
    options = _options()
    if Path(BROWSER).exists():
        click(options.scratch)
    else:
        print(f"no {BROWSER}: clicks are not timed")
    if options.clicks:
        return
    with tempfile.TemporaryDirectory(dir=options.scratch) as place:
        folder = Path(place) / "campaign"
        shutil.copytree(options.campaign, folder)
        shutil.copytree(options.campaign, Path(place) / "other")
        lengthen(folder, options.samples)
        server, address = start(Path(place))
        try:
            warm(address)
            before = processor_time(server.pid)
            print(f"first page, {_best(lambda: httpx.get(address, timeout=60))} by the server alone", end="; ")
            print(f"{(processor_time(server.pid) - before) / REPEATS:.3f} s CPU each")
            if Path(BROWSER).exists():
                look(address, options.samples, server.pid)
            else:
                print(f"no {BROWSER}: views are not timed")
            asyncio.run(crowd(address, options.viewers, options.seconds, server.pid))
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(20)


def click(scratch: str | None) -> None:
    """Click on "Run the design" of a new campaign, until its picture is there, and again after a change of its limits."""
    from playwright.sync_api import sync_playwright

    for kind in ("first campaign", "second campaign"):
        with tempfile.TemporaryDirectory(dir=scratch) as place, sync_playwright() as tool:
            folder = Path(place) / "boat"
            subprocess.run([sys.executable, "-m", "seatrial", "init", str(folder)], check=True, capture_output=True)
            server, address = start(folder)
            browser = tool.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
            try:
                page = browser.new_page()
                page.set_default_timeout(120_000)
                page.goto(f"{address}design?campaign=.")
                page.get_by_label("n: upper").wait_for()
                began = time.monotonic()
                page.get_by_role("button", name="Run the design").click()
                page.locator(".surface").wait_for()
                first = time.monotonic() - began
                path = folder / "campaign.toml"
                path.write_text(path.read_text().replace('"1500 rpm"', '"1450 rpm"'))
                before = Store(folder).design.stat().st_mtime_ns
                began = time.monotonic()
                page.get_by_role("button", name="Run the design").click()
                while Store(folder).design.stat().st_mtime_ns == before and time.monotonic() - began < 120:
                    time.sleep(0.01)
                page.get_by_text("Nothing is running").wait_for()
                print(
                    f"click to design, {kind}: {first:.2f} s; after another limit {time.monotonic() - began:.2f} s",
                    flush=True,
                )
            finally:
                browser.close()
                server.send_signal(signal.SIGINT)
                server.wait(20)


def lengthen(folder: Path, samples: int) -> None:
    """Repeat the first record until it has so many samples."""
    path = sorted((Store(folder).results / "records").glob("*.nc"))[0]
    data = open_dataset(path).to_xarray()
    longer = data.isel(time=np.arange(samples) % data.sizes["time"])
    step = float(np.median(np.diff(data["time"].values)))
    write_dataset(path, longer.assign_coords(time=("time", np.arange(samples) * step)))


def start(folder: Path, *options: str) -> tuple[subprocess.Popen, str]:
    """Serve a folder in a process of its own; returns it and its address."""
    command = [sys.executable, "-m", "seatrial", "serve", str(folder), "--port", "0", "--no-browser", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    assert process.stdout is not None
    found = re.search(r"http://\S+", process.stdout.readline())
    assert found is not None
    return process, found[0]


def warm(address: str) -> None:
    """Wait until the server answers and has imported what it will need."""
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        try:
            httpx.get(address, timeout=60)
            break
        except httpx.TransportError:
            time.sleep(0.2)
    time.sleep(20)


def processor_time(pid: int) -> float:
    """Processor time that a process and those below it have used so far, s; of Linux."""
    parents, used = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        one = int(path.parent.name)
        parents[one], used[one] = int(fields[1]), (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return sum(time for one, time in used.items() if pid in _line_of(one, parents))


def _line_of(pid: int, parents: dict[int, int]) -> list[int]:
    line = [pid]
    while line[-1] in parents:
        line.append(parents[line[-1]])
    return line


def look(address: str, samples: int, server: int) -> None:
    """Open every view twice in a browser: with nothing prepared, and again; and zoom into the record."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = browser.new_page()
        page.set_default_timeout(120_000)
        for view in ("", *VIEWS):
            times = []
            for _ in range(2):
                before, began = processor_time(server), time.monotonic()
                page.goto(f"{address}{view}" + ("?campaign=campaign" if view else ""))
                page.wait_for_selector("h1")
                seen = time.monotonic() - began
                page.wait_for_selector(DRAWN.get(view, ".steps"), state="attached")
                page.wait_for_function("!document.querySelector('.waiting')")
                times.append((seen, time.monotonic() - began, processor_time(server) - before))
            words = "; again ".join(
                f"{seen:.2f} s to read, {whole:.2f} s whole, {used:.2f} s CPU" for seen, whole, used in times
            )
            print(f"{view or 'first page':<12} {words}" + (f"   ({samples:,} samples)" if view == "import" else ""))
        zoom(browser.new_page(), address, server)
        browser.close()


def zoom(page: Any, address: str, server: int) -> None:
    """Zoom into the record step by step, until single samples are drawn."""
    curves = []
    page.on(
        "websocket",
        lambda socket: socket.on(
            "framereceived", lambda frame: curves.append(frame) if "setOption" in str(frame) else None
        ),
    )
    page.goto(f"{address}import?campaign=campaign")
    page.wait_for_selector(DRAWN["import"], state="attached")
    page.wait_for_timeout(2000)
    waits, before = [], processor_time(server)
    for _ in range(ZOOMS):
        there, began = len(curves), time.monotonic()
        page.get_by_role("button", name="Zoom in").click()
        while len(curves) == there and time.monotonic() - began < 30:
            page.wait_for_timeout(5)
        waits.append(time.monotonic() - began)
    used = (processor_time(server) - before) / ZOOMS
    print(f"{ZOOMS} zooms by half: median {np.median(waits):.3f} s, slowest {max(waits):.3f} s; {used:.3f} s CPU each")


DRAWN = {
    "import": ".chart svg",
    "design": ".surface svg",
    "results": "section.report, .report section",
    "compare": "table",
    "report": '[aria-label="Simulator or format"]',
}
"""What a view has when its last part has come."""


async def crowd(address: str, viewers: int, seconds: float, server: int) -> None:
    """Let viewers go from view to view, and count connections that were lost and answers that were slow."""
    waits: list[float] = []
    lost: list[str] = []
    before = processor_time(server)
    end = time.monotonic() + seconds
    await asyncio.gather(*(_viewer(address, number, end, waits, lost) for number in range(viewers)))
    late, used = np.percentile(waits, [50, 95, 100]), (processor_time(server) - before) / len(waits)
    print(
        f"{viewers} viewers, {len(waits)} pages in {seconds:g} s: median {late[0]:.2f} s, 95 % within {late[1]:.2f} s, "
        f"slowest {late[2]:.2f} s; {used:.3f} s CPU each; {len(lost)} connections lost{': ' + lost[0] if lost else ''}"
    )


async def _viewer(address: str, number: int, end: float, waits: list[float], lost: list[str]) -> None:
    async with httpx.AsyncClient(timeout=60) as client:
        turn = number
        while time.monotonic() < end:
            view = VIEWS[turn % len(VIEWS)]
            turn += 1
            began = time.monotonic()
            try:
                answer = await client.get(f"{address}{view}?campaign=campaign")
                waits.append(time.monotonic() - began)
                await _watch(address, answer.text, min(4.0, max(end - time.monotonic(), 0.1)))
            except (httpx.HTTPError, SocketIOError, ValueError) as error:
                lost.append(f"{view}: {type(error).__name__} {error} {error.__cause__ or ''}")


async def _watch(address: str, page: str, seconds: float) -> None:
    """Open the page's socket as a browser does and stay for a while.

    Raises:
        ValueError: the connection ended before.
    """
    found = re.search(r"'client_id': '([^']+)'", page)
    if found is None:
        raise ValueError("no page")
    query = f"client_id={found[1]}&next_message_id=0&implicit_handshake=true&tab_id={uuid.uuid4()}&document_id={uuid.uuid4()}"
    socket = socketio.AsyncClient(reconnection=False)
    await socket.connect(
        f"{address}?{query}",
        transports=["websocket"],
        socketio_path="/_nicegui_ws/socket.io",
        headers={"Origin": address.rstrip("/")},
        wait_timeout=30,  # as patient as a browser; one second is the default
    )
    await asyncio.sleep(seconds)
    alive = socket.connected
    await socket.disconnect()
    if not alive:
        raise ValueError("the socket was closed")


def _best(work) -> str:
    times = []
    for _ in range(REPEATS):
        began = time.monotonic()
        work()
        times.append(time.monotonic() - began)
    return f"median {np.median(times):.3f} s of {REPEATS}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=Path("outputs/remus100"), help="a campaign that was run")
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--clicks", action="store_true", help="time clicks alone; needs no campaign")
    parser.add_argument("--viewers", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--scratch", default=None, help="where 3 GB are free")
    found = parser.parse_args()
    if not found.clicks and not Store(found.campaign).summary.is_file():
        raise SystemExit(
            f"{found.campaign} has no results: run `seatrial run {found.campaign}` first, or name another with --campaign"
        )
    return found


if __name__ == "__main__":
    main()
