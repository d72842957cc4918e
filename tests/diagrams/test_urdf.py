"""What the glider looks like agrees with its parameters."""

import collections
import xml.etree.ElementTree

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from diagrams.scene import ParseGlider
from diagrams.urdf import make_urdf
from glider.paths import models_path
from glider.physics.parameters import GliderParameters, load_parameters
from tests.helpers.meshes import make_meshes, to_obj, write_files

MESHES = make_meshes()


@pytest.mark.parametrize("name", MESHES)
def test_meshes_are_closed_and_face_outward(name):
    mesh = MESHES[name]
    edges = collections.Counter(
        (int(face[i]), int(face[(i + 1) % 3])) for face in mesh.faces for i in range(3)
    )
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.sum(a * np.cross(b, c)) > 0.0  # Six times the volume.


@pytest.mark.parametrize("name", MESHES)
def test_an_obj_file_counts_vertices_from_one(name):
    mesh = MESHES[name]
    lines = [line.split() for line in to_obj(mesh).splitlines()]
    faces = np.array([[int(i) for i in line[1:]] for line in lines if line[0] == "f"])
    assert faces.min() == 1 and faces.max() == len(mesh.vertices)


def test_the_files_among_the_models_are_those_that_are_made(tmp_path):
    """If not: python -m tests.helpers.meshes."""
    write_files(tmp_path)
    there = {p.name: p.read_text() for p in models_path("glider").iterdir()}
    assert there == {p.name: p.read_text() for p in tmp_path.iterdir()}
    assert sum(map(len, there.values())) < 30_000


def planform(parameters, link):
    """Returns the x-y extent of a link's plate as its URDF scales it, and its place."""
    robot = xml.etree.ElementTree.fromstring(make_urdf(parameters))
    part = "wing" if link == "body" else "elevator"
    (visual,) = robot.findall(f"link[@name='{link}']/visual[@name='{part}']")
    scale = [float(s) for s in visual.find("geometry/mesh").get("scale").split()]
    vertices = MESHES[part].vertices * scale
    origin = visual.find("origin")
    x = 0.0 if origin is None else float(origin.get("xyz").split()[0])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return (high - low)[:2], x + 0.5 * (low + high)[0]


@pytest.mark.parametrize("vehicle", ["perching", "heavy_ekf"])
def test_plates_have_the_areas_and_centers_of_the_vehicle(vehicle):
    parameters = load_parameters(models_path("vehicles", f"{vehicle}.yaml"))
    wing, center = planform(parameters, "body")
    assert np.prod(wing) == pytest.approx(parameters.wing_area, rel=1e-4)
    assert center == pytest.approx(parameters.wing_offset, abs=1e-6)
    elevator, center = planform(parameters, "elevator")
    assert np.prod(elevator) == pytest.approx(parameters.elevator_area, rel=1e-4)
    assert center == pytest.approx(-parameters.elevator_offset)


def test_an_elevator_without_a_chord_of_its_own_still_has_its_area():
    extent, _ = planform(GliderParameters(elevator_offset=0.0), "elevator")
    assert np.prod(extent) == pytest.approx(GliderParameters().elevator_area, rel=1e-4)


@pytest.fixture(scope="module")
def plant():
    plant = MultibodyPlant(0.0)
    ParseGlider(plant, GliderParameters())
    return plant


def point(plant, positions, body, p):
    """Returns where a body's point is in the world."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, positions)
    return plant.GetBodyByName(body).EvalPoseInWorld(context).multiply(p)


def test_the_positions_are_the_first_four_states(plant):
    names = [name.split("_")[1] for name in plant.GetPositionNames()]
    assert names == ["x", "z", "pitch", "elevator"]
    moved = point(plant, [1.0, 2.0, 0.0, 0.0], "body", [0.0, 0.0, 0.0])
    assert moved == pytest.approx([1.0, 0.0, 2.0])


def test_a_positive_pitch_lowers_the_nose(plant):
    assert point(plant, [0.0, 0.0, 0.3, 0.0], "body", [0.2, 0.0, 0.0])[2] < -0.05


def test_a_positive_elevator_raises_the_trailing_edge(plant):
    edge = [-0.044, 0.0, 0.0]
    level = point(plant, [0.0, 0.0, 0.0, 0.0], "elevator", edge)
    assert level == pytest.approx([-0.27 - 0.044, 0.0, 0.0])
    raised = point(plant, [0.0, 0.0, 0.0, 0.3], "elevator", edge)
    assert raised[2] == pytest.approx(0.044 * np.sin(0.3))


def test_the_elevator_turns_with_the_body_about_its_hinge(plant):
    """Its chord stands at pitch + elevator, as the dynamics have it."""
    pitch, elevator = -0.5, 0.2
    edge = point(plant, [0.0, 0.0, pitch, elevator], "elevator", [-0.044, 0.0, 0.0])
    hinge = -0.27 * np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    e = pitch + elevator
    chord = -0.044 * np.array([np.cos(e), 0.0, -np.sin(e)])
    assert edge == pytest.approx(hinge + chord)


def test_one_color_paints_all_parts_with_its_opacity():
    text = make_urdf(GliderParameters(), (0.2, 0.4, 0.6, 0.3))
    colors = xml.etree.ElementTree.fromstring(text).findall("material/color")
    rgba = np.array([[float(c) for c in color.get("rgba").split()] for color in colors])
    assert len(rgba) == 3
    assert np.all(rgba[:, 3] == 0.3)
    assert np.allclose(rgba[:, 1] / rgba[:, 0], 2.0)
