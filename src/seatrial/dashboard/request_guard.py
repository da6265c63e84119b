"""Who may ask: every request passes Host, Origin, token and size here before anything else sees it.

A page of another site can make a browser send requests to 127.0.0.1. It cannot choose the Host header, unless its own name was made
to point there (DNS rebinding), nor the Origin: so Host must be a name of this server, and Origin, if there is one, the same.
"""

import hashlib
import hmac
import ipaddress
import secrets
import socket
from collections.abc import Awaitable, Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlencode

from starlette.datastructures import QueryParams
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse, Response

from seatrial.core.errors import InputError
from seatrial.dashboard.throttling import COME_AGAIN, Throttle, Turns, counted

SHORTEST = 16
"""Characters of a token, at least."""
SMALL_BODY = 64 * 1024
"""Bytes of a request that is not an upload, at most."""
UPLOAD = "/upload/"
COOKIE = "seatrial"
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'none'"
)
"""What a browser may load for our pages: nothing from anywhere else. The framework compiles its templates, which needs `unsafe-eval`."""

Scope = Mapping[str, Any]
App = Callable[[Any, Callable[[], Awaitable[Any]], Callable[[Any], Awaitable[None]]], Awaitable[None]]


@dataclass(frozen=True)
class RequestGuard:
    """What is asked of a request.

    Attributes:
        host: address that is listened on.
        token: that every request has to show; None on loopback where none was asked for.
        most: bytes of an upload, at most.
    """

    host: str
    token: str | None
    most: int

    @property
    def cookie(self) -> str:
        """Value of the cookie: derived from the token, so that it outlives a restart and does not show the token."""
        return hmac.new((self.token or "").encode(), b"seatrial cookie", hashlib.sha256).hexdigest()

    def refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Status and words for a request that is refused by its headers alone; None for one that may pass."""
        headers = headers_of(scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if not is_own_name(host, self.host):
            return (
                421,
                "the server does not have this name; use the address that `seatrial serve` printed",
            )
        if origin is not None and not is_same_origin(origin, host):
            return 403, "requests from other pages are refused"
        if origin is None and (scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")):
            site = headers.get("sec-fetch-site", "same-origin")
            if site not in ("same-origin", "none"):
                return 403, "requests from other pages are refused"
        if self.token is not None and not (self.shown(headers) or self.shown_in_query(scope)):
            return 401, "a token is needed: open the address that `seatrial serve` printed, with ?token=… at its end"
        if too_long(headers.get("content-length"), self.allowed(scope)):
            return 413, f"more than {self.allowed(scope):,} bytes"
        return None

    def allowed(self, scope: Scope) -> int:
        """Bytes of a request's body, at most."""
        return self.most if str(scope.get("path", "")).startswith(UPLOAD) else SMALL_BODY

    def shown(self, headers: Mapping[str, str]) -> bool:
        """Whether headers show the token, or its cookie."""
        given = headers.get("authorization", "").removeprefix("Bearer ") or headers.get("x-seatrial-token", "")
        return same(given, self.token or "") or same(
            cookie_parser(headers.get("cookie", "")).get(COOKIE, ""), self.cookie
        )

    def shown_in_query(self, scope: Scope) -> bool:
        """Whether the address shows the token, which only a page that is opened may do."""
        if scope["type"] != "http" or scope["method"] != "GET":
            return False
        return any(
            same(value, self.token or "") for value in QueryParams(scope.get("query_string", b"")).getlist("token")
        )


class GuardedApp:
    """An ASGI application behind the guard.

    Args:
        app: behind it.
        guard: what is asked of a request.
        pages: paths of pages, which are built a few at a time.
        pace: how many, and how long anything is waited for.
    """

    def __init__(self, app: App, guard: RequestGuard, pages: Collection[str] = (), pace: Throttle | None = None):
        self.app, self.guard, self.pages, self.pace = app, guard, frozenset(pages), pace or Throttle()
        self.turns = Turns(self.pace)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Refuse, or pass on in its turn with the body counted and safe headers on the answer."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refused = self.guard.refusal(scope)
        if refused is not None:
            await _refuse(scope, receive, send, *refused)
        elif scope["type"] == "websocket":
            await self.app(scope, receive, send)
        elif self.guard.token is not None and self.guard.shown_in_query(scope):
            await _welcome(scope, self.guard.cookie)(scope, receive, _safe(send))
        elif scope["path"] in self.pages:
            await self._page(scope, receive, send)
        else:
            await self._pass(scope, receive, send)

    async def _page(self, scope: Any, receive: Any, send: Any) -> None:
        if not await self.turns.take():
            await COME_AGAIN(scope, receive, _safe(send))
            return
        with ExitStack() as turn:
            turn.callback(self.turns.give)

            async def built(message: Any) -> None:
                turn.close()  # a browser that reads slowly keeps nobody waiting
                await send(message)

            await self._pass(scope, receive, built)

    async def _pass(self, scope: Any, receive: Any, send: Any) -> None:
        await self.app(scope, counted(receive, self.guard.allowed(scope), self.pace), _safe(send))


