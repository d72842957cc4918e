"""Overlays of a glider in Meshcat: trail, force arrows, and a readout."""

import math

import numpy as np
from pydrake.geometry import Cylinder, Mesh, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
)

from diagrams.urdf import COLORS
from glider.paths import models_path
from glider.physics.parameters import GliderParameters
from glider.physics.state import PITCH, VELOCITY

ARROW_SCALE = 0.2
"""Length of an arrow over its force [m/N]."""

_ARROW_RADIUS = 0.006
"""Radius of an arrow's shaft [m]."""

_TRAIL_RADIUS = 0.004
"""Radius of the trail [m]."""

_TRAIL_STEP = 0.03
"""Distance between two pieces of the trail [m]."""


_INK = Rgba(0.45, 0.15, 0.6)


class _Overlays(LeafSystem):
    """Draws trail and arrows and writes the readout.

    Input ports:
        state (n): in the order of STATE_NAMES; the readout needs the velocity.
        forces (m): the wing's and the elevator's along their normals come first [N];
            may be left open.

    Args:
        meshcat: where to draw.
        name: the glider's in Meshcat, as in AddScene.
        color: of the trail.
        period: between two frames [s].
        sizes: n and m.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        name: str,
        color: Rgba,
        period: float,
        sizes: tuple[int, int],
    ) -> None:
        super().__init__()
        self._meshcat = meshcat
        self._name = name
        self._color = color
        self._last: np.ndarray | None = None
        self._pieces = 0
        self._state = self.DeclareVectorInputPort("state", sizes[0])
        self._forces = self.DeclareVectorInputPort("forces", sizes[1])
        self.DeclareInitializationPublishEvent(publish=self._clear)
        self.DeclarePeriodicPublishEvent(
            period_sec=period, offset_sec=0.0, publish=self._draw
        )

    def _clear(self, context: Context) -> EventStatus:
        self._meshcat.Delete(trail_path(self._name))
        self._last = None
        self._pieces = 0
        return EventStatus.Succeeded()

    def _draw(self, context: Context) -> EventStatus:
        t = context.get_time()
        state = self._state.Eval(context)
        self._draw_trail(t, np.array([state[0], 0.0, state[1]]))
        if len(state) > max(VELOCITY):
            speed = float(np.linalg.norm(state[VELOCITY]))
            numbers = RigidTransform([t, speed, state[PITCH]])
            self._meshcat.SetTransform(_readout_path(self._name), numbers, t)
        if self._forces.HasValue(context):
            self._draw_arrows(t, self._forces.Eval(context)[:2])
        return EventStatus.Succeeded()

    def _draw_arrows(self, t: float, forces: np.ndarray) -> None:
        for path, force in zip(arrow_paths(self._name), forces, strict=True):
            # An arrow of no length has no direction to light it by.
            length = ARROW_SCALE * force or 1e-6
            size = [_ARROW_RADIUS, _ARROW_RADIUS, length]
            self._meshcat.SetProperty(path, "scale", size, t)

    def _draw_trail(self, t: float, here: np.ndarray) -> None:
        if self._last is None:
            self._last = here
        step = here - self._last
        length = float(np.linalg.norm(step))
        if not (math.isfinite(length) and length > _TRAIL_STEP):
            return
        path = f"{trail_path(self._name)}/{self._pieces}"
        self._meshcat.SetObject(path, Cylinder(_TRAIL_RADIUS, length), self._color)
        along = RotationMatrix.MakeFromOneVector(step, 2)
        pose = RigidTransform(along, self._last + 0.5 * step)
        self._meshcat.SetTransform(path, pose)
        # A recording keeps properties, not that an object came later.
        self._meshcat.SetProperty(path, "visible", False, 0.0)
        self._meshcat.SetProperty(path, "visible", True, t)
        self._last = here
        self._pieces += 1


def trail_path(name: str) -> str:
    """Returns where the trail of a glider is in Meshcat."""
    return f"/drake/{name}_trail"


def _readout_path(name: str) -> str:
    """Returns where Meshcat keeps the numbers that a page shows of a glider.

    Nothing is drawn there. Its translation is time [s], speed [m/s] and pitch [rad], so
    that a recording holds them.
    """
    return f"/readout/{name}"


def arrow_paths(name: str) -> tuple[str, str]:
    """Returns where the arrows of wing and elevator are in Meshcat."""
    glider = f"/drake/{name}/glider"
    return f"{glider}/body/wing_force", f"{glider}/elevator/elevator_force"


def add_overlays(
    builder: DiagramBuilder,
    state: OutputPort,
    meshcat: Meshcat,
    name: str,
    period: float,
    parameters: GliderParameters,
    color: Rgba | None,
    forces: OutputPort | None,
) -> None:
    """Adds trail, readout and arrows of ARROW_SCALE to a glider; see AddScene."""
    hue = COLORS["wing"] if color is None else tuple(color.rgba)
    trail = Rgba(*hue[:3])
    width = 2 if forces is None else forces.size()
    overlays = _Overlays(meshcat, name, trail, period, (state.size(), width))
    builder.AddNamedSystem(f"{name}_overlays", overlays)
    builder.Connect(state, overlays.GetInputPort("state"))
    if forces is None:
        return
    builder.Connect(forces, overlays.GetInputPort("forces"))
    places = parameters.wing_offset, -parameters.elevator_offset
    arrow = Mesh(str(models_path("glider", "arrow.obj")))
    for path, place in zip(arrow_paths(name), places, strict=True):
        meshcat.SetObject(path, arrow, _INK)
        meshcat.SetTransform(path, RigidTransform([place, 0.0, 0.0]))
