"""Overlays of a glider in Meshcat: trail, force arrows, and a readout."""

import math

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.geometry import Cylinder, Mesh, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    DiagramBuilder,
    EventStatus,
    LeafSystem_,
    OutputPort,
)
from pydrake.systems.scalar_conversion import TemplateSystem

from diagrams.scene import FRAMES_PER_SECOND
from diagrams.urdf import COLORS
from glider.paths import models_path
from glider.physics.parameters import GliderParameters
from glider.physics.state import PITCH, VELOCITY
from glider.systems.template import float_class

ARROW_SCALE = 0.2
"""Length of an arrow over its force [m/N]."""

_ARROW_RADIUS = 0.006
"""Radius of an arrow's shaft [m]."""

_TRAIL_RADIUS = 0.004
"""Radius of the trail [m]."""

_TRAIL_STEP = 0.03
"""Distance between two pieces of the trail [m]."""


_INK = Rgba(0.45, 0.15, 0.6)


@TemplateSystem.define("GliderOverlays_", T_list=[float, AutoDiffXd])
def GliderOverlays_(T):
    class Impl(LeafSystem_[T]):
        """Draws trail and arrows and writes the readout; its twin does not.

        Input ports:
            state (n): in the order of STATE_NAMES; the readout needs the velocity.
            forces (m): the wing's and the elevator's along their normals come first
                [N]; may be left open.

        Args:
            meshcat: where to draw.
            name: the glider's in Meshcat, as in AddScene.
            color: of the trail.
            period: between two frames [s].
            sizes: n and m.
        """

        def _construct(self, meshcat, name, color, period, sizes, *, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self._arguments = meshcat, name, color, period, sizes
            self._last = None
            self._pieces = 0
            self.DeclareVectorInputPort("state", sizes[0])
            self.DeclareVectorInputPort("forces", sizes[1])
            if T is float:
                self.DeclareInitializationPublishEvent(publish=self._clear)
                self.DeclarePeriodicPublishEvent(
                    period_sec=period, offset_sec=0.0, publish=self._draw
                )

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, *other._arguments, converter=converter)

        def _clear(self, context):
            meshcat, name, *_ = self._arguments
            meshcat.Delete(trail_path(name))
            self._last = None
            self._pieces = 0
            return EventStatus.Succeeded()

        def _draw(self, context):
            meshcat, name, *_ = self._arguments
            t = context.get_time()
            state = self.GetInputPort("state").Eval(context)
            self._draw_trail(t, np.array([state[0], 0.0, state[1]]))
            if len(state) > max(VELOCITY):
                speed = float(np.linalg.norm(state[VELOCITY]))
                numbers = RigidTransform([t, speed, state[PITCH]])
                meshcat.SetTransform(_readout_path(name), numbers, t)
            forces = self.GetInputPort("forces")
            if forces.HasValue(context):
                wing_elevator = forces.Eval(context)[:2]
                for path, force in zip(arrow_paths(name), wing_elevator, strict=True):
                    # An arrow of no length has no direction to light it by.
                    length = ARROW_SCALE * force or 1e-6
                    size = [_ARROW_RADIUS, _ARROW_RADIUS, length]
                    meshcat.SetProperty(path, "scale", size, t)
            return EventStatus.Succeeded()

        def _draw_trail(self, t, here):
            meshcat, name, color, *_ = self._arguments
            if self._last is None:
                self._last = here
            step = here - self._last
            length = float(np.linalg.norm(step))
            if not (math.isfinite(length) and length > _TRAIL_STEP):
                return
            path = f"{trail_path(name)}/{self._pieces}"
            meshcat.SetObject(path, Cylinder(_TRAIL_RADIUS, length), color)
            along = RotationMatrix.MakeFromOneVector(step, 2)
            meshcat.SetTransform(path, RigidTransform(along, self._last + 0.5 * step))
            # A recording keeps properties, not that an object came later.
            meshcat.SetProperty(path, "visible", False, 0.0)
            meshcat.SetProperty(path, "visible", True, t)
            self._last = here
            self._pieces += 1

    return Impl


GliderOverlays = float_class(GliderOverlays_)


def trail_path(name: str) -> str:
    """Returns where the trail of a glider is in Meshcat."""
    return f"/drake/{name}_trail"


def _readout_path(name: str) -> str:
    """Returns where Meshcat keeps the numbers that a page shows of a glider.

    Nothing is drawn there. Its translation is time [s], speed [m/s] and pitch [rad]: so
    numbers reach a page that is live, and are in a recording.
    """
    return f"/readout/{name}"


def arrow_paths(name: str) -> tuple[str, str]:
    """Returns where the arrows of wing and elevator are in Meshcat."""
    glider = f"/drake/{name}/glider"
    return f"{glider}/body/wing_force", f"{glider}/elevator/elevator_force"


def AddOverlays(
    builder: DiagramBuilder,
    state: OutputPort,
    meshcat: Meshcat,
    *,
    name: str = "glider",
    color: Rgba | None = None,
    forces: OutputPort | None = None,
    parameters: GliderParameters | None = None,
    frames_per_second: float = FRAMES_PER_SECOND,
) -> None:
    """Adds trail, readout and arrows of ARROW_SCALE to a glider of AddScene.

    Args:
        builder: gets the system "NAME_overlays".
        state: as in AddScene.
        meshcat: as in AddScene.
        name: as in AddScene.
        color: of the trail, without its opacity; the wing's own if None.
        forces: port of the wing's and the elevator's force along their normals [N]
            and anything after them, such as GliderPlant's "forces".
        parameters: of the vehicle, which say where the forces act.
        frames_per_second: as in AddScene.
    """
    hue = COLORS["wing"] if color is None else tuple(color.rgba)
    trail = Rgba(*hue[:3])
    width = 2 if forces is None else forces.size()
    period = 1.0 / frames_per_second
    overlays = GliderOverlays(meshcat, name, trail, period, (state.size(), width))
    builder.AddNamedSystem(f"{name}_overlays", overlays)
    builder.Connect(state, overlays.GetInputPort("state"))
    if forces is None:
        return
    builder.Connect(forces, overlays.GetInputPort("forces"))
    parameters = GliderParameters() if parameters is None else parameters
    places = parameters.wing_offset, -parameters.elevator_offset
    arrow = Mesh(str(models_path("glider", "arrow.obj")))
    for path, place in zip(arrow_paths(name), places, strict=True):
        meshcat.SetObject(path, arrow, _INK)
        meshcat.SetTransform(path, RigidTransform([place, 0.0, 0.0]))
