"""The page of a session: on this computer only, for those who have its token."""

import asyncio
import contextlib
import hmac
import secrets
import socket
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from diagrams.lab.session import LabSession
from diagrams.lab.state import CORRECTED, NOMINAL
from glider.files.schema import json_text
from glider.report.as_page import STATIC

PAGE = Path(__file__).parent / "page"

HOST = "127.0.0.1"

PERIOD = 0.2
"""Time between two looks at the folder, or at what is new for the page [s]."""

AFTER_FAULT = 5.0
"""The same after a fault [s]: whatever fails again does not fill the terminal."""

COOKIE = "glider_lab"

_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class TokenGate:
    """Lets in who has the token, in the address or in the cookie that it leaves."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 403, or passes a request on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        shown = request.query_params.get("token") or request.cookies.get(COOKIE, "")
        if hmac.compare_digest(shown.encode(), self._token.encode()):
            await self._app(scope, receive, send)
        else:
            words = "Expected the token of this session: open the address it printed.\n"
            await PlainTextResponse(words, 403)(scope, receive, send)


def make_app(session: LabSession, token: str) -> Starlette:
    """The application; the session is stepped elsewhere."""

    async def index(request: Request) -> Response:
        response = FileResponse(PAGE / "index.html", headers=_HEADERS)
        # Of one port only by its name: other sessions have their own.
        response.set_cookie(COOKIE, token, httponly=True, samesite="strict")
        return response

    async def events(request: Request) -> Response:
        headers = {**_HEADERS, "X-Accel-Buffering": "no"}
        return StreamingResponse(
            _stream(session, request), media_type="text/event-stream", headers=headers
        )

    async def picture(request: Request) -> Response:
        names = {
            throw.name: session.picture(throw.name) for throw in session.state.throws
        }
        return _file(names.get(request.path_params["name"] + ".csv"))

    async def report(request: Request) -> Response:
        return _file(session.report / "report.html", {})  # It holds its own scripts.

    async def next_throw(request: Request) -> Response:
        return _file(session.report / "next_throw" / "next_throw.png")

    def static(path: Path) -> Callable:
        async def send(request: Request) -> Response:
            return _file(path)

        return send

    return Starlette(
        routes=[
            Route("/", index),
            Route("/events", events),
            Route("/throws/{name}.png", picture),
            Route("/report", report),
            Route("/next_throw.png", next_throw),
            Route("/lab.js", static(PAGE / "lab.js")),
            Route("/lab.css", static(PAGE / "lab.css")),
            Route("/page.css", static(STATIC / "page.css")),
        ],
        middleware=[
            # Another site's name that resolves to this computer gets nothing.
            Middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"]),
            Middleware(TokenGate, token=token),
        ],
    )


def view_of(session: LabSession) -> dict[str, Any]:
    """What the page shows."""
    state = session.state
    return {
        "folder": str(session.watched.path),
        "doing": session.doing,
        "fault": session.fault,
        "state": state,
        "drawn": [t.name for t in state.throws if t.errors],
        "perches": {
            planned: state.count_perches(planned) for planned in (NOMINAL, CORRECTED)
        },
    }


def serve(session: LabSession, port: int, show: Callable[[str], object]) -> None:
    """Serves the page and steps the session, until Ctrl-C."""
    token, ended = secrets.token_urlsafe(18), threading.Event()

    def work() -> None:
        period = PERIOD
        while not ended.wait(period):
            period = PERIOD if session.try_step() else AFTER_FAULT

    with socket.create_server((HOST, port)) as listening:
        port = listening.getsockname()[1]
        show(f"Session: http://{HOST}:{port}/?token={token} (Ctrl-C ends it)")
        config = uvicorn.Config(
            make_app(session, token), log_level="warning", timeout_graceful_shutdown=1
        )
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        try:
            with contextlib.suppress(KeyboardInterrupt):  # Raised again when it ended.
                uvicorn.Server(config).run(sockets=[listening])
        finally:
            ended.set()
            thread.join()


async def _stream(session: LabSession, request: Request) -> AsyncIterator[str]:
    """Sends the view whenever it changes; the browser connects again by itself."""
    sent: tuple[object, ...] = ()
    while not await request.is_disconnected():
        now = id(session.state), session.doing, session.fault
        if now != sent:
            sent = now
            yield f"data: {json_text(view_of(session), indent=-1)}\n\n"
        await asyncio.sleep(PERIOD)


def _file(path: Path | None, headers: dict[str, str] = _HEADERS) -> Response:
    if path is None or not path.is_file():
        raise HTTPException(404)
    return FileResponse(path, headers=headers)
