"""The page of a session: on this computer only, for those who have its token."""

import asyncio
import contextlib
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route

from diagrams.programs.lab.assistant import (
    map_fields,
    save_map,
    save_take,
    with_map_field,
)
from diagrams.programs.lab.comparison import replay_apart
from diagrams.programs.lab.figures import session_figures
from diagrams.programs.lab.gate import HOST, Address, TokenGate, listen
from diagrams.programs.lab.session import LabSession
from diagrams.programs.lab.state import CORRECTED, NOMINAL
from glider.campaign.importing.recording import UNITS
from glider.campaign.settings import FRAME_CHOICES, QUANTITIES, read_settings
from glider.errors import InputError, expect
from glider.files.schema import json_text
from glider.report.as_page import STATIC, color_style

_PAGE = Path(__file__).parent / "page"

_FILES = {
    "lab.js": _PAGE / "lab.js",
    "lab.css": _PAGE / "lab.css",
    **{name: STATIC / name for name in ("page.css", "page.js")},
    "plotly.js": STATIC / "plotly-basic.min.js",
}

_PERIOD = 0.2
"""Time between two looks at the folder, or at what is new for the page [s]."""

_AFTER_FAULT = 5.0
"""The same after a fault [s]: whatever fails again does not fill the terminal."""

_LONGEST_MAP = 100_000
"""Characters of a map."""

_MAP_CHOICES = {
    "frame": {name: values for name, (values, _) in FRAME_CHOICES.items()},
    "units": {kind: list(units) for kind, units in UNITS.items()},
    "columns": list(QUANTITIES),
    "meanings": {name: meaning for name, (_, meaning) in FRAME_CHOICES.items()},
}
"""What a person may choose from in a map."""

_OWN_SCRIPTS = {"Content-Security-Policy": "frame-ancestors 'self'"}
"""Headers of a replay and a report, which hold their own scripts."""


class _Pages:
    """What is behind each address; the session is stepped elsewhere."""

    def __init__(self, session: LabSession, address: Address) -> None:
        self._session = session
        self._address = address

    async def index(self, request: Request) -> Response:
        """The page; from here on the browser has the token as a cookie."""
        response = FileResponse(_PAGE / "index.html")
        cookie = self._address.cookie
        token = self._address.token
        response.set_cookie(cookie, token, httponly=True, samesite="strict")
        return response

    async def static(self, request: Request) -> Response:
        """A file of the page."""
        return _file(_FILES.get(request.path_params["name"]))

    async def colors(self, request: Request) -> Response:
        """The colors of figures."""
        return Response(color_style(), media_type="text/css")

    async def events(self, request: Request) -> Response:
        """The view, whenever it changes."""
        stream = _stream(self._session, request)
        return StreamingResponse(stream, media_type="text/event-stream")

    async def figure(self, request: Request) -> Response:
        """The figure of a throw."""
        name = request.path_params["name"] + ".csv"
        comparison = self._session.comparison(name)
        if comparison is None:
            raise HTTPException(404)
        figure = comparison.figure(has_wire=self._has_wire(name))
        text = json_text(figure, indent=-1)
        return Response(text, media_type="application/json")

    async def replay(self, request: Request) -> Response:
        """A throw in Meshcat."""
        name = request.path_params["name"] + ".csv"
        comparison = self._session.comparison(name)
        if comparison is None:
            raise HTTPException(404)
        folder = self._session.watched.campaign
        campaign, _ = read_settings(folder / "campaign.yaml")
        html = await run_in_threadpool(
            replay_apart, comparison, campaign, has_wire=self._has_wire(name)
        )
        return HTMLResponse(html, headers=_OWN_SCRIPTS)

    def _has_wire(self, name: str) -> bool:
        """Whether a throw was the station's, whose axes begin at the wire."""
        throws = self._session.state.throws
        return any(throw.name == name and throw.planned for throw in throws)

    async def report(self, request: Request) -> Response:
        """The report of the last trace."""
        return _file(self._session.report / "report.html", _OWN_SCRIPTS)

    async def proposal(self, request: Request) -> Response:
        """A file of the next throw: its picture, or its commands."""
        name = request.path_params["name"]
        folder = self._session.report / "next_throw"
        known = {path.name: path for path in folder.glob("*") if path.is_file()}
        return _file(known.get(name))

    async def fly(self, request: Request) -> Response:
        """Asks for launches."""
        launches = self._session.launches
        if launches is None:
            raise HTTPException(404)
        if self._session.link and self._session.link.is_stopped:
            raise HTTPException(400, "Stopped; expected that you arm again first.")
        asked = request.query_params
        with _refusals():
            throws = asked.get("throws", "")
            launches.ask(
                asked.get("planned", ""), int(throws) if throws.isdecimal() else 0
            )
        return PlainTextResponse("")

    async def stop(self, request: Request) -> Response:
        """Turns every servo on the bus to neutral, and ends launches."""
        self._session.stop()
        return PlainTextResponse("")

    async def arm(self, request: Request) -> Response:
        """Ends the Stop."""
        link = self._session.link
        if link is None:
            raise HTTPException(404)
        link.arm()
        if link.is_stopped:
            words = "Not armed: another operator stopped it, who must arm it again."
            raise HTTPException(400, words)
        return PlainTextResponse("")

    async def next_throw(self, request: Request) -> Response:
        """Looks again for the next throw where it was not found."""
        self._session.asked_proposal = True
        return PlainTextResponse("")

    async def take(self, request: Request) -> Response:
        """Saves a take that was dropped on the page."""
        with _refusals():
            watched = self._session.watched
            name = request.path_params["name"]
            await save_take(watched, name, request.stream())
        return PlainTextResponse("")

    async def map(self, request: Request) -> Response:
        """Checks a map, saves it, or asks for another proposal."""
        text = await _small_text(request)
        what = request.path_params["what"]
        with _refusals():
            if what == "save":
                save_map(self._session.watched, self._session.state.draft, text)
            elif what == "propose":
                self._session.asked_map = ""
            else:
                expect(bool(text.strip()), "the map", "nothing", "its columns")
                self._session.asked_map = text
        return PlainTextResponse("")

    async def map_fields(self, request: Request) -> Response:
        """The fields of a map, or with one changed the map's text."""
        text = await _small_text(request)
        asked = request.query_params
        if "name" not in asked:
            return JSONResponse(map_fields(text))
        given = (asked.get(key, "") for key in ("section", "name", "value"))
        with _refusals():
            changed = with_map_field(text, *given)
        return PlainTextResponse(changed)

    async def map_picture(self, request: Request) -> Response:
        """The flights as the map reads them."""
        return _file(self._session.watched.kept / "draft" / "MAP.png")


