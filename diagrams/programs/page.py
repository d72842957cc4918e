"""A page that shows a Meshcat: a legend and a clock above it, controls below it.

write_html(path, meshcat, legend)   # What is recorded: one file, no server, no network.
url = serve_page(meshcat, legend)   # What is live, a recording included.

The page reads clock, speed and pitch from the readouts that `AddOverlays` makes.
"""

import dataclasses
import logging
import os
import threading
import urllib.error
import urllib.request
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import jinja2
from pydrake.geometry import Meshcat, MeshcatParams

from diagrams.overlays import ARROW_SCALE
from diagrams.playback import Track
from diagrams.urdf import COLORS

Color = tuple[float, ...]

_PORT_BEYOND = 100
"""Number that is added to Meshcat's port for the port of its page, if that is free."""

HOST = "127.0.0.1"
"""Address that scenes are served on: programs of other computers cannot open it."""

_OWN_ADDRESS = "url = location.toString();"
"""Line of Drake's page with the address that it listens to."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Entry:
    """A glider in the legend."""

    name: str
    """Name for people."""

    slug: str
    """Name in Meshcat."""

    color: Color | None = None
    """Red, green, blue and opacity; None for the glider's own colors."""

    @property
    def rgb(self) -> tuple[int, ...]:
        """Red, green and blue from 0 to 255."""
        color = COLORS["wing"] if self.color is None else self.color
        return tuple(round(255 * c) for c in color[:3])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Legend:
    """Title, gliders and speed of a page."""

    title: str = "Flight"
    """Title of the page."""

    entries: tuple[Entry, ...] = (Entry(name="glider", slug="glider"),)
    """The gliders; as it is, the one that `AddScene` draws."""

    rate: float = 1.0
    """Seconds of flight in one second of playback, at first."""

    has_forces: bool = False
    """Whether arrows show forces."""

    def html(self) -> str:
        """Returns the HTML above and below the scene, with its script."""
        environment = jinja2.Environment(
            loader=jinja2.PackageLoader("diagrams.programs"),
            autoescape=True,
            undefined=jinja2.StrictUndefined,
        )
        return environment.get_template("flight.html").render(
            title=self.title,
            entries=self.entries,
            rate=self.rate,
            arrow_scale=ARROW_SCALE if self.has_forces else None,
        )


def legend_of(tracks: Sequence[Track], title: str, rate: float = 1.0) -> Legend:
    """Returns the legend of a page that shows tracks.

    Args:
        tracks: as in `play`.
        title: of the page.
        rate: as in `play`.
    """
    return Legend(
        title=title,
        entries=tuple(
            Entry(name=track.name, slug=track.slug, color=track.color)
            for track in tracks
        ),
        rate=rate,
        has_forces=any(track.forces is not None for track in tracks),
    )


def open_meshcat() -> Meshcat:
    """Opens a Meshcat that only programs of this computer reach.

    Drake's log would name its page, which has neither legend nor clock.
    """
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)
    try:
        return Meshcat(MeshcatParams(host=HOST))
    finally:
        log.setLevel(level)


def write_html(path: Path | str, meshcat: Meshcat, legend: Legend) -> None:
    """Writes what Meshcat shows, the recording included, as one page.

    The page needs no server and no network.
    """
    part = Path(f"{path}.{os.getpid()}.part")
    part.write_text(_with(meshcat.StaticHtml(), legend), encoding="utf-8")
    part.replace(path)


def serve_page(meshcat: Meshcat, legend: Legend) -> str:
    """Serves what Meshcat shows now and from now on, until the program's end.

    Returns:
        the address of the page. The browser must reach Meshcat's own port too.
    """
    own = meshcat.web_url()
    with urllib.request.urlopen(own) as answer:
        html = answer.read().decode()
    if _OWN_ADDRESS not in html:
        return own  # A Drake whose page is another one: its page without ours.
    address = (
        f"url = `${{location.protocol}}//${{location.hostname}}:{meshcat.port()}/`;"
    )
    page = _with(html.replace(_OWN_ADDRESS, address), legend).encode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            if self.path.partition("?")[0] in ("/", "/index.html"):
                self._answer(200, "text/html; charset=utf-8", page)
                return
            try:
                with urllib.request.urlopen(own + self.path) as answer:
                    kind = answer.headers.get("Content-Type", "text/plain")
                    self._answer(200, kind, answer.read())
            except urllib.error.URLError:
                self._answer(404, "text/plain", b"")

        def _answer(self, code, kind, body):
            self.send_response(code)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format, *args):
            """Logs no request."""

    try:
        server = ThreadingHTTPServer((HOST, meshcat.port() + _PORT_BEYOND), Handler)
    except OSError:
        server = ThreadingHTTPServer((HOST, 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://localhost:{server.server_port}"


def _with(html: str, legend: Legend) -> str:
    """Returns Meshcat's page with the legend's parts at its end."""
    head, end, tail = html.rpartition("</body>")
    return f"{head}{legend.html()}{end}{tail}"
