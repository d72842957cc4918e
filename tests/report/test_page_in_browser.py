"""The report in a real browser: it draws, without a word of complaint, and obeys."""

import contextlib

import pytest

from glider.report.folder import to_html
from tests.helpers.browser import open_browser, visit, why_not
from tests.report.results import VARIANTS, make_flight, make_result

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_not() is not None, reason=str(why_not())),
]

PHONE = {"viewport": {"width": 390, "height": 800}, "has_touch": True}
PLOTS = "[data-figure] .plot"


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(to_html(make_result()), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def desk(browser, report):
    """The report on a wide screen, shared by tests that leave it as it was."""
    with visit(
        browser, report.as_uri(), viewport={"width": 1100, "height": 900}
    ) as seen:
        yield seen
        assert seen.faults == []
        assert seen.requests == [report.as_uri()]


@pytest.fixture(scope="module")
def phone(browser, report):
    """The report on a phone: drawing it takes longer than looking at it."""
    with visit(browser, report.as_uri(), **PHONE) as seen:
        yield seen
        assert seen.faults == []


def traces(page, figure, expression):
    """Returns what an expression of a trace `t` and its plot `p` is, for each."""
    return page.evaluate(
        f"""[...document.querySelectorAll("#{figure} .plot")].flatMap(
            (p) => p.data.map((t) => {expression}))"""
    )


@pytest.mark.parametrize("name", ["unexplained", "diverged"])
def test_every_chart_is_drawn_and_nothing_is_complained_of(browser, tmp_path, name):
    path = tmp_path / "report.html"
    path.write_text(to_html(VARIANTS[name]), encoding="utf-8")
    with visit(browser, path.as_uri()) as seen:
        plots = seen.page.locator(PLOTS)
        assert plots.count() > 3
        assert seen.page.locator(f"{PLOTS} .main-svg").count() >= plots.count()
        # What plotly.js does not know it would leave out in silence; an attribute
        # that a panel has no use for is none of that.
        faults = seen.page.evaluate(
            f"""[...document.querySelectorAll("{PLOTS}")].flatMap(
                (p) => Plotly.validate(p.data, p.layout) || []).filter(
                (f) => ["schema", "value", "object", "array"].includes(f.code)).map(
                (f) => f.msg)"""
        )
        assert faults == []
        assert seen.faults == []
        assert seen.requests == [path.as_uri()]


def test_names_of_files_are_no_html(browser, tmp_path):
    """A campaign may be somebody else's, and a page is sent to others."""
    evil = "flight_<img src=x onerror=window.broken=1>.csv"
    path = tmp_path / "report.html"
    flights = (make_flight(evil, 0.1), *make_result().held_out[:2])
    result = make_result(held_out=flights)
    path.write_text(to_html(result), encoding="utf-8")
    with visit(browser, path.as_uri()) as seen:
        titles = seen.page.locator("#held_out .panel h4").all_inner_texts()
        assert evil.removesuffix(".csv") in titles
        assert seen.page.evaluate("window.broken") is None
        assert seen.requests == [path.as_uri()]


def test_symbols_have_subscripts(desk):
    title = desk.page.locator("#coefficients .panel h4").first
    assert title.inner_html().startswith("C<sub>L</sub>, ")


def test_the_legend_shows_and_hides_a_model_in_all_panels(desk):
    buttons = desk.page.locator("#held_out .legend button")
    labels = [b.strip() for b in buttons.all_inner_texts()]
    assert labels == [
        *("measured", "nominal", "refitted", "corrected"),
        "launch state fitted",
    ]
    assert all(traces(desk.page, "held_out", "t.visible"))
    buttons.nth(2).click()
    hidden = traces(desk.page, "held_out", "[t.visible, t.line && t.line.color]")
    assert {c for is_shown, c in hidden if not is_shown} == {"#E08A00"}
    assert sum(not is_shown for is_shown, _ in hidden) == 4 * 3
    buttons.nth(2).click()
    assert all(traces(desk.page, "held_out", "t.visible"))


def test_flights_are_chosen_by_name(desk):
    page = desk.page
    picks = page.locator("#held_out .picks button")
    assert picks.count() == 6
    panels = page.locator("#held_out .panel")
    assert panels.count() == 4 * 3
    titles = page.locator("#held_out .panel h4")
    page.get_by_role("button", name="worst three").click()
    shown = [titles.nth(i).inner_text() for i in range(0, 9, 3)]
    assert shown == ["flight_105", "flight_104", "flight_103"]
    picks.nth(0).click()
    assert panels.count() == 2 * 3
    assert titles.first.inner_text() == "flight_104"
    page.get_by_role("button", name="initial choice").click()
    assert panels.count() == 4 * 3


def test_pitch_and_distance_of_a_flight_are_zoomed_together(desk):
    ranges = """[...document.querySelectorAll("#held_out .plot")].map(
        (p) => p.layout.xaxis.range)"""
    before = desk.page.evaluate(ranges)
    desk.page.evaluate(
        """Plotly.relayout(document.querySelectorAll("#held_out .plot")[1],
            {"xaxis.range[0]": 0.2, "xaxis.range[1]": 0.4})"""
    )
    desk.page.wait_for_function(f"{ranges}[2][0] === 0.2")
    after = desk.page.evaluate(ranges)
    assert after[1] == after[2] == [0.2, 0.4]
    assert after[0] == before[0]  # A path is over x.
    assert after[3:] == before[3:]  # Of other flights.


def test_pointing_at_a_curve_tells_flight_and_time(desk):
    plot = desk.page.locator("#held_out .plot").nth(1)
    plot.scroll_into_view_if_needed()
    box = plot.locator(".nsewdrag").bounding_box()
    desk.page.evaluate(
        """Plotly.Fx.hover(document.querySelectorAll("#held_out .plot")[1],
            [{curveNumber: 0, pointNumber: 20}])"""
    )
    told = plot.locator(".hoverlayer").text_content()
    assert "flight_105" in told
    assert "measured" in told
    assert "0.327 s" in told
    assert box["width"] > 100


def test_a_flight_is_picked_out_of_the_residual(desk):
    select = desk.page.locator("#residual select")
    count = "t.mode === 'markers' ? t.x.length : 0"
    whole = traces(desk.page, "residual", count)
    select.select_option(label="flight_102.csv")
    told = traces(desk.page, "residual", "t.mode === 'markers' ? t.text : []")
    names = {text.split(",")[0] for texts in told for text in texts}
    assert names == {"flight_102.csv"}
    assert sum(traces(desk.page, "residual", count)) * 6 == sum(whole)
    select.select_option(label="all")
    assert traces(desk.page, "residual", count) == whole


def test_a_phone_shows_one_panel_a_row_and_scrolls_down_only(phone):
    width = phone.page.evaluate("document.documentElement.scrollWidth")
    assert width <= 390
    boxes = [p.bounding_box() for p in phone.page.locator("#coefficients .panel").all()]
    assert len({box["x"] for box in boxes}) == 1
    assert all(box["width"] > 300 for box in boxes)
    modes = phone.page.evaluate(
        f"[...document.querySelectorAll('{PLOTS}')].map((p) => p.layout.dragmode)"
    )
    assert set(modes) == {False}  # A finger on a figure scrolls the page.
    assert phone.page.locator("#coefficients .modebar-btn").count() > 0


def test_a_phone_shows_every_column_of_a_table(phone):
    """In narrow letters and in wide ones: a reader's system has one or the other."""
    page = phone.page
    words = "'c normal peak at alpha = 0.000380 ± 0.000012 rad (0.0218°)'"
    page.evaluate(f"document.querySelector('.effects .value').textContent = {words}")
    for font in ("Liberation Sans", "DejaVu Sans"):
        page.add_style_tag(content=f"body {{ font-family: '{font}', sans-serif }}")
        wide = page.evaluate(
            """[...document.querySelectorAll(".scroll")].map(
                (e) => e.scrollWidth - e.clientWidth)"""
        )
        assert max(wide) <= 1
        check_columns_of_errors(page)
    heading = page.locator("h2").first.bounding_box()
    first = page.locator(".effects strong").first.bounding_box()
    assert first["y"] - heading["y"] - heading["height"] < 40.0


def check_columns_of_errors(page):
    """Every heading is in sight, and numbers end where their heading does."""
    table = page.locator(".errors")
    for heading in ("nominal", "refitted", "corrected", "floor", "gain"):
        head = table.locator("th", has_text=heading).bounding_box()
        assert 0.0 <= head["x"] < head["x"] + head["width"] <= 390.0
    row = table.locator("tr", has_text="position, end").locator("td.number").all()
    heads = table.locator("thead th.number").all()
    ends = [[c.bounding_box() for c in cells] for cells in (row, heads)]
    right = [[b["x"] + b["width"] for b in boxes] for boxes in ends]
    assert right[0] == pytest.approx(right[1], abs=2.0)


@contextlib.contextmanager
def in_the_dark(page, look):
    """The page for a reader whose system is dark; yields how it looked in the light."""
    light = page.evaluate(look)
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"{look}[2] !== {light[2]!r}")
    yield light
    page.emulate_media(color_scheme="light")
    page.wait_for_function(f"{look}[2] === {light[2]!r}")


