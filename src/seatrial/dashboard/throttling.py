"""How fast: requests that are never finished are ended, and pages are built a few at a time.

A request that stays half-open holds a connection for nothing, and many of them hold all there are ("slowloris"). A page that is built
beside a hundred others is late for its own limit: so pages wait for their turn, and who would wait too long is asked to come again.
"""

import asyncio
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from starlette.responses import HTMLResponse

LARGEST_HEAD = 64 * 1024
"""Bytes of the head of a request, at most."""
_LATE = b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
_LONG = b"HTTP/1.1 431 Request Header Fields Too Large\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
_FULL = b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 10\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
_GONE = {"type": "http.disconnect"}
COME_AGAIN = HTMLResponse(
    "<!doctype html><meta charset='utf-8'><meta http-equiv='refresh' content='5'><title>seatrial</title>"
    "<p>Too many pages are requested at the same time. This page tries again in 5 seconds.",
    503,
    {"retry-after": "5", "cache-control": "no-store"},
)
"""For a page that has no turn: a browser asks again by itself."""


@dataclass(frozen=True)
class Throttle:
    """What is waited for, and how long.

    Attributes:
        head: seconds in which the head of a request has to arrive.
        pause: seconds without a part of a body, at most.
        slowest: bytes of a body for each second that is spent waiting for them, once `pause` has passed.
        at_once: pages that are built at a time.
        queue: pages that wait for that, at most.
        patience: seconds that one of them waits, at most.
        connections: open ones, at most; an ordinary system lets a process open 1024 files.
    """

    head: float = 15.0
    pause: float = 30.0
    slowest: float = 1024.0
    at_once: int = 8
    queue: int = 200
    patience: float = 90.0
    connections: int = 500


class Turns:
    """Pages take turns."""

    def __init__(self, pace: Throttle):
        self.pace, self.waiting, self._slots = pace, 0, asyncio.Semaphore(pace.at_once)

    async def take(self) -> bool:
        """Wait for a turn; False if there is none in time. Whoever has one gives it back by `give`."""
        if self.waiting >= self.pace.queue:
            return False
        self.waiting += 1
        try:
            async with asyncio.timeout(self.pace.patience):
                await self._slots.acquire()
        except TimeoutError:
            return False
        finally:
            self.waiting -= 1
        return True

    def give(self) -> None:
        """Give a turn back."""
        self._slots.release()


def counted(receive: Any, most: int, pace: Throttle) -> Any:
    """Count what arrives of a body, since one in chunks states no length, and end one that is too long or that dribbles."""
    seen, waited, whole, cut = 0, 0.0, False, False

    async def message() -> Any:
        nonlocal seen, waited, whole, cut
        if whole:  # what comes now is the end of the connection, whenever that is
            return await receive()
        clock, part = asyncio.get_running_loop().time, _GONE
        began = clock()
        if not cut:
            with suppress(TimeoutError):
                async with asyncio.timeout(pace.pause):
                    part = await receive()
        waited += clock() - began
        seen += len(part.get("body", b""))
        more = part.get("more_body", False)
        cut = part is _GONE or seen > most or (more and waited > pace.pause and seen < pace.slowest * waited)
        whole = not more and not cut
        return _GONE if cut else part

    return message


def punctual(pace: Throttle) -> type[asyncio.Protocol]:
    """Uvicorn's protocol, with a limit on how long and how large the head of a request may be, which it has not itself."""
    from uvicorn.protocols.http.auto import AutoHTTPProtocol

    base: Any = AutoHTTPProtocol

    class Punctual(base):
        deadline: asyncio.TimerHandle | None = None
        head = 0

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            if len(self.connections) > pace.connections:
                self.end(_FULL)
            else:
                self.expect()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self.head += len(data)
            self.expect()

        def connection_lost(self, exc: Exception | None) -> None:
            self.relax()
            super().connection_lost(exc)

        def expect(self) -> None:
            """Begin to count while nothing but an unfinished head, or the rest of a body that nobody reads, can arrive."""
            answering = self.cycle is not None and not self.cycle.response_complete
            if answering or self.transport.is_closing() or self.transport.get_protocol() is not self:
                self.relax()
                return
            if self.deadline is None:
                self.deadline = self.loop.call_later(pace.head, self.end, _LATE)
            if self.head > LARGEST_HEAD and not (self.cycle is not None and self.cycle.more_body):
                self.end(_LONG)

        def relax(self) -> None:
            """Stop counting."""
            self.head = 0
            if self.deadline is not None:
                self.deadline.cancel()
                self.deadline = None

        def end(self, words: bytes) -> None:
            """Return why and end the connection."""
            if not self.transport.is_closing():
                self.transport.write(words)
                self.transport.close()

    return Punctual