def token_for(host: str, given: str | None) -> str | None:
    """Token of a server: as given, made where the address is not loopback, None if none is needed.

    Raises:
        InputError: one that is easily guessed.
    """
    if given is None:
        return None if is_loopback(host) else secrets.token_urlsafe(24)
    if len(given) < SHORTEST or not given.isascii() or not given.isprintable():
        raise InputError(
            "--token",
            found=f"{len(given)} characters",
            expected=f"{SHORTEST} plain characters at least",
            remedy="leave it out: one is made and printed",
        )
    return given


def is_loopback(host: str) -> bool:
    """Whether an address can only be reached from this machine."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def is_own_name(host_header: str, listening: str) -> bool:
    """Whether a Host header names this server: on loopback a name of it, elsewhere a number or the machine's own name."""
    name = _without_port(host_header).lower()
    if not name:
        return False
    if is_loopback(listening):
        return is_loopback(name)
    own = {listening.lower(), socket.gethostname().lower(), socket.getfqdn().lower(), "localhost"}
    return name in own or _is_address(name)


def is_same_origin(origin: str, host_header: str) -> bool:
    """Whether an Origin header is the site of the Host header, port included."""
    scheme, separator, place = origin.partition("://")
    return bool(separator) and scheme in ("http", "https") and place.lower() == host_header.lower()


def same(given: str, wanted: str) -> bool:
    """Compare secrets in a time that does not tell how much of them is right; nothing equals no secret."""
    return bool(wanted) and hmac.compare_digest(given.encode(), wanted.encode())


def too_long(stated: str | None, most: int) -> bool:
    """Whether a stated length is more than allowed, or no length at all."""
    return stated is not None and not (stated.isascii() and stated.isdigit() and int(stated[:20]) <= most)


def headers_of(scope: Scope) -> dict[str, str]:
    """Headers by lower-case name; of one given twice the last, and no host at all if two are given."""
    headers: dict[str, str] = {}
    for raw, value in scope["headers"]:
        name = raw.decode("latin-1").lower()
        headers[name] = "" if name in ("host", "origin") and name in headers else value.decode("latin-1")
    return headers


def _safe(send: Any) -> Any:
    """Add headers that keep a browser from framing, guessing types and telling others where it was."""

    async def safe(message: Any) -> None:
        if message["type"] == "http.response.start":
            there = {name.lower() for name, _ in message["headers"]}
            wanted = {
                b"content-security-policy": POLICY.encode(),
                b"x-content-type-options": b"nosniff",
                b"x-frame-options": b"DENY",
                b"referrer-policy": b"no-referrer",
                b"cross-origin-resource-policy": b"same-origin",
            }
            extra = [(name, value) for name, value in wanted.items() if name not in there]
            message = {**message, "headers": [*message["headers"], *extra]}
        await send(message)

    return safe


async def _refuse(scope: Any, receive: Any, send: Any, status: int, words: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    await PlainTextResponse(f"{words}\n", status)(scope, receive, _safe(send))


def _welcome(scope: Scope, cookie: str) -> Response:
    """Set the cookie and go on to the same page without the token, so that it stays out of bookmarks and logs."""
    query = QueryParams(scope.get("query_string", b"")).multi_items()
    rest = urlencode([(name, value) for name, value in query if name != "token"])
    path = quote("/" + str(scope["path"]).lstrip("/\\"))
    answer = RedirectResponse(path + (f"?{rest}" if rest else ""), 303, {"cache-control": "no-store"})
    answer.set_cookie(COOKIE, cookie, httponly=True, samesite="lax")
    return answer


def _without_port(host: str) -> str:
    """Name of a Host header: `[::1]:80` gives `::1`."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    name, _, port = host.partition(":")
    return name if not port or port.isdigit() else ""


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