def test_colors_follow_the_readers_system(desk):
    look = """[getComputedStyle(document.body).backgroundColor,
        document.querySelector("#coefficients .plot").data.at(-1).line.color,
        document.querySelector("#coefficients .plot").layout.font.color]"""
    with in_the_dark(desk.page, look) as light:
        dark = desk.page.evaluate(look)
        assert all(a != b for a, b in zip(light, dark, strict=True))
        assert light[0] == "rgb(255, 255, 255)"
        assert sum(map(int, dark[0][4:-1].split(","))) < 120
    assert desk.page.evaluate(look) == light
    assert desk.faults == []


def test_on_paper_it_is_light_and_as_wide_as_the_sheet(desk):
    look = """[getComputedStyle(document.body).backgroundColor,
        Math.max(...[...document.querySelectorAll(".plot .main-svg")].map(
            (svg) => svg.getBoundingClientRect().right
                - document.querySelector("main").getBoundingClientRect().left)),
        document.querySelector("#coefficients .plot").layout.font.color]"""
    page = desk.page
    with in_the_dark(page, look):
        before = page.evaluate(look)
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        page.wait_for_function(f"{look}[1] < 700")
        ground, _, ink = page.evaluate(look)
        spare = page.evaluate(
            f"""[...document.querySelectorAll("{PLOTS}")].map((p) => p.clientWidth
                - p.querySelector(".main-svg").getBoundingClientRect().width)"""
        )
        assert min(spare) >= -1.0  # No panel covers its neighbour.
        assert ground == "rgb(255, 255, 255)"
        assert ink == "#1b1f24"
        page.evaluate("window.dispatchEvent(new Event('afterprint'))")
        assert page.evaluate(look)[0] == before[0]
        assert len(page.pdf()) > 20_000
    assert desk.faults == []
