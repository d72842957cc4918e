"""Flights side by side in Meshcat: the recording holds all that moves."""

import base64
import re

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from diagrams.overlays import ARROW_SCALE, arrow_paths, trail_path
from diagrams.playback import RED, Track, play, stage_of, track_of
from diagrams.programs.page import page_of
from glider.errors import InputError
from glider.physics.parameters import GliderParameters
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import hooked
from tests.helpers.meshcat import place_of, property_of


def make_track(name="flown", **changes):
    times = np.linspace(0.0, 0.5, 40)
    poses = np.column_stack(
        [7.0 * times - 3.5, 0.1 - times**2, -times, 0.5 * np.sin(9.0 * times)]
    )
    return Track(**{"name": name, "times": times, "poses": poses, **changes})


@pytest.fixture(scope="module")
def tracks():
    forces = np.column_stack([np.linspace(0.5, 2.0, 40), np.linspace(0.0, -1.0, 40)])
    return make_track("flown", forces=forces), make_track("as planned", color=RED)


@pytest.fixture(scope="module")
def meshcat(tracks):
    meshcat = Meshcat()
    play(tracks, meshcat, rate=0.5)
    return meshcat


@pytest.fixture(scope="module")
def page(tracks, meshcat):
    return page_of(meshcat, tracks, "Flown & planned", rate=0.5)


@pytest.fixture(scope="module")
def animation(page):
    """The message of the page that holds the recording."""
    messages = map(base64.b64decode, re.findall(r'octet-binary;base64,([^"]+)"', page))
    (animation,) = [m for m in messages if b"set_animation" in m]
    return animation


@pytest.mark.parametrize("glider", ["flown", "as_planned"])
@pytest.mark.parametrize("part", ["body", "elevator"])
def test_every_part_of_every_glider_moves_in_the_recording(animation, glider, part):
    assert f"/drake/{glider}/glider/{part}".encode() in animation


def test_the_arrows_lengths_are_in_the_recording(animation):
    for path in arrow_paths("flown"):
        _, _, after = animation.partition(path.encode())
        assert b".scale" in after[:80]
    assert arrow_paths("as_planned")[0].encode() not in animation


def test_pieces_of_the_trails_appear_in_the_recording(meshcat, animation):
    for glider in ("flown", "as_planned"):
        paths = [f"{trail_path(glider)}/{i}" for i in range(200)]
        pieces = [path for path in paths if meshcat.HasPath(path)]
        assert len(pieces) > 30
        for path in pieces:
            own = re.escape(path.encode()) + rb"(?!\d)(.{300})"
            track = re.search(own, animation, re.DOTALL).group(1)
            hidden, shown = track.find(b"value\xc2"), track.find(b"value\xc3")
            assert 0 < hidden < shown


def test_the_trail_follows_the_flight(tracks, meshcat):
    trail = [place_of(meshcat, f"{trail_path('flown')}/{i}") for i in range(30)]
    x, z = tracks[0].poses[:, :2].T
    assert np.allclose([p[2] for p in trail], np.interp([p[0] for p in trail], x, z),
                       atol=2e-3)  # fmt: skip
    assert np.all(np.diff([p[0] for p in trail]) > 0.0)


def test_an_arrow_is_as_long_as_its_force(tracks, meshcat):
    meshcat = Meshcat()
    play(tracks, meshcat, rate=2.0)
    wing, elevator = (property_of(meshcat, p, "scale") for p in arrow_paths("flown"))
    assert wing[2] == pytest.approx(2.0 * ARROW_SCALE)
    assert elevator[2] == pytest.approx(-1.0 * ARROW_SCALE)


def test_an_arrow_is_where_its_force_acts(tracks):
    """From the body's frame and from the hinge; ahead is positive."""
    parameters = GliderParameters(wing_offset=0.03, elevator_offset=0.05)
    meshcat = Meshcat()
    play(tracks, meshcat, parameters=parameters)
    wing, elevator = (place_of(meshcat, p) for p in arrow_paths("flown"))
    assert wing == pytest.approx([0.03, 0.0, 0.0])
    assert elevator == pytest.approx([-0.05, 0.0, 0.0])


def test_the_gliders_stay_where_they_end(tracks):
    meshcat = Meshcat()
    short = make_track("short", times=np.linspace(0.0, 0.31, 40))
    play([*tracks, short], meshcat, rate=1.7)  # No whole frames.
    for name in ("flown", "short"):
        end = place_of(meshcat, f"/drake/{name}/glider/body")
        assert end == pytest.approx([0.0, 0.0, -0.15])


def test_a_track_of_one_moment_stands_still(tracks):
    still = Track(name="still", times=np.zeros(1), poses=np.array([[-2.0, 0.5, 0, 0]]))
    meshcat = Meshcat()
    play([*tracks, still], meshcat, rate=5.0)
    body = place_of(meshcat, "/drake/still/glider/body")
    assert body == pytest.approx([-2.0, 0.0, 0.5])


def test_the_page_has_a_legend(page):
    assert "<b>Flown &amp; planned</b>" in page
    assert '<span class="swatch" style="background:rgb(217,41,31)">' in page
    assert "<span>as planned</span>" in page
    assert f"{ARROW_SCALE:g} m per N" in page


def test_times_may_start_anywhere(tracks):
    later = make_track("later", times=np.linspace(100.0, 100.5, 40))
    meshcat = Meshcat()
    play([later], meshcat, rate=0.5)
    x, z = later.poses[-1, :2]
    body = place_of(meshcat, "/drake/later/glider/body")
    assert body == pytest.approx([x, 0.0, z])
    time, speed, _ = place_of(meshcat, "/readout/later")
    assert time == pytest.approx(0.5)
    assert speed == pytest.approx(np.hypot(7.0, 1.0), abs=0.02)


def test_the_stage_holds_the_flight_and_the_wire():
    stage = stage_of(make_track(), wire=(2.0, 1.0))
    assert stage.x_limits[0] < -3.5 and stage.x_limits[1] > 2.0
    assert stage.z_limits[0] < -0.15 and stage.z_limits[1] > 1.0
    assert stage_of(make_track(), wire=None).x_limits[1] < 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"times": np.zeros(40)}, "must increase"),
        ({"poses": np.zeros((40, 3))}, r"shape of 'poses' is \[40, 3\]"),
        ({"poses": np.full((40, 4), np.nan)}, "finite"),
        ({"forces": np.zeros((39, 2))}, "'forces'"),
        ({"name": "a/b"}, "letters"),
    ],
)
def test_what_is_no_flight_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        make_track(**changes)


@pytest.mark.parametrize(
    ("tracks", "rate", "words"),
    [
        ([], 1.0, "one or more"),
        ([make_track(), make_track()], 1.0, "all different"),
        ([make_track()], 0.0, "positive"),
    ],
)
def test_what_cannot_be_played_is_refused(tracks, rate, words):
    with pytest.raises(InputError, match=words):
        play(tracks, Meshcat(), rate=rate)


def test_steps_that_are_a_rounding_error_apart_are_shown_as_one():
    """As a simulator logs them at an event; a spline cannot have both."""
    times = np.array([0.0, 0.1, np.nextafter(0.1, 1.0), 0.2])
    states = np.zeros((4, 7))
    flight = hooked(times, states, PerchingProblem(wire=[1.0, 0.0]))
    track = track_of("flown", flight)
    assert len(track.times) == 3
    play([track], Meshcat())
