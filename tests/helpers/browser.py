"""A headless browser: a page as an array of pixels, or to be worked with."""

import contextlib
import dataclasses
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np

WIDTH, HEIGHT = 1000, 650
"""Of a screenshot [pixels]."""

_NAMES = ("chromium", "chromium-browser", "google-chrome")

# WebGL without a graphics card; nothing that calls home.
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-quic",
    "--disable-sync",
)


def find_browser() -> str | None:
    """Returns a Chromium's path, None if this machine has none."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


def screenshot(
    url: str, folder: Path, is_complete: Callable[[np.ndarray], bool]
) -> np.ndarray:
    """Returns what a page shows, (HEIGHT, WIDTH, 3) red, green, blue from 0 to 1.

    On a busy machine the picture may be taken before all has been drawn; then it
    is taken again, later.
    """
    browser = find_browser()
    assert browser is not None
    for attempt in range(4):
        picture = folder / f"screenshot_{attempt}.png"
        command = [
            browser,
            *_FLAGS,
            f"--user-data-dir={folder / f'profile_{attempt}'}",
            f"--window-size={WIDTH},{HEIGHT}",
            f"--virtual-time-budget={4000 * 2**attempt}",
            f"--screenshot={picture}",
            url,
        ]
        subprocess.run(command, check=False, capture_output=True, timeout=120)
        if picture.exists():
            pixels = matplotlib.image.imread(picture)[:, :, :3]
            if is_complete(pixels):
                break
    assert picture.exists(), f"{browser} took no picture of {url}"
    return pixels


@dataclasses.dataclass(frozen=True, kw_only=True)
class Visit:
    """A page of Playwright's that is open, and what it said and asked for."""

    page: Any
    complaints: list[str]
    requests: list[str]


@contextlib.contextmanager
def open_browser() -> Iterator[Any]:
    """Starts Debian's Chromium under Playwright, as its `Browser`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=find_browser(), args=["--no-sandbox"]
        )
        yield browser
        browser.close()


@contextlib.contextmanager
def visit(browser: Any, path: Path, **options: Any) -> Iterator[Visit]:
    """Opens a file in a fresh tab.

    Args:
        browser: of `open_browser`.
        path: of the page.
        options: of Playwright's `new_context`: viewport, color_scheme, has_touch.
    """
    context = browser.new_context(**options)
    page = context.new_page()
    seen = Visit(page=page, complaints=[], requests=[])
    page.on("console", lambda message: seen.complaints.append(message.text))
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    page.on("request", lambda request: seen.requests.append(request.url))
    page.goto(path.as_uri())
    yield seen
    context.close()
