"""The docs as `make docs` built them: notebooks ran, and links lead somewhere."""

import json
import os
import re
import urllib.parse
from html.parser import HTMLParser
from pathlib import Path

import pytest

from glider.physics.effects import LIBRARY
from tests.helpers.browser import open_browser, visit, why_not

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted(path.stem for path in (ROOT / "docs" / "tutorials").glob("*.py"))

pytestmark = pytest.mark.docs


@pytest.fixture(scope="module")
def site():
    """The folder that Sphinx built, as make names it."""
    if "SITE" not in os.environ:
        pytest.skip("make docs builds the site")
    return Path(os.environ["SITE"]).resolve()


class _Page(HTMLParser):
    """Links of a page, and the anchors that links may lead to."""

    def __init__(self, text: str):
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = {""}
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.anchors |= {named[n] for n in ("id", "name") if named.get(n)}
        target = named.get("href" if tag in ("a", "link") else "src")
        if target:
            self.links.add(target)


def test_links_lead_somewhere(site):
    pages = {
        path.resolve(): _Page(path.read_text(encoding="utf-8"))
        for path in site.rglob("*.html")
    }
    assert len(pages) > 20
    broken = []
    for path, page in pages.items():
        for link in page.links:
            target = urllib.parse.urlsplit(link)
            if target.scheme or target.netloc:
                continue
            there = path
            if target.path:
                there = (path.parent / urllib.parse.unquote(target.path)).resolve()
            anchor = urllib.parse.unquote(target.fragment)
            if not there.exists() or (
                there in pages and anchor not in pages[there].anchors
            ):
                broken.append(f"{path.name}: {link}")
    assert broken == []


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_has_run(site, name):
    """All cells, in order; what they assert held, and they wrote no warning."""
    [path] = site.rglob(f"{name}.ipynb")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [c["execution_count"] for c in code] == [*range(1, len(code) + 1)]
    outputs = [output for cell in code for output in cell["outputs"]]
    assert len(outputs) > 5
    assert [o for o in outputs if o["output_type"] == "error"] == []
    assert [o for o in outputs if o.get("name") == "stderr"] == []


def test_the_catalogue_has_every_effect(site):
    index = (site / "effects" / "index.html").read_text(encoding="utf-8")
    for kind in LIBRARY:
        page = (site / "effects" / f"{kind.stage}.html").read_text(encoding="utf-8")
        assert f'id="effect-{kind.kind.replace("_", "-")}"' in page, kind.kind
        assert f"{kind.kind}.png" in page
        assert (site / "_images" / f"{kind.kind}.png").stat().st_size > 10_000
        assert kind.words.replace("'", "’") in index


def test_the_systems_have_plain_names_and_tables_of_ports(site):
    page = (site / "api" / "systems.html").read_text(encoding="utf-8")
    assert "𝓣" not in page
    for name in ("GliderPlant", "ElevatorServo", "ExtendedKalmanFilter"):
        [_, entry] = re.split(rf'<dt [^>]*id="[\w.]*\.{name}"', page)
        tables = re.findall(r"<table .*?</table>", entry.split("</dd></dl>")[0], re.S)
        words = " ".join(tables)
        assert "Input ports" in words
        assert "Output ports" in words
        assert "elevator_rate" in words


@pytest.mark.skipif(why_not() is not None, reason=str(why_not()))
def test_the_front_page_in_a_browser(site):
    """Nothing is complained of, asked for elsewhere or too wide for a phone."""
    pytest.importorskip("playwright.sync_api", reason="no Playwright")
    url = (site / "index.html").as_uri()
    with open_browser() as browser:
        for width in (1200, 390):
            size = {"width": width, "height": 900}
            with visit(browser, url, viewport=size) as seen:
                figure = seen.page.locator("figure img").first
                assert figure.evaluate("i => i.complete && i.naturalWidth > 1000")
                assert seen.page.evaluate(
                    "document.documentElement.scrollWidth <= window.innerWidth"
                )
                assert seen.faults == []
                assert [r for r in seen.requests if not r.startswith("file:")] == []
        with visit(browser, url, viewport={"width": 1200, "height": 900}) as seen:
            seen.page.get_by_role("link", name="Getting started").first.click()
            assert seen.page.title().startswith("Getting started")
            assert seen.faults == []
