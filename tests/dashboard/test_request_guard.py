"""Who may ask: tokens, Host, Origin, sizes, and the headers of every answer."""

import asyncio

import httpx
import pytest

from seatrial.core.errors import InputError
from seatrial.dashboard.request_guard import (
    POLICY,
    SMALL_BODY,
    GuardedApp,
    RequestGuard,
    is_loopback,
    is_own_name,
    is_same_origin,
    same,
    token_for,
    too_long,
)

TOKEN = "correct horse battery"


async def echo(scope, receive, send):
    """Answer with the size of the body; an end of the body that never comes is an error."""
    size, more = 0, True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            break
        size, more = size + len(message.get("body", b"")), message.get("more_body", False)
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": str(size).encode()})


def ask(guard, method="GET", path="/", host="127.0.0.1:8080", content=None, **headers):
    async def answer():
        transport = httpx.ASGITransport(GuardedApp(echo, guard))
        async with httpx.AsyncClient(transport=transport, base_url="http://x") as client:
            sent = {"host": host, **{name.replace("_", "-"): value for name, value in headers.items()}}
            return await client.request(method, path, headers=sent, content=content)

    return asyncio.run(answer())


HERE = RequestGuard("127.0.0.1", None, 1000)
OUTSIDE = RequestGuard("0.0.0.0", TOKEN, 1000)


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:9000", "[::1]:1", "127.8.9.1", "LOCALHOST"])
def test_loopback_answers_to_its_own_names(host):
    assert ask(HERE, host=host).status_code == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1.evil.example", "localhost.evil.example:80", "10.0.0.5", "", "127.0.0.1:80:80", "a b"],
)
def test_a_name_made_to_point_here_is_refused(host):
    assert ask(HERE, host=host).status_code == 421


def test_request_with_two_hosts_is_refused():
    scope = {
        "type": "http",
        "method": "GET",
        "path": "/",
        "headers": [(b"host", b"127.0.0.1"), (b"Host", b"evil.example")],
    }
    assert HERE.refusal(scope)[0] == 421


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://127.0.0.1:8080", 200),
        ("http://127.0.0.1:3000", 403),
        ("http://127.0.0.1:80801", 403),
        ("http://127.0.0.1:80", 403),
        ("http://127.0.0.1:8080.evil.example", 403),
        ("http://localhost:8080", 403),
        ("https://evil.example", 403),
        ("null", 403),
        ("", 403),
        ("file://127.0.0.1:8080", 403),
    ],
)
def test_only_our_own_pages_may_ask(origin, status):
    for method in ("GET", "POST"):
        assert ask(HERE, method, origin=origin).status_code == status


def test_a_form_of_another_site_is_refused_also_without_origin():
    assert ask(HERE, "POST", sec_fetch_site="cross-site").status_code == 403
    assert ask(HERE, "POST", sec_fetch_site="same-site").status_code == 403
    assert ask(HERE, "POST", sec_fetch_site="same-origin").status_code == 200
    assert ask(HERE, "GET", sec_fetch_site="cross-site").status_code == 200


def test_web_sockets_of_other_sites_are_closed():
    scope = {
        "type": "websocket",
        "path": "/",
        "headers": [(b"host", b"localhost"), (b"origin", b"http://evil.example")],
    }
    sent = []

    async def receive():
        return {"type": "websocket.connect"}

    async def send(message):
        sent.append(message)

    asyncio.run(GuardedApp(echo, HERE)(scope, receive, send))
    assert sent == [{"type": "websocket.close", "code": 1008}]
    assert HERE.refusal({**scope, "headers": [(b"host", b"localhost"), (b"origin", b"http://localhost")]}) is None


def test_the_token_opens_by_header_cookie_or_once_by_address():
    wide = {"host": "192.168.1.5:8080"}
    assert ask(OUTSIDE, **wide).status_code == 401
    assert ask(OUTSIDE, authorization="Bearer wrong", **wide).status_code == 401
    assert ask(OUTSIDE, path="/?token=wrong", **wide).status_code == 401
    assert ask(OUTSIDE, authorization=f"Bearer {TOKEN}", **wide).status_code == 200
    assert ask(OUTSIDE, x_seatrial_token=TOKEN, **wide).status_code == 200
    entered = ask(OUTSIDE, path=f"/results?campaign=a%20b&token={TOKEN}", **wide)
    assert entered.status_code == 303
    assert entered.headers["location"] == "/results?campaign=a+b"
    cookie = entered.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert TOKEN not in cookie
    assert ask(OUTSIDE, cookie=cookie.split(";")[0], **wide).status_code == 200
    assert ask(OUTSIDE, cookie="seatrial=00", **wide).status_code == 401
    assert ask(OUTSIDE, cookie='seatrial="', **wide).status_code == 401
    assert ask(OUTSIDE, "POST", path=f"/upload/?token={TOKEN}", **wide).status_code == 401


def test_entering_never_leads_to_another_site():
    for path in ("//evil.example/x", "/\\evil.example", "/%0d%0aset-cookie:a=b"):
        answer = ask(OUTSIDE, path=f"{path}?token={TOKEN}", host="10.0.0.1")
        assert answer.status_code == 303
        place = answer.headers["location"]
        assert place.startswith("/")
        assert not place.startswith(("//", "/\\"))
        assert "a=b" not in answer.headers["set-cookie"]


def test_outside_numbers_and_the_machine_s_name_are_known_and_others_not():
    assert is_own_name("10.1.2.3:80", "0.0.0.0")
    assert is_own_name("boat.local:80", "boat.local")
    assert not is_own_name("evil.example", "0.0.0.0")


def test_bodies_are_limited_by_what_they_state_and_by_what_they_are():
    assert ask(HERE, "POST", content=b"x" * SMALL_BODY).status_code == 200
    assert ask(HERE, "POST", content=b"x" * (SMALL_BODY + 1)).status_code == 413
    assert ask(HERE, "POST", path="/upload/", content=b"x" * 1001).status_code == 413
    assert ask(HERE, "POST", content_length="-1").status_code == 413

    async def chunks():
        for _ in range(20):
            yield b"x" * 100

    assert int(ask(HERE, "POST", path="/upload/", content=chunks()).text) <= 1000


@pytest.mark.parametrize("stated", ["x", "1e3", "-5", "", "99999999999999999999999"])
def test_a_length_that_is_none_is_too_long(stated):
    assert too_long(stated, 1000)
    assert not too_long(None, 1000)
    assert not too_long("1000", 1000)


def test_answers_and_refusals_carry_safe_headers():
    for answer in (ask(HERE), ask(HERE, host="evil.example")):
        assert answer.headers["content-security-policy"] == POLICY
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["referrer-policy"] == "no-referrer"


def test_a_token_is_demanded_anywhere_but_on_loopback():
    assert token_for("127.0.0.1", None) is None
    assert token_for("localhost", None) is None
    made = token_for("0.0.0.0", None)
    assert made is not None
    assert len(made) >= 32
    assert made != token_for("0.0.0.0", None)
    assert token_for("127.0.0.1", TOKEN) == TOKEN
    with pytest.raises(InputError, match="16 plain characters"):
        token_for("0.0.0.0", "short")


def test_tokens_names_and_origins_are_compared_exactly():
    assert not same("", "")
    assert same("a", "a")
    assert not same("ä", "a")
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")
    assert not is_loopback("loopback.evil")
    assert not is_same_origin("http://a", "b")
    assert is_same_origin("HTTPS://A:1".lower(), "a:1")
