"""Requests that are never finished are ended, and a crowd is answered page by page."""

import asyncio
import socket
import threading
from collections import Counter
from contextlib import contextmanager, suppress

import httpx
import pytest

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

import uvicorn

from seatrial.dashboard.request_guard import GuardedApp, RequestGuard
from seatrial.dashboard.throttling import LARGEST_HEAD, Throttle, counted, punctual
from tests.campaign.small import write_small
from tests.dashboard.served import served

QUICK = Throttle(head=1.0, pause=1.0, slowest=1000.0, at_once=2, queue=3, patience=20.0, connections=4)
HEAD = b"POST /upload/ HTTP/1.1\r\nhost: 127.0.0.1\r\n"


async def app(scope, receive, send):
    """Answer, after a while where that is asked for, with what has arrived of the body."""
    if scope["type"] == "lifespan":
        return
    got, ended = b"", ""
    while True:
        message = await receive()
        got += message.get("body", b"")
        if message["type"] == "http.disconnect":
            ended = " cut"
            break
        if not message.get("more_body"):
            break
    if scope["path"] == "/slow":
        await asyncio.sleep(2.0)
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": f"{len(got)}{ended}".encode()})


@pytest.fixture
def port():
    """Port of a server that is soon out of patience."""
    here = socket.create_server(("127.0.0.1", 0))
    gated = GuardedApp(app, RequestGuard("127.0.0.1", None, 1 << 20), (), QUICK)
    server = uvicorn.Server(uvicorn.Config(gated, http=punctual(QUICK), lifespan="off", log_level="error"))
    thread = threading.Thread(target=server.run, args=([here],))
    thread.start()
    yield here.getsockname()[1]
    server.should_exit = True
    thread.join()


@contextmanager
def connected(port):
    with socket.create_connection(("127.0.0.1", port), timeout=20) as here:
        yield here


def rest(here):
    """All that comes until the other side ends the connection; an error if it never does."""
    got = b""
    with suppress(ConnectionError):
        while part := here.recv(65536):
            got += part
    return got


def until(here, words):
    """Whether these words come."""
    got = b""
    while words not in got and (part := here.recv(65536)):
        got += part
    return words in got


def dribble(here, parts):
    """Send parts far apart until the other side has had enough; whether it had."""
    for part in parts:
        try:
            here.sendall(part)
        except OSError:
            return True
        here.settimeout(0.2)
        with suppress(TimeoutError, ConnectionError):
            if here.recv(65536) == b"":
                return True
    return False


@pytest.mark.proof
def test_a_head_that_never_ends_is_ended(port):
    with connected(port) as here:
        here.sendall(b"GET / HTTP/1.1\r\nhost:")
        assert b"408" in rest(here)
    with connected(port) as here:
        assert dribble(here, [b"GET / HTTP/1.1\r\n", *[b"a: b\r\n"] * 100])
    with connected(port) as here:
        assert b"408" in rest(here)  # nothing at all was sent
    with connected(port) as here:  # a second request on the same connection
        here.sendall(b"GET / HTTP/1.1\r\nhost: 127.0.0.1\r\n\r\n")
        assert b"200" in here.recv(65536)
        here.sendall(b"GET / HTTP/1.1\r\n")
        assert b"408" in rest(here)


def test_a_head_that_is_huge_is_ended(port):
    with connected(port) as here:
        assert dribble(here, [b"GET / HTTP/1.1\r\n", *[b"a: " + b"b" * (LARGEST_HEAD // 2) + b"\r\n"] * 20])


@pytest.mark.proof
def test_a_body_that_dribbles_is_cut_off(port):
    for length in (b"content-length: 5000\r\n\r\n", b"transfer-encoding: chunked\r\n\r\n"):
        with connected(port) as here:
            here.sendall(HEAD + length)
            assert until(here, b"0 cut")
    with connected(port) as here:
        here.sendall(HEAD + b"content-length: 5000\r\n\r\n")
        assert dribble(here, [b"x"] * 100)


def test_who_is_slow_to_answer_is_not_cut_off(port):
    answer = httpx.post(f"http://127.0.0.1:{port}/slow", content=b"x" * 3000, timeout=30)
    assert (answer.status_code, answer.text) == (200, "3000")


def test_more_connections_than_allowed_are_told_to_come_again(port):
    open_ones = [socket.create_connection(("127.0.0.1", port), timeout=20) for _ in range(8)]
    try:
        answers = [rest(one) for one in open_ones]
    finally:
        for one in open_ones:
            one.close()
    assert sorted(answer.split()[1] for answer in answers) == [b"408"] * 4 + [b"503"] * 4
    assert httpx.get(f"http://127.0.0.1:{port}/", timeout=30).status_code == 200


def test_a_body_that_was_cut_off_stays_so():
    async def main():
        parts = [b"x" * 600, b"x" * 600, b"x"]

        async def receive():
            return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

        message = counted(receive, 1000, QUICK)
        return [(await message())["type"] for _ in range(3)]

    assert asyncio.run(main()) == ["http.request", "http.disconnect", "http.disconnect"]


def test_pages_take_turns_and_who_would_wait_too_long_is_asked_to_come_again():
    building, most = 0, 0

    async def page(scope, receive, send):
        nonlocal building, most
        building += 1
        most = max(most, building)
        await asyncio.sleep(0.05)
        building -= 1
        await app(scope, receive, send)

    async def main():
        gated = GuardedApp(page, RequestGuard("127.0.0.1", None, 1), ("/results",), QUICK)
        async with httpx.AsyncClient(transport=httpx.ASGITransport(gated), base_url="http://127.0.0.1") as client:
            return await asyncio.gather(*(client.get("/results") for _ in range(10)))

    answers = asyncio.run(main())
    assert Counter(answer.status_code for answer in answers) == {200: 5, 503: 5}
    assert most == 2
    refused = next(answer for answer in answers if answer.status_code == 503)
    assert refused.headers["retry-after"] == "5"
    assert "http-equiv='refresh'" in refused.text


@pytest.mark.proof
def test_a_hundred_who_ask_at_once_are_all_answered(tmp_path):
    write_small(tmp_path / "boat")

    async def crowd(address):
        limits = httpx.Limits(max_connections=100)
        async with httpx.AsyncClient(timeout=300, limits=limits) as client:
            return await asyncio.gather(*(client.get(f"{address}results?campaign=boat") for _ in range(100)))

    with served(tmp_path) as (address, _):
        assert Counter(answer.status_code for answer in asyncio.run(crowd(address))) == {200: 100}
