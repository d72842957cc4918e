"""A headless browser: pages that it opens, what goes wrong there, what they show."""

import contextlib
import dataclasses
import importlib.util
import io
import shutil
import time
from collections.abc import Callable, Iterator
from typing import Any

import matplotlib.image
import numpy as np

WIDTH, HEIGHT = 1000, 650
"""Size of a window [pixels]."""

PATIENCE = 150.0
"""Time that a busy machine gets to draw [s]."""

_NAMES = ("chromium", "chromium-browser", "google-chrome")

# WebGL without a graphics card; nothing that calls home.
_FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-quic",
    "--disable-sync",
)


def find_browser() -> str | None:
    """Returns a Chromium's path, None if this machine has none."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


def why_not() -> str | None:
    """Returns why no page can be opened here, None if one can."""
    if importlib.util.find_spec("playwright") is None:
        return "no Playwright to drive a browser with (the extra `test` has it)"
    if find_browser() is None:
        return "no Chromium on this machine to open a page with"
    return None


@dataclasses.dataclass(frozen=True)
class Window:
    """A page in a browser."""

    page: Any
    """Playwright's page."""

    faults: list[str]
    """Errors and warnings of the console so far, and exceptions of scripts."""

    requests: list[str]
    """Addresses that it asked for."""

    def pixels(self) -> np.ndarray:
        """Returns what it shows, (height, width, 3) red, green, blue from 0 to 1."""
        picture = io.BytesIO(self.page.screenshot())
        return matplotlib.image.imread(picture, format="png")[:, :, :3]

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Returns left, top, width and height of an element [pixels]."""
        box = self.page.locator(selector).bounding_box()
        return box["x"], box["y"], box["width"], box["height"]

    def wait_for(self, holds: Callable[[], bool]) -> bool:
        """Waits until something holds, at most PATIENCE; returns whether it does."""
        end = time.monotonic() + PATIENCE
        while not (done := holds()) and time.monotonic() < end:
            self.page.wait_for_timeout(100)
        return done


@contextlib.contextmanager
def open_browser() -> Iterator[Any]:
    """Starts Debian's Chromium under Playwright, as its `Browser`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=find_browser(), args=list(_FLAGS)
        )
        yield browser
        browser.close()


@contextlib.contextmanager
def visit(browser: Any, url: str, **options: Any) -> Iterator[Window]:
    """Opens a page in a fresh window of a browser.

    Args:
        browser: of `open_browser`.
        url: of the page.
        options: of Playwright's `new_context`: viewport, color_scheme, has_touch.
    """
    # What turns while work is done would be drawn 60 times a second by the processor.
    context = browser.new_context(**{"reduced_motion": "reduce"} | options)
    context.set_default_timeout(1e3 * PATIENCE)  # Drawing a report is work.
    window = Window(context.new_page(), [], [])
    window.page.on("pageerror", lambda error: window.faults.append(str(error)))
    window.page.on("console", lambda told: _note(window.faults, told))
    window.page.on("request", lambda request: window.requests.append(request.url))
    window.page.goto(url)
    yield window
    context.close()


@contextlib.contextmanager
def opened(url: str, width: int = WIDTH, height: int = HEIGHT) -> Iterator[Window]:
    """Opens a page in a browser of its own."""
    size = {"width": width, "height": height}
    with open_browser() as browser, visit(browser, url, viewport=size) as window:
        yield window


def _note(faults: list[str], told: Any) -> None:
    """Keeps what a browser complains of; not that it has no graphics card."""
    if told.type in ("error", "warning") and "GPU stall" not in told.text:
        faults.append(told.text)
