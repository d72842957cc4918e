"""A diagram's glider in Meshcat, without a browser."""

import numpy as np
import pytest
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from diagrams.scene import (
    FRAMES_PER_SECOND,
    AddScene,
    ParseGlider,
    SetStage,
    Stage,
    camera_of,
)
from glider.physics.parameters import GliderParameters
from glider.systems.plant import GliderPlant
from tests.helpers.meshcat import place_of

STATE = np.array([-2.0, 0.2, -0.4, 0.3, 7.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat()


def make_watched(meshcat, state=STATE, **options):
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource(state))
    AddScene(builder, source.get_output_port(), meshcat, **options)
    return builder.Build()


def poses_of(diagram, context=None):
    """Returns frame name to its pose in the world."""
    context = context if context is not None else diagram.CreateDefaultContext()
    geometry = diagram.GetSubsystemByName("glider_geometry")
    poses = geometry.get_output_port().Eval(geometry.GetMyContextFromRoot(context))
    inspector = diagram.GetSubsystemByName("glider_scene_graph").model_inspector()
    return {inspector.GetName(frame): poses.value(frame) for frame in poses.ids()}


def test_a_plant_is_watched_while_it_flies(meshcat):
    builder = DiagramBuilder()
    plant = builder.AddSystem(GliderPlant())
    rate = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(rate.get_output_port(), plant.GetInputPort("elevator_rate"))
    AddScene(builder, plant.GetOutputPort("state"), meshcat, name="watched")
    diagram = builder.Build()
    names = {system.get_name() for system in diagram.GetSystems()}
    added = {"watched_scene_graph", "watched_geometry", "watched_overlays"}
    assert added < names
    simulator = Simulator(diagram)
    context = plant.GetMyContextFromRoot(simulator.get_mutable_context())
    context.SetContinuousState(STATE)
    simulator.AdvanceTo(8 / FRAMES_PER_SECOND)
    body = "/drake/watched/glider/body"
    x = context.get_continuous_state_vector().CopyToVector()[0]
    assert x > STATE[0] + 0.5
    assert place_of(meshcat, body)[0] == pytest.approx(x, abs=1e-6)
    assert meshcat.HasPath("/drake/watched/glider/elevator")


def test_all_frames_are_where_the_model_says(meshcat):
    diagram = make_watched(meshcat)
    plant = MultibodyPlant(0.0)
    ParseGlider(plant, GliderParameters())
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, STATE[:4])
    poses = poses_of(diagram)
    for body in ("body", "elevator"):
        X_WB = plant.GetBodyByName(body).EvalPoseInWorld(context)
        assert poses[f"glider::{body}"].IsNearlyEqualTo(X_WB, 1e-12)


def test_gliders_of_different_names_share_a_meshcat(meshcat):
    builder = DiagramBuilder()
    for name in ("first", "second"):
        source = builder.AddSystem(ConstantVectorSource(STATE))
        color = Rgba(1.0, 0.0, 0.0, 0.5)
        AddScene(builder, source.get_output_port(), meshcat, name=name, color=color)
    Simulator(builder.Build()).Initialize()
    for name in ("first", "second"):
        assert meshcat.HasPath(f"/drake/{name}/glider/body")


def test_a_scene_replaces_an_older_one_of_its_name(meshcat):
    Simulator(make_watched(meshcat, name="again")).Initialize()
    meshcat.SetObject("/drake/again/left_over", Sphere(0.1))
    Simulator(make_watched(meshcat, name="again")).Initialize()
    assert meshcat.HasPath("/drake/again/glider/body")
    assert not meshcat.HasPath("/drake/again/left_over")


def test_a_slow_simulation_can_be_drawn_more_often(meshcat):
    builder = DiagramBuilder()
    ends = np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    line = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], ends)
    x = builder.AddSystem(TrajectorySource(line)).get_output_port()
    AddScene(builder, x, meshcat, name="slow", frames_per_second=500.0)
    Simulator(builder.Build()).AdvanceTo(0.01)
    assert place_of(meshcat, "/drake/slow/glider/body")[0] == pytest.approx(0.01)


def test_the_vehicle_sets_the_hinge(meshcat):
    diagram = make_watched(meshcat, parameters=GliderParameters(hinge_offset=0.5))
    poses = poses_of(diagram)
    center, hinge = (poses[f"glider::{b}"].translation() for b in ("body", "elevator"))
    reach = center - hinge
    assert np.linalg.norm(reach) == pytest.approx(0.5)


def test_the_stage_has_a_perch_only_where_there_is_a_wire():
    meshcat = Meshcat()
    SetStage(meshcat, Stage(wire=(0.5, 0.1)))
    assert place_of(meshcat, "perch/wire") == pytest.approx([0.5, 0.0, 0.1])
    SetStage(meshcat, Stage(wire=None))
    assert not meshcat.HasPath("perch")
    assert place_of(meshcat, "floor") == pytest.approx([-1.5, 0.0, -0.705])


def test_the_camera_sees_the_whole_stage():
    stage = Stage(x_limits=(-10.0, 2.0), z_limits=(-1.0, 3.0))
    camera, target = camera_of(stage)
    assert target == pytest.approx([-4.0, 0.0, 1.0])
    half = np.tan(np.radians(10.0)) * np.linalg.norm(target - camera)
    assert half * 1.5 >= 6.0 and half >= 2.0
    assert camera[1] < 0.0 and camera[2] > target[2]
