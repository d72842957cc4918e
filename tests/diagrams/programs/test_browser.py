"""A real browser shows a recording's gliders, legend and clock, and obeys."""

import colorsys
import math

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from diagrams.playback import Track, play
from diagrams.programs.page import page_of
from diagrams.scene import Stage, camera_of
from tests.helpers.browser import opened, why_not

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_not() is not None, reason=str(why_not())),
]

STAGE = Stage()
BLUE, GREEN, RED = 0.6, 0.33, 0.0
"""Hues of the glider's wing, of a ghost and of the wire."""

GHOST = (0.0, 0.6, 0.0, 1.0)
START, END, GHOSTS_END = (-3.0, 0.2), (-0.8, 0.2), (-1.6, -0.3)
DURATION = 0.3


def pixel_of(window, place):
    """Returns the column and row at which the camera sees a place of the plane."""
    left, top, width, height = window.box("#meshcat-pane")
    camera, target = camera_of(STAGE)
    forward = (target - camera) / np.linalg.norm(target - camera)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, forward)
    ray = np.array([place[0], 0.0, place[1]]) - camera
    scale = 0.5 * height / math.tan(math.radians(10.0)) / (ray @ forward)
    return (
        left + 0.5 * width + scale * (ray @ right),
        top + 0.5 * height - scale * (ray @ up),
    )


def count(window, hue, place=None, radius=40, pixel=None):
    """Counts strongly colored pixels of a hue in the scene, near a place if given."""
    left, top, width, height = (round(v) for v in window.box("#meshcat-pane"))
    pixels = window.pixels()
    if place is not None:
        pixel = pixel_of(window, place)
    if pixel is not None:
        column, row = (round(v) for v in pixel)
        low, high = max(row - radius, top), min(row + radius, top + height)
        pixels = pixels[low:high, max(column - radius, 0) : column + radius]
    else:
        pixels = pixels[top : top + height, left : left + width]
    flat = pixels.reshape(-1, 3)
    vivid = flat[flat.max(axis=1) - flat.min(axis=1) > 0.3]
    hues = np.array([colorsys.rgb_to_hsv(*map(float, c))[0] for c in vivid])
    apart = np.abs((hues - hue + 0.5) % 1.0 - 0.5)
    return int(np.sum(apart < 0.06))


def has_wire(window):
    """Whether the page has been drawn: the wire is there with or without gliders."""
    return count(window, RED, (0.0, 0.0), 60) > 50


def text_of(window, selector):
    return " ".join(window.page.inner_text(selector).split())


def time_of(window):
    """Returns the time that the clock shows [s]."""
    return float(text_of(window, "#flight-clock").removesuffix(" s"))


def scrub(window, time):
    """Drags the slider to a time [s]."""
    window.page.locator("#flight-time").fill(f"{time:g}")


def is_over(window):
    animator = "viewer.animator.actions.length > 0 && !viewer.animator.playing"
    return window.page.evaluate(animator) and time_of(window) > DURATION - 0.01


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    """A window with a recording, after it was played once."""
    tracks = [
        Track(
            name=name,
            times=np.array([0.0, DURATION]),
            poses=np.array([[*START, 0.0, 0.0], [*last, -0.4, 0.3]]),
            color=color,
        )
        for name, last, color in (("flown", END, None), ("a ghost", GHOSTS_END, GHOST))
    ]
    meshcat = Meshcat()
    play(tracks, meshcat, rate=0.5, stage=STAGE)
    page = tmp_path_factory.mktemp("page") / "flight.html"
    page.write_text(page_of(meshcat, tracks, "A flight", rate=0.5), encoding="utf-8")
    with opened(page.as_uri()) as window:
        assert window.wait_for(lambda: has_wire(window))
        assert window.wait_for(lambda: is_over(window))
        yield window


def test_a_recording_ends_with_the_gliders_at_their_last_places(window):
    assert window.wait_for(lambda: count(window, BLUE, END) > 200)
    assert count(window, BLUE, START, 15) < 100  # It was there at first: now a trail.
    assert count(window, GREEN, GHOSTS_END) > 200
    assert window.faults == []


