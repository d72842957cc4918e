"""A real browser shows the gliders of a live Meshcat and of a recording."""

import colorsys
import math

import numpy as np
import pytest
from pydrake.geometry import Meshcat, Rgba
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from diagrams.playback import (
    Track,
    play,
    write_html,
)
from diagrams.scene import (
    AddScene,
    Stage,
    camera_of,
)
from tests.helpers.browser import HEIGHT, WIDTH, find_browser, screenshot

pytestmark = pytest.mark.skipif(
    find_browser() is None, reason="no Chromium on this machine to open a page with"
)

STAGE = Stage()
BLUE, GREEN, RED = 0.6, 0.33, 0.0
"""Hues of the glider's wing, of a ghost and of the wire."""

GHOST = (0.0, 0.6, 0.0, 1.0)


def pixel_of(x, z):
    """Returns the column and row at which the camera sees a place of the plane."""
    camera, target = camera_of(STAGE)
    forward = (target - camera) / np.linalg.norm(target - camera)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, forward)
    ray = np.array([x, 0.0, z]) - camera
    scale = 0.5 * HEIGHT / math.tan(math.radians(10.0)) / (ray @ forward)
    return WIDTH / 2 + scale * (ray @ right), HEIGHT / 2 - scale * (ray @ up)


def count(pixels, hue, place=None, radius=40):
    """Counts the strongly colored pixels of a hue, near a place (x, z) if given."""
    if place is not None:
        column, row = (round(v) for v in pixel_of(*place))
        left, top = max(column - radius, 0), max(row - radius, 0)
        pixels = pixels[top : row + radius, left : column + radius]
    flat = pixels.reshape(-1, 3)
    vivid = flat[flat.max(axis=1) - flat.min(axis=1) > 0.3]
    hues = np.array([colorsys.rgb_to_hsv(*map(float, c))[0] for c in vivid])
    apart = np.abs((hues - hue + 0.5) % 1.0 - 0.5)
    return int(np.sum(apart < 0.06))


def has_wire(pixels):
    """Whether the page has been drawn: the wire is there with or without gliders."""
    return count(pixels, RED, (0.0, 0.0), 60) > 50


def test_a_live_page_shows_the_glider_where_it_is_and_not_what_is_hidden(tmp_path):
    meshcat, builder = Meshcat(), DiagramBuilder()
    here, there = (-1.5, 0.1), (-2.8, 0.3)
    for name, place, color in (("glider", here, None), ("ghost", there, Rgba(*GHOST))):
        state = builder.AddSystem(ConstantVectorSource([*place, -0.4, 0.3]))
        AddScene(builder, state.get_output_port(), meshcat, name=name, color=color)
    Simulator(builder.Build()).AdvanceTo(0.1)
    meshcat.SetProperty("/drake/ghost", "visible", False)
    pixels = screenshot(meshcat.web_url(), tmp_path, has_wire)
    assert has_wire(pixels)
    assert count(pixels, BLUE, here) > 200
    assert count(pixels, BLUE) - count(pixels, BLUE, here, 70) < 20  # Nowhere else.
    assert count(pixels, GREEN) == 0


def test_a_recording_ends_with_the_gliders_at_their_last_places(tmp_path):
    start, end, ghosts_end = (-3.0, 0.2), (-0.8, 0.2), (-1.6, -0.3)
    tracks = [
        Track(
            name=name,
            times=np.array([0.0, 0.3]),
            poses=np.array([[*start, 0.0, 0.0], [*last, -0.4, 0.3]]),
            color=color,
        )
        for name, last, color in (("flown", end, None), ("ghost", ghosts_end, GHOST))
    ]
    meshcat = Meshcat()
    play(tracks, meshcat, stage=STAGE)
    page = tmp_path / "flight.html"
    write_html(page, meshcat, tracks, "A flight")

    def is_complete(pixels):
        return has_wire(pixels) and count(pixels, BLUE, end) > 200

    pixels = screenshot(page.as_uri(), tmp_path, is_complete)
    assert has_wire(pixels)
    assert count(pixels, BLUE, end) > 200
    assert count(pixels, BLUE, start) < 20  # It was there when the recording began.
    assert count(pixels, GREEN, ghosts_end) > 200
    halfway = (0.5 * (start[0] + ghosts_end[0]), 0.5 * (start[1] + ghosts_end[1]))
    assert 10 < count(pixels, GREEN, halfway, 15) < 200  # A trail, no glider.
    assert 'background:rgb(0,153,0)"></span>ghost' in page.read_text()
