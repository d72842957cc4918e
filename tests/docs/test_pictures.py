"""Drawings of the docs are those of their commands, with the signs of the physics."""

import html
import importlib
import re
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from matplotlib.text import Text

from glider.systems.plant import GliderPlant

ROOT = Path(__file__).parents[2]


@pytest.fixture
def extension(monkeypatch):
    """Returns the function that imports a module of the docs."""
    monkeypatch.syspath_prepend(ROOT / "docs" / "extensions")
    return importlib.import_module


def words_of(path):
    """Returns the words in a picture, which its drawing writes as comments."""
    comments = re.findall(
        r"<!-- (.*?) -->", path.read_text(encoding="utf-8"), re.DOTALL
    )
    return sorted(map(html.unescape, comments))


def words_drawn(figure):
    """Returns the words of a figure."""
    lines = [
        line for text in figure.findobj(Text) for line in text.get_text().split("\n")
    ]
    return sorted(filter(None, lines))


def test_every_page_has_a_picture():
    """But for limits and the API, where one looks things up."""
    without = {"limits.md", "index.md"}
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "theory").glob("*.md")]
    shown = re.compile(r"\{figure\}|!\[")
    bare = {p.name for p in pages if not shown.search(p.read_text(encoding="utf-8"))}
    assert bare <= without


def test_the_animated_flights_end_as_they_are_labelled(extension, tmp_path):
    """The correction is what lets the glider perch, in as many frames as committed."""
    animation = extension("perch_animation")
    flown = animation.fly_both()
    assert {key: flight.perched for key, flight in flown.items()} == {
        "nominal": False,
        "corrected": True,
    }
    assert flown["nominal"].miss > 0.05
    with PIL.Image.open(animation.PICTURE) as picture:
        duration = max(flight.times[-1] for flight in flown.values())
        frames = duration / animation.SLOW * animation.FRAMES_PER_SECOND
        assert frames <= picture.n_frames <= frames + 2.0  # The pause is one.


def test_an_effect_is_drawn_larger_where_it_is_small(extension):
    """Both flights have one launch; the difference that is drawn is visible."""
    signatures = extension("signatures")
    kinds = {"wind": None, "stalled_downwash": None, "angle_sign": None}
    for signature in signatures.signatures():
        if signature.effect.kind.kind in kinds:
            kinds[signature.effect.kind.kind] = signature
    for signature in kinds.values():
        without, known = signature.flights
        np.testing.assert_allclose(without.command, known.command, atol=1e-12)
    assert kinds["wind"].magnification == 1
    assert kinds["angle_sign"].magnification == 1
    small = kinds["stalled_downwash"]
    apart = small.flights[1].pose - small.flights[0].pose
    largest = np.hypot(*apart[:, :2].T).max()
    assert largest < signatures.VISIBLE
    assert small.magnification > 1
    assert small.magnification * largest <= signatures.VISIBLE


@pytest.mark.parametrize("name", ["glider_drawing", "way_of_a_log"])
def test_a_picture_is_drawn_as_its_command_draws_it(extension, name):
    drawing = extension(name)
    command = f"python docs/extensions/{name}.py"
    assert words_of(drawing.PICTURE) == words_drawn(drawing.draw()), command


def test_each_box_of_the_way_of_a_log_has_a_word_in_the_glossary(extension):
    """And is made by a function that the glossary names, or by one beside it."""
    drawing = extension("way_of_a_log")
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    _, way = page.split("\n## The way of a log")
    for box, (_, _, made_by) in drawing.LAYOUT.boxes.items():
        assert box.removesuffix("s") in way.lower()
        assert re.search(rf"\.{re.escape(made_by)}", way), made_by


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["drake_diagram", "closed_loop", "estimated_loop", "autopilot"]
)
def test_a_block_diagram_is_that_of_its_systems(extension, name):
    drawing = extension("block_diagram")
    figure = drawing.draw(drawing.DIAGRAMS[name](), drawing.LAYOUTS[name])
    command = "python docs/extensions/block_diagram.py"
    assert words_of(drawing.picture_of(name)) == words_drawn(figure), command


@pytest.mark.slow
def test_a_layout_of_another_diagram_is_refused(extension):
    drawing = extension("block_diagram")
    with pytest.raises(LookupError, match="believed_servo"):
        drawing.draw(drawing.filtered_loop(), drawing.LAYOUTS["closed_loop"])


def test_forces_and_angles_have_the_drawn_signs(extension):
    """Both forces point along the normals, and the angles are those in words."""
    drawing = extension("glider_drawing")
    plant = GliderPlant()
    context = plant.CreateDefaultContext()
    speed = 7.0 * drawing.forward(drawing.DESCENT)
    state = [0.0, 0.0, drawing.PITCH, drawing.ELEVATOR, *speed, 0.0]
    context.SetContinuousState(state)
    plant.GetInputPort("elevator_rate").FixValue(context, [0.0])
    forces = plant.GetOutputPort("forces").Eval(context)
    assert forces[0] > 0.0
    assert forces[1] > 0.0
    along = forces[0] * drawing.normal(drawing.PITCH)
    along += forces[1] * drawing.normal(drawing.PITCH + drawing.ELEVATOR)
    np.testing.assert_allclose(forces[2:4], along, rtol=1e-9)
    words = " ".join(rule for _, rule, _ in drawing.NOTES)
    attack = np.arctan2(-speed[1], speed[0]) - drawing.PITCH
    for angle in (-drawing.PITCH, drawing.ELEVATOR, attack):
        assert f"{np.degrees(angle):.0f}°" in words