def make_app(session: LabSession, address: Address) -> Starlette:
    """The application; streams of events end when `state.is_ending()`."""
    pages = _Pages(session, address)
    app = Starlette(
        routes=[
            Route("/", pages.index),
            Route("/events", pages.events),
            Route("/static/{name}", pages.static),
            Route("/colors.css", pages.colors),
            Route("/throws/{name}.json", pages.figure),
            Route("/throws/{name}/replay", pages.replay),
            Route("/report", pages.report),
            Route("/next/{name}", pages.proposal),
            Route("/fly", pages.fly, methods=["POST"]),
            Route("/stop", pages.stop, methods=["POST"]),
            Route("/arm", pages.arm, methods=["POST"]),
            Route("/next-throw", pages.next_throw, methods=["POST"]),
            Route("/takes/{name}", pages.take, methods=["POST"]),
            Route("/map/fields", pages.map_fields, methods=["POST"]),
            Route("/map/{what}", pages.map, methods=["POST"]),
            Route("/map.png", pages.map_picture),
        ],
        middleware=[
            # Another site's name that resolves to this computer gets nothing.
            Middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"]),
            Middleware(TokenGate, address=address),
        ],
    )
    app.state.is_ending = lambda: False
    return app


def _view_of(session: LabSession) -> dict[str, Any]:
    """What the page shows."""
    state = session.state
    launches = session.launches
    draft = state.draft
    is_open = session.watched.is_open
    faults = [session.fault, launches.fault if launches else ""]
    return {
        "folder": str(session.watched.path),
        "doing": session.doing,
        "faults": [fault for fault in faults if fault],
        "state": state,
        "perches": {
            planned: state.count_perches(planned) for planned in (NOMINAL, CORRECTED)
        },
        "figures": session_figures(state),
        "import": {
            "is_open": is_open and launches is None,
            "has_takes": session.watched.has_takes,
            "takes": [file.name for file in session.watched.takes],
            "skipped": draft.skipped if draft and is_open else session.watched.skipped,
            "choices": _MAP_CHOICES,
        },
        "launches": launches
        and {
            "truth": launches.truth,
            "count": launches.count,
            "flies": bool(launches.doing),
        },
    }


def serve(session: LabSession, port: int, show: Callable[[str], object]) -> None:
    """Serves the page and steps the session, until Ctrl-C."""
    ended = threading.Event()

    def work() -> None:
        period = _PERIOD
        while not ended.wait(period):
            period = _PERIOD if session.try_step() else _AFTER_FAULT
        if session.launches:  # They would be ended once more at the end of this thread.
            session.launches.close()

    listening, address = listen(session.watched.kept / "address.json", port)
    with listening:
        show(f"Session: {address.url} (Ctrl-C ends it)")
        app = make_app(session, address)
        config = uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=5)
        server = uvicorn.Server(config)
        app.state.is_ending = lambda: server.should_exit
        threads = [threading.Thread(target=work, daemon=True)]
        if session.link:
            run = session.link.run
            threads.append(threading.Thread(target=run, args=(ended,), daemon=True))
        for thread in threads:
            thread.start()
        try:
            with contextlib.suppress(KeyboardInterrupt):  # Raised again when it ended.
                server.run(sockets=[listening])
        finally:
            ended.set()
            for thread in threads:
                thread.join()


async def _small_text(request: Request) -> str:
    """The body of a request, as text."""
    data = b""
    async for part in request.stream():
        data += part
        if len(data) > _LONGEST_MAP:
            raise HTTPException(413, "The map is too long.")
    return data.decode(errors="replace")


async def _stream(session: LabSession, request: Request) -> AsyncIterator[str]:
    """Sends the view whenever it changes; the browser connects again by itself."""
    sent: tuple[object, ...] = ()
    said: dict[str, Any] | None = None
    is_ending = request.app.state.is_ending
    while not (is_ending() or await request.is_disconnected()):
        fault = session.launches.fault if session.launches else ""
        watched = session.watched
        takes = watched.is_open, len(watched.takes), id(watched.skipped)
        now = id(session.state), session.doing, session.fault, fault, takes
        if now != sent:
            sent = now
            yield f"data: {json_text(_view_of(session), indent=-1)}\n\n"
        if session.link and (state := session.link.state) != said:
            said = state
            yield f"event: station\ndata: {json_text(state, indent=-1)}\n\n"
        await asyncio.sleep(_PERIOD)


@contextlib.contextmanager
def _refusals() -> Iterator[None]:
    """Turns what cannot be used into an answer."""
    try:
        yield
    except InputError as error:
        raise HTTPException(400, str(error)) from None


def _file(path: Path | None, headers: dict[str, str] | None = None) -> Response:
    if path is None or not path.is_file():
        raise HTTPException(404)
    return FileResponse(path, headers=headers)
