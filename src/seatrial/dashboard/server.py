"""The server: pages, files and uploads of one folder behind the guard, until it is interrupted."""

import asyncio
import logging
import socket
import threading
import webbrowser
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from urllib.parse import quote

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from nicegui import Client, ui
from nicegui import app as pages
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from seatrial.campaign.config.named_files import keep_within
from seatrial.cli.answer import echo
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.processes import end_all
from seatrial.dashboard.app_context import AppContext, say
from seatrial.dashboard.campaign_paths import CampaignPaths
from seatrial.dashboard.jobs import Jobs
from seatrial.dashboard.logs import receive
from seatrial.dashboard.page_layout import frame, missing_page, next_part
from seatrial.dashboard.pages import (
    campaign_file,
    compare,
    design,
    live,
    model,
    new_campaign,
    overview,
    records,
    report,
    results,
    tweak,
    work,
)
from seatrial.dashboard.request_guard import GuardedApp, RequestGuard, is_loopback
from seatrial.dashboard.throttling import Throttle, punctual
from seatrial.dashboard.view_models import words_of
from seatrial.report.figures.style import PALETTE
from seatrial.report.html import render_html

UPLOAD_HERE, UPLOAD_FROM_ELSEWHERE = 8 << 30, 512 << 20
"""Bytes of an upload, at most: by whoever sits at this machine, and over the network."""
PACE = Throttle()
BUILD = 60.0
"""Seconds in which a page is built, on a machine that has other things to do."""
SETTLED = 1.5
"""Seconds after which a page has what it shows, and the machine may get ready what comes next."""
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; sandbox allow-same-origin"
)
"""A report needs no script: none is run, whoever wrote the file."""
VIEWS = {
    "import": records.build,
    "model": model.build,
    "design": design.build,
    "live": live.build,
    "run": work.build,
    "results": results.build,
    "tweak": tweak.build,
    "compare": compare.build,
    "report": report.build,
    "file": campaign_file.build,
}


def serve(
    folder: Path,
    host: str,
    port: int,
    token: str | None,
    browser: bool,
    also: Sequence[Path] = (),
) -> None:
    """Serve a folder until interrupted; it is made if only its parent exists.

    Its campaigns may read files below it and below the folders `also`, whoever looks.

    Args:
        folder: to serve.
        host: address to listen on.
        port: 0 for any that is free.
        token: that every request has to show; None for none.
        browser: whether one is opened.
        also: further folders that campaigns may read.

    Raises:
        InputError: no such folder and no parent of it, or an address that cannot be listened on.
    """
    if not folder.exists() and folder.parent.is_dir():
        folder.mkdir()
        echo(f"{folder} did not exist and was made, for new campaigns")
    context = AppContext(CampaignPaths.of(folder), jobs=Jobs())
    others = [CampaignPaths.of(other).root for other in also]
    keep_within([context.campaign_paths.root, *others])
    here = _listen(host, port)
    port = here.getsockname()[1]
    app = build(context, RequestGuard(host, token, UPLOAD_HERE if is_loopback(host) else UPLOAD_FROM_ELSEWHERE))
    anywhere = host in ("0.0.0.0", "::")
    shown = _address(socket.gethostname() if anywhere else host, port, token)
    echo(f"{context.campaign_paths.root} is served at {shown}")
    echo(f"its campaigns read only files below {' and '.join(map(str, [context.campaign_paths.root, *others]))}")
    if not is_loopback(host):
        echo(
            "anyone with the token has full access, and the traffic is not encrypted: use a network you trust, or ssh -L",
        )
    echo("Ctrl-C ends it; commands started from the page continue")
    if browser:
        threading.Timer(1.0, _open, [_address("127.0.0.1" if anywhere else host, port, token)]).start()
    config = uvicorn.Config(
        app,
        log_config=None,  # its own would close every handler of this process
        log_level="warning",
        access_log=False,
        server_header=False,
        http=punctual(PACE),
        ws_max_size=1 << 20,
        timeout_graceful_shutdown=1,
    )
    try:
        with suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[here])
    finally:
        context.worker_pool.close()
        context.jobs.close()


def _address(host: str, port: int, token: str | None) -> str:
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/{f'?token={quote(token)}' if token else ''}"


def build(context: AppContext, guard: RequestGuard) -> GuardedApp:
    """Put the application together."""
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    _add_files(app, context, guard)
    _add_pages(context)
    _add_missing(app, context)
    ui.add_head_html('<link rel="stylesheet" href="/style.css">', shared=True)
    ui.run_with(
        app,
        title="seatrial",
        favicon=_FAVICON,
        tailwind=False,
        language="en-US",
        dark=False,
        reconnect_timeout=30.0,
        show_welcome_message=False,
    )
    logging.getLogger("nicegui").setLevel(logging.ERROR)
    app.router.on_startup.append(context.worker_pool.warm)
    app.router.on_shutdown.append(end_all)
    return GuardedApp(app, guard, ("/", "/new", *(f"/{view}" for view in VIEWS)), PACE)


_FAVICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'><rect width='32' height='32' rx='6' fill='#0a67ad'/>"
    "<path d='M4 20q6-9 12 0t12 0' fill='none' stroke='#fff' stroke-width='3'/></svg>"
)


def _add_files(app: FastAPI, context: AppContext, guard: RequestGuard) -> None:
    style = (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
    light, dark = ("; ".join(f"--{name}: {pair[i]}" for name, pair in PALETTE.items()) for i in (0, 1))
    of_report = render_html("style.css")
    style = f':root {{ {light}; }}\n:root[data-theme="dark"] {{ {dark}; }}\n{style}\n.report {{\n{of_report}}}\n'

    @app.get("/style.css")
    async def _style() -> Response:
        return Response(style, media_type="text/css", headers={"cache-control": "no-cache"})

    @app.get("/download")
    async def _download(campaign: str = "", file: str = "", shown: bool = False) -> Response:
        try:
            path, kind = context.campaign_paths.download(campaign, file)
        except (SeatrialError, OSError) as error:
            raise HTTPException(404, words_of(error)) from error
        headers = {"cache-control": "no-cache", "content-security-policy": REPORT_POLICY}
        saved = not shown or kind == "application/octet-stream"
        return FileResponse(path, media_type=kind, headers=headers, filename=path.name if saved else None)

    @app.post("/upload/")
    async def _upload(request: Request, campaign: str = "", name: str = "") -> Response:
        from seatrial.dashboard.logs import SUFFIXES

        try:
            folder = context.campaign_paths.folder(campaign) if campaign else context.campaign_paths.root
            kept, is_another = await receive(request.stream(), folder, name, SUFFIXES, guard.most)
        except (SeatrialError, OSError) as error:
            # An answer, not a failure: a browser would report that in its console.
            return JSONResponse(["refused", words_of(error)])
        except ClientDisconnect:  # gone, or cut off by the guard
            return PlainTextResponse(f"broken off, too slow, or more than {guard.most >> 20:,} MiB\n", 413)
        return JSONResponse(["replaced" if is_another else "kept", kept])


def _add_pages(context: AppContext) -> None:
    @ui.page("/", response_timeout=BUILD)
    async def _overview() -> None:
        await overview.build(context)

    @ui.page("/new", response_timeout=BUILD)
    async def _new(case: str = "") -> None:
        await new_campaign.build(context, case)

    for view, make in VIEWS.items():
        _add_view(context, view, make)


def _add_missing(app: FastAPI, context: AppContext) -> None:
    """Answer for an address behind which there is nothing, be it of a page or of a file."""

    async def missing(request: Request, error: Exception) -> Response:
        words = error.detail if isinstance(error, HTTPException) and error.detail != HTTPStatus.NOT_FOUND.phrase else ""
        with Client(ui.page(""), request=request) as client:
            missing_page(context, words or f"There is no page {request.url.path}.")
        return client.build_response(request, HTTPStatus.NOT_FOUND)

    for one in (app, pages):
        one.add_exception_handler(HTTPStatus.NOT_FOUND, missing)


def _add_view(context: AppContext, view: str, make: Callable[..., Awaitable[None]]) -> None:
    @ui.page(f"/{view}", response_timeout=BUILD)
    async def _view(request: Request, campaign: str = "") -> Response | None:
        try:
            folder = await asyncio.to_thread(context.campaign_paths.folder, campaign)
        except SeatrialError as error:
            missing_page(context, error)
            return ui.context.client.build_response(request, HTTPStatus.NOT_FOUND)
        with frame(context, view, campaign, folder):
            ui.timer(SETTLED, lambda: context.read_ahead(folder), once=True)
            try:
                await next_part(context, view, campaign, folder)
                await make(context, campaign, folder)
            except Exception as error:
                logging.getLogger(__name__).exception("the view %s of %s", view, folder)
                say(
                    f"{type(error).__name__}: {error}. A result may be of another version of seatrial: run the campaign again."
                )
        return None


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        here = socket.socket(family, socket.SOCK_STREAM)
        here.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        here.bind((host, port))
    except (OSError, OverflowError, UnicodeError) as cause:
        words = getattr(cause, "strerror", None) or str(cause)
        raise InputError(
            f"--host {host} --port {port}",
            found=words,
            expected="an address of this machine and a free port",
            remedy="choose another with --port, or end the program that uses it",
        ) from cause
    return here


def _open(address: str) -> None:
    with suppress(webbrowser.Error):
        webbrowser.open(address)
