"""A glider to look at: any diagram's state, live in Meshcat.

    AddScene(builder, plant.GetOutputPort("state"), meshcat)

To watch in real time, or slower, set the simulator's rate:
`simulator.set_target_realtime_rate(0.2)`, and give AddScene 5 times the
`frames_per_second`. To record, call
`meshcat.StartRecording()` before the simulator and `PublishRecording()` after.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import (
    Box,
    Cylinder,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from diagrams.overlays import add_overlays
from diagrams.urdf import make_urdf
from glider.paths import models_path
from glider.physics.parameters import GliderParameters

FRAMES_PER_SECOND = 64.0
"""Rate of what Meshcat shows and records, in simulated time [1/s]; as Meshcat's own."""

NUM_POSITIONS = 4
"""Number of positions (x, z, pitch and elevator), the first of the states. Nothing else
is drawn."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage:
    """Stage round the glider, and what is in view."""

    wire: tuple[float, float] | None = (0.0, 0.0)
    """The perch, (x, z) [m]; None for no perch."""

    x_limits: tuple[float, float] = (-3.7, 0.7)
    """Bounds of x in view [m]."""

    z_limits: tuple[float, float] = (-0.7, 0.9)
    """Bounds of z in view; the floor is at the lower one [m]."""


def AddScene(
    builder: DiagramBuilder,
    state: OutputPort,
    meshcat: Meshcat,
    *,
    name: str = "glider",
    color: Rgba | None = None,
    forces: OutputPort | None = None,
    parameters: GliderParameters | None = None,
    stage: Stage | None = None,
    frames_per_second: float = FRAMES_PER_SECOND,
) -> SceneGraph:
    """Adds what draws a glider in Meshcat under "/drake/NAME", with trail and arrows.

    Several gliders may fly in one Meshcat, under different names. A diagram that is to
    be converted to AutoDiffXd is built without a scene.

    Args:
        builder: gets the systems "NAME_scene_graph", "NAME_positions",
            "NAME_geometry", "NAME_visualizer" and "NAME_overlays".
        state: port of x, z, pitch, elevator and anything after them.
        meshcat: where to draw.
        name: of the glider in Meshcat.
        color: of the whole glider; the model's own if None.
        forces: port of the wing's and the elevator's force along their normals [N]
            and anything after them, such as GliderPlant's "forces"; None: no arrows.
        parameters: of the vehicle, which give the sizes.
        stage: what to set round it; None for the article's flight to the wire.
        frames_per_second: of simulated time; more where it is to run slowly.
    """
    parameters = GliderParameters() if parameters is None else parameters
    SetStage(meshcat, stage if stage is not None else Stage())
    meshcat.Delete(f"/drake/{name}")
    scene_graph = builder.AddNamedSystem(f"{name}_scene_graph", SceneGraph())
    plant = MultibodyPlant(0.0)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    ParseGlider(plant, parameters, color)
    first = MatrixGain(np.eye(NUM_POSITIONS, state.size()))
    positions = builder.AddNamedSystem(f"{name}_positions", first)
    geometry = builder.AddNamedSystem(
        f"{name}_geometry", MultibodyPositionToGeometryPose(plant)
    )
    builder.Connect(state, positions.get_input_port())
    builder.Connect(positions.get_output_port(), geometry.get_input_port())
    builder.Connect(
        geometry.get_output_port(),
        scene_graph.get_source_pose_port(plant.get_source_id()),
    )
    settings = MeshcatVisualizerParams()
    settings.prefix = name
    settings.publish_period = 1.0 / frames_per_second
    settings.delete_on_initialization_event = False  # Arrows are in its tree.
    visualizer = MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, settings)
    visualizer.set_name(f"{name}_visualizer")
    period = 1.0 / frames_per_second
    add_overlays(builder, state, meshcat, name, period, parameters, color, forces)
    return scene_graph


def ParseGlider(
    plant: MultibodyPlant, parameters: GliderParameters, color: Rgba | None = None
) -> None:
    """Adds the glider's model to a plant and finalizes it.

    Its positions are x, z, pitch, elevator.
    """
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(models_path("package.xml")))
    rgba = None if color is None else tuple(color.rgba)
    parser.AddModelsFromString(make_urdf(parameters, rgba), "urdf")
    plant.Finalize()


_WIRE_SPAN = 1.2
"""Distance between the posts [m]; twice the wing's span."""

_DEPTH = 3.0
"""Depth of the floor, across the plane of flight [m]."""

_FIELD_OF_VIEW = 20.0
"""Vertical field of view of the camera [deg]: narrow, to look square at the plane of
flight."""

_WIDTH_PER_HEIGHT = 1.5
"""Width over height of a window in which the whole stage is in view."""


def SetStage(meshcat: Meshcat, stage: Stage) -> None:
    """Sets the floor, the perch and the camera, on a white background."""
    floor = stage.z_limits[0]
    meshcat.SetProperty("/Background/<object>", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.93, 0.95, 0.97])
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Grid", "visible", False)
    left, right = stage.x_limits
    slab = Box(right - left + 1.0, _DEPTH, 0.01)
    meshcat.SetObject("floor", slab, Rgba(0.82, 0.85, 0.87))
    middle = RigidTransform([0.5 * (left + right), 0.0, floor - 0.005])
    meshcat.SetTransform("floor", middle)
    meshcat.Delete("perch")
    if stage.wire is not None:
        _set_perch(meshcat, stage.wire, floor)
    camera, target = camera_of(stage)
    perspective = Meshcat.PerspectiveCamera()
    perspective.fov = _FIELD_OF_VIEW
    meshcat.SetCamera(perspective)
    meshcat.SetCameraPose(camera, target)


def camera_of(stage: Stage) -> tuple[np.ndarray, np.ndarray]:
    """Returns where the camera is and what it looks at, in the world [m].

    It looks along +y, so that x is to the right and z is up, a little from above.
    """
    left, right = stage.x_limits
    low, high = stage.z_limits
    height = max(high - low, (right - left) / _WIDTH_PER_HEIGHT)
    distance = 0.5 * height / math.tan(math.radians(0.5 * _FIELD_OF_VIEW))
    target = np.array([0.5 * (left + right), 0.0, 0.5 * (low + high)])
    return target + distance * np.array([0.0, -1.0, 0.12]), target


def _set_perch(meshcat: Meshcat, wire: Sequence[float], floor: float) -> None:
    x, z = wire
    steel = Rgba(0.75, 0.1, 0.1)
    wood = Rgba(0.55, 0.45, 0.35)
    meshcat.SetObject("perch/wire", Cylinder(0.008, _WIRE_SPAN), steel)
    # A cylinder lies across the plane of flight.
    across = RollPitchYaw(0.5 * math.pi, 0.0, 0.0).ToRotationMatrix()
    meshcat.SetTransform("perch/wire", RigidTransform(across, [x, 0.0, z]))
    height = max(z - floor, 0.01)
    for name, side in (("near", -0.5), ("far", 0.5)):
        meshcat.SetObject(f"perch/{name}", Cylinder(0.015, height), wood)
        middle = RigidTransform([x, side * _WIRE_SPAN, z - 0.5 * height])
        meshcat.SetTransform(f"perch/{name}", middle)
