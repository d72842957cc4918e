"""The page of a session in a real browser, while throws come."""

import contextlib
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from diagrams.programs.station.bus import OPERATOR, STATUS, Bus, free_address
from glider.campaign.samples import campaign_folder
from tests.helpers.browser import PATIENCE, open_browser, visit, why_not

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_not() is not None, reason=str(why_not())),
]

TABLET = {"viewport": {"width": 768, "height": 1024}, "has_touch": True}

TAKES = Path(__file__).parents[5] / "shared" / "measured" / "raw_motive"

SOON = 2.0
"""Time within which a new throw is to be on screen [s]."""


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@contextlib.contextmanager
def served(folder, *options):
    """Runs `glider lab`; yields the address of its page."""
    command = [sys.executable, "-m", "glider", "lab", str(folder), *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as process:
        try:
            yield re.search(r"http://\S+", process.stdout.readline())[0]
        finally:
            process.send_signal(signal.SIGINT)
            _, complaint = process.communicate()
    assert process.returncode == 0
    assert "Traceback" not in complaint


def drop(folder, number):
    name = f"flight_{number:03d}.csv"
    shutil.copy(campaign_folder("head_wind") / name, folder)
    return name


def has_shown(window, name):
    """Whether the figure of a throw is drawn, and its row is in the table."""
    page = window.page
    return (
        page.locator(f'#throw[data-shown="{name}"] .main-svg').count() > 0
        and page.locator(f'#rows tr[data-name="{name}"]').is_visible()
    )


def rows(window):
    names = "(nodes) => nodes.map((node) => node.dataset.name)"
    return window.page.eval_on_selector_all("#rows tr", names)


def text(window, selector):
    return " ".join(window.page.inner_text(selector).split())


def test_throws_come_while_the_page_is_open(browser, folder):
    with served(folder) as url, visit(browser, url, **TABLET) as seen:
        assert seen.wait_for(lambda: text(seen, "#connection") == "live")
        assert text(seen, "#headline") == "No throw yet"
        first = drop(folder, 0)
        assert seen.wait_for(lambda: has_shown(seen, first))
        times = []
        for number in (1, 2, 3):  # A busy machine delays one or the other.
            began = time.monotonic()
            last = drop(folder, number)
            assert seen.wait_for(lambda name=last: has_shown(seen, name))
            times.append(time.monotonic() - began)
        assert min(times) < SOON
        assert len(rows(seen)) == 4
        assert rows(seen)[0] == last
        assert "nominal model" in text(seen, "#throw-words")
        width = "document.scrollingElement.scrollWidth"
        assert seen.page.evaluate(width) <= TABLET["viewport"]["width"]
        seen.page.click(f'tr[data-name="{first}"] button')
        assert seen.wait_for(lambda: has_shown(seen, first))
        seen.page.reload()
        assert seen.wait_for(lambda: has_shown(seen, last))
        assert len(rows(seen)) == 4
        assert seen.faults == []
        assert all(address.startswith(url.split("?")[0]) for address in seen.requests)


def test_the_page_shows_the_station_and_stops_it(browser, folder, tmp_path):
    address, heard = free_address(), []
    scenario = tmp_path / "lab.yaml"
    scenario.write_text(f"bus: {address}\n")
    bus = Bus(address)
    bus.listen(OPERATOR, lambda when, values, names: heard.append(names[0]))

    def shows(state, reason, words):
        bus.say(STATUS, time.monotonic(), (0.0, 0.0), (state, reason))
        return words in text(seen, "#station")

    def hears(word):
        bus.handle(0.05)  # Messages may have come together before.
        return heard[-1:] == [word]

    with (
        served(folder, "--scenario", str(scenario)) as url,
        visit(browser, url, **TABLET) as seen,
    ):
        assert seen.wait_for(lambda: "No station" in text(seen, "#station"))
        assert "token" not in seen.page.url
        why = "no usable pose yet"
        assert seen.wait_for(lambda: shows("waiting", why, "No usable pose yet"))
        assert seen.wait_for(lambda: shows("ready", "", "READY Throw now"))
        seen.page.click("#stop")
        assert seen.wait_for(lambda: hears("kill"))
        assert seen.wait_for(lambda: "STOPPED" in text(seen, "#station"))
        seen.page.click("#arm")
        assert seen.wait_for(lambda: hears("arm"))
        assert seen.wait_for(lambda: shows("flying", "", "Flying"))
        assert seen.faults == []


@pytest.mark.nightly  # It traces four times, two minutes.
def test_a_page_goes_on_after_a_restart(browser, folder):
    with contextlib.ExitStack() as stack:
        with served(folder) as url:
            seen = stack.enter_context(visit(browser, url, **TABLET))
            for number in range(3):
                name = drop(folder, number)
            assert seen.wait_for(lambda: has_shown(seen, name))
            assert seen.wait_for(lambda: "wind" in text(seen, "#headline"))
        assert seen.wait_for(lambda: "has ended" in text(seen, "#connection"))
        with served(folder) as again:
            assert again == url
            assert seen.wait_for(lambda: text(seen, "#connection") == "live")
            name = drop(folder, 3)
            assert seen.wait_for(lambda: has_shown(seen, name))
            assert "corrected model" in text(seen, "#throw-words")
            # A new page knows all of it, too.
            with visit(browser, again, **TABLET) as other:
                assert other.wait_for(lambda: has_shown(other, name))
                assert len(rows(other)) == 4
                panels = other.page.locator('[data-figure="effects"] .main-svg')
                assert panels.count() > 0
                assert "wind" in text(other, "#headline")


def test_a_throw_is_replayed_in_meshcat(browser, folder):
    with served(folder) as url, visit(browser, url) as seen:
        name = drop(folder, 0)
        assert seen.wait_for(lambda: has_shown(seen, name))
        assert seen.page.locator("iframe").get_attribute("src") is None
        seen.page.click("#replay summary")
        frame = seen.page.frame_locator("#replay iframe")
        assert seen.wait_for(lambda: frame.locator("#meshcat-pane canvas").count() > 0)
        assert "nominal" in frame.locator("body").inner_text()
        assert seen.faults == []


def test_a_throw_is_drawn_though_a_view_overtakes_its_data(browser, folder):
    view = "() => { showThrow({ ...picked }); }"  # Another object for the same throw.
    held = []

    def hold(route):
        held.append(route)

    with served(folder) as url, visit(browser, url) as seen:
        seen.page.route("**/throws/*.json*", hold)
        first = drop(folder, 0)
        assert seen.wait_for(lambda: held)
        seen.page.evaluate(view)
        held.pop().continue_()
        assert seen.wait_for(lambda: has_shown(seen, first))
        second = drop(folder, 1)
        assert seen.wait_for(lambda: held)
        held.pop().abort()  # What could not be fetched is asked for again.
        assert seen.wait_for(lambda: seen.page.evaluate(view) or held)
        held.pop().continue_()
        assert seen.wait_for(lambda: has_shown(seen, second))


def test_hostile_names_of_files_are_text(browser, folder):
    name = "flight_<img src=x onerror=alert(1)>.csv"
    source = campaign_folder("head_wind") / "flight_000.csv"
    (folder / name).write_bytes(source.read_bytes())
    with served(folder) as url, visit(browser, url) as seen:
        row = seen.page.locator("#rows tr")
        assert seen.wait_for(lambda: row.count() == 1)
        assert "<img src=x" in row.inner_text()
        assert seen.page.locator("#rows img").count() == 0
        assert seen.faults == []


@pytest.mark.skipif(not TAKES.is_dir(), reason="no measured takes are here")
def test_takes_are_dropped_and_their_map_corrected(browser, tmp_path):
    with served(tmp_path) as url, visit(browser, url, **TABLET) as seen:
        page = seen.page
        page.set_input_files("#files", sorted(TAKES.glob("*.csv")))
        page.wait_for_selector("#draft-words:visible", timeout=1e3 * PATIENCE)
        assert seen.wait_for(lambda: "2 flights" in text(seen, "#draft-words"))
        right = page.input_value("#map")
        page.select_option('[data-key="up"]', "z")
        assert seen.wait_for(lambda: "\n  up: z\n" in page.input_value("#map"))
        assert page.locator("#save").is_disabled()
        assert seen.wait_for(lambda: "cannot be read" in text(seen, "#draft-words"))
        assert page.locator("#save").is_disabled()
        page.select_option('[data-key="up"]', "y")
        assert seen.wait_for(lambda: page.input_value("#map") == right)
        assert seen.wait_for(lambda: page.locator("#save").is_enabled())
        drawn = "(image) => image.complete && image.naturalWidth > 0"
        assert seen.wait_for(lambda: page.locator("#map-picture").evaluate(drawn))
        page.click("#save")
        assert seen.wait_for(lambda: page.locator("#rows tr").count() == 2)
        assert (tmp_path / "MAP.yaml").read_text() == right
        assert seen.faults == []