def halfway(end):
    return 0.5 * (START[0] + end[0]), 0.5 * (START[1] + end[1])


def test_trails_have_the_colors_of_the_legend(window):
    for end, hue, name in ((END, BLUE, "flown"), (GHOSTS_END, GREEN, "a_ghost")):
        assert 10 < count(window, hue, halfway(end), 15) < 200  # A trail, no glider.
        swatch = window.page.locator(f"[data-name={name}] .swatch")
        color = swatch.evaluate("e => getComputedStyle(e).backgroundColor")
        rgb = [int(v) / 255 for v in color.removeprefix("rgb(")[:-1].split(",")]
        assert colorsys.rgb_to_hsv(*rgb)[0] == pytest.approx(hue, abs=0.03)


def test_the_head_tells_time_speed_and_pitch(window):
    speed = (END[0] - START[0]) / DURATION
    words = text_of(window, "#flight-head")
    assert words.startswith("A flight 0.3")
    assert f"flown {speed:.1f} m/s, nose 23° up" in words


def test_the_slider_is_the_time_of_the_flight(window):
    assert float(window.page.get_attribute("#flight-time", "max")) == pytest.approx(
        DURATION, abs=0.01
    )
    scrub(window, 0.5 * DURATION)
    assert window.wait_for(lambda: time_of(window) == 0.5 * DURATION)
    assert window.wait_for(lambda: count(window, BLUE, halfway(END)) > 200)
    assert count(window, BLUE, END) < 20
    assert "nose 11° up" in text_of(window, "#flight-head")


def test_it_is_played_again_from_where_it_stands_with_its_trail(window):
    scrub(window, 0.2 * DURATION)
    assert window.wait_for(lambda: count(window, BLUE, END) < 20)
    window.page.select_option("#flight-rate", "0.1")
    window.page.click("#flight-play")
    assert window.wait_for(lambda: window.page.inner_text("#flight-play") == "❚❚")
    assert window.wait_for(lambda: is_over(window))
    assert window.wait_for(lambda: count(window, BLUE, END) > 200)
    assert count(window, BLUE, halfway(END), 15) > 10
    assert window.wait_for(lambda: window.page.inner_text("#flight-play") == "▶")


def test_it_is_repeated_as_long_as_it_is_asked_for(window):
    window.page.check("#flight-loop")
    assert window.wait_for(lambda: window.page.evaluate("viewer.animator.playing"))
    window.page.uncheck("#flight-loop")
    assert window.wait_for(lambda: is_over(window))


def test_the_camera_follows_and_comes_back(window):
    left, top, width, height = window.box("#meshcat-pane")
    middle = left + 0.5 * width, top + 0.5 * height
    window.page.select_option("#flight-follow", "flown")
    for time in (0.5 * DURATION, DURATION):
        scrub(window, time)
        assert window.wait_for(lambda: count(window, BLUE, pixel=middle) > 1000)
    window.page.select_option("#flight-follow", "")
    assert window.wait_for(lambda: has_wire(window))
    assert window.wait_for(lambda: count(window, BLUE, END) > 200)


def test_nothing_lies_over_the_scene_unless_it_is_asked_for(window):
    page = window.page
    left, top, width, height = window.box("#meshcat-pane")
    covering = page.evaluate(
        """([left, top, width, height]) => {
            const found = new Set();
            for (let x = left + 5; x < left + width; x += 20)
                for (let y = top + 5; y < top + height; y += 20)
                    found.add(document.elementFromPoint(x, y).tagName);
            return [...found];
        }""",
        [left, top, width, height],
    )
    assert covering == ["CANVAS"]
    assert height > 450
    assert not page.is_visible(".dg.main")
    page.click("#flight-scene")
    assert page.is_visible(".dg.main")
    page.click("#flight-scene")
    assert not page.is_visible(".dg.main")


def test_on_a_phone_the_scene_still_has_room(window):
    whole = window.page.viewport_size
    window.page.set_viewport_size({"width": 360, "height": 640})
    _, _, width, height = window.box("#meshcat-pane")
    assert width == 360
    assert height > 350
    assert window.page.evaluate("document.body.scrollWidth") == 360
    window.page.set_viewport_size(whole)
