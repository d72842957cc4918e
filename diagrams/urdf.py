"""The look of a glider: a URDF that gives it meshes of unit size.

The meshes are in models/glider and do not depend on the vehicle. `make_urdf`
stretches them to a vehicle; models/glider/glider.urdf is the default one's.
`python -m tests.helpers.meshes` makes both again.
"""

import math
from collections.abc import Sequence

from glider.physics.parameters import GliderParameters

_ASPECT_RATIO = 4.0
"""Span over chord of the wing; the parameters give only its area."""

COLORS: dict[str, tuple[float, ...]] = {
    "wing": (0.13, 0.38, 0.70, 1.0),
    "boom": (0.22, 0.24, 0.28, 1.0),
    "elevator": (0.93, 0.45, 0.10, 1.0),
}
"""Red, green, blue and opacity of the parts; they read well on white."""

_NOSE = 0.09
"""Distance from the wing's leading edge to the nose [m]."""

_ELEVATOR_ASPECT_RATIO = 7.0
"""Span over chord of an elevator whose parameters give it no chord."""


_URDF = """\
<?xml version="1.0"?>
<!-- A planar glider to look at; diagrams/urdf.py writes this file. Its positions
     are x, z [m], pitch, elevator [rad], the first four states; both angles turn
     about +y, so a positive pitch is nose down and a positive elevator is trailing
     edge up. The body's origin is the center of mass. -->
<robot name="glider">
  <material name="wing"><color rgba="{wing_color}"/></material>
  <material name="boom"><color rgba="{boom_color}"/></material>
  <material name="elevator"><color rgba="{elevator_color}"/></material>
  <link name="x_carriage"/>
  <link name="z_carriage"/>
  <link name="body">
    <visual name="wing">
      <origin xyz="{wing_x:g} 0 {wing_z:g}"/>
      <geometry><mesh filename="package://drake_glider_models/glider/wing.obj"
        scale="{chord:g} {span:g} {span:g}"/></geometry>
      <material name="wing"/>
    </visual>
    <visual name="boom">
      <origin xyz="{nose:g} 0 0"/>
      <geometry><mesh filename="package://drake_glider_models/glider/boom.obj"
        scale="{length:g} {length:g} {length:g}"/></geometry>
      <material name="boom"/>
    </visual>
    <visual name="fin">
      <origin xyz="{hinge:g} 0 0"/>
      <geometry><mesh filename="package://drake_glider_models/glider/fin.obj"
        scale="{fin:g} {fin:g} {fin:g}"/></geometry>
      <material name="wing"/>
    </visual>
    <visual name="hinge">
      <origin xyz="{hinge:g} 0 0" rpy="1.5707963 0 0"/>
      <geometry><cylinder radius="0.003" length="{elevator_span:g}"/></geometry>
      <material name="boom"/>
    </visual>
  </link>
  <link name="elevator">
    <visual name="elevator">
      <geometry><mesh filename="package://drake_glider_models/glider/elevator.obj"
        scale="{elevator_chord:g} {elevator_span:g} {elevator_span:g}"/></geometry>
      <material name="elevator"/>
    </visual>
  </link>
  <joint name="x" type="prismatic">
    <parent link="world"/><child link="x_carriage"/>
    <axis xyz="1 0 0"/><limit effort="0"/>
  </joint>
  <joint name="z" type="prismatic">
    <parent link="x_carriage"/><child link="z_carriage"/>
    <axis xyz="0 0 1"/><limit effort="0"/>
  </joint>
  <joint name="pitch" type="continuous">
    <parent link="z_carriage"/><child link="body"/>
    <axis xyz="0 1 0"/><limit effort="0"/>
  </joint>
  <joint name="elevator" type="revolute">
    <parent link="body"/><child link="elevator"/>
    <origin xyz="{hinge:g} 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="{lower:g}" upper="{upper:g}" velocity="{rate:g}" effort="0"/>
  </joint>
</robot>
"""


_FREE_TRAVEL = (-1.5, 1.5)
_FREE_RATE = 100.0
"""Limits of a joint whose servo is unspecified [rad, rad/s]: a URDF needs some."""


def make_outline(parameters: GliderParameters) -> dict[str, float]:
    """Returns what a glider is from the side: places and lengths along its body [m].

    Places are ahead of the center of mass: "wing_x" of the wing's middle, "nose",
    "hinge"; the lengths are "chord" of the wing, "elevator_chord".
    """
    chord = math.sqrt(parameters.wing_area / _ASPECT_RATIO)
    elevator_chord = 2.0 * parameters.elevator_offset
    if elevator_chord <= 0.0:
        elevator_chord = math.sqrt(parameters.elevator_area / _ELEVATOR_ASPECT_RATIO)
    return {
        "wing_x": parameters.wing_offset,
        "chord": chord,
        "nose": parameters.wing_offset + 0.5 * chord + _NOSE,
        "hinge": -parameters.hinge_offset,
        "elevator_chord": elevator_chord,
    }


def make_urdf(
    parameters: GliderParameters, color: Sequence[float] | None = None
) -> str:
    """Returns a vehicle as the text of a URDF with the positions x, z, pitch, elevator.

    Wing (but for its tips) and elevator have the vehicle's areas; the hinge is
    where the vehicle has it, and so is the elevator's center: its chord is
    2 elevator_offset.

    Args:
        parameters: of the vehicle.
        color: of all parts, (red, green, blue, opacity) from 0 to 1; the boom is
            darker. COLORS if None.
    """
    if color is None:
        colors = COLORS
    else:
        *hue, opacity = color
        dark = (*(0.5 * c for c in hue), opacity)
        colors = {"wing": tuple(color), "boom": dark, "elevator": tuple(color)}
    outline = make_outline(parameters)
    chord = outline["chord"]
    lower, upper = parameters.elevator_limits or _FREE_TRAVEL
    return _URDF.format(
        **{f"{k}_color": " ".join(f"{c:g}" for c in v) for k, v in colors.items()},
        **outline,
        wing_z=0.01,
        span=_ASPECT_RATIO * chord,
        length=outline["nose"] - outline["hinge"],
        fin=0.6 * chord,
        elevator_span=parameters.elevator_area / outline["elevator_chord"],
        lower=lower,
        upper=upper,
        rate=parameters.elevator_rate_limit or _FREE_RATE,
    )
