"""Looks of a glider: meshes of unit size, and a URDF that gives them one.

The meshes are in models/glider and do not depend on the vehicle. `make_urdf`
stretches them to a vehicle; models/glider/glider.urdf is the default one's.
`write_files` makes both anew.
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.physics.parameters import GliderParameters

ASPECT_RATIO = 4.0
"""Span over chord of the wing; the parameters tell only its area."""

DIHEDRAL = math.radians(7.0)
"""Dihedral of the wing [rad], for the eye: the dynamics are planar."""

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class TriangleMesh:
    """A closed surface.

    Attributes:
        vertices: (n, 3).
        faces: (m, 3) indices of vertices, counterclockwise seen from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray


def make_meshes() -> dict[str, TriangleMesh]:
    """Returns the parts by name.

    Each is 1 long: "wing", "fin" and "elevator" have chord 1 along x and span 1
    (wing and elevator along y, with their height in spans; the fin along z);
    "boom" runs from x = -1 to 0; "arrow" points from the origin along +z and
    has a shaft of radius 1.
    """
    plate = np.array(
        [
            *([0.5, 0.0], [0.4, 0.006], [0.0, 0.008], [-0.5, 0.001]),
            *([-0.5, -0.001], [0.0, -0.004], [0.4, -0.004]),
        ]
    )
    wing = [
        np.column_stack(
            [
                chord * plate[:, 0] + 0.5 * (1.0 - chord),
                np.full(len(plate), y),
                plate[:, 1] + abs(y) * math.tan(DIHEDRAL),
            ]
        )
        for y, chord in ((-0.5, 0.7), (-0.44, 1.0), (0.0, 1.0), (0.44, 1.0), (0.5, 0.7))
    ]
    flap = np.array([[0.0, 0.008], [-1.0, 0.002], [-1.0, -0.002], [0.0, -0.008]])
    elevator = [np.insert(flap, 1, y, axis=1) for y in (0.5, -0.5)]
    outline = np.array([[1.0, 0.0], [0.5, 0.04], [0.0, 0.0], [0.5, -0.04]])
    fin = [
        np.column_stack([chord * outline[:, 0], width * outline[:, 1], np.full(4, z)])
        for z, chord, width in ((0.0, 1.0, 1.0), (0.9, 0.55, 0.7), (1.0, 0.4, 0.5))
    ]
    boom_profile = (
        (-1.0, 0.009), (-0.62, 0.011), (-0.5, 0.02), (-0.36, 0.037), (-0.2, 0.046),
        (-0.08, 0.04), (-0.02, 0.022), (0.0, 0.004),
    )  # fmt: skip
    arrow_profile = ((0.0, 1.0), (0.78, 1.0), (0.78, 2.6), (1.0, 0.01))
    return {
        "wing": _loft(wing[::-1]),
        "elevator": _loft(elevator),
        "fin": _loft(fin),
        "boom": _loft([_ring(at, radius, axis=0) for at, radius in boom_profile]),
        "arrow": _loft([_ring(at, radius, axis=2) for at, radius in arrow_profile]),
    }


def _ring(at: float, radius: float, axis: int) -> np.ndarray:
    """Returns a ring about the x (0) or z (2) axis, counterclockwise along it."""
    angle = np.linspace(0.0, 2.0 * math.pi, 14, endpoint=False)
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.insert(ring, axis, at, axis=1)


def _loft(sections: Sequence[np.ndarray]) -> TriangleMesh:
    """Skins over sections of k points each and closes both ends.

    The points of a section run counterclockwise for who looks back along the
    way from the first section to the last.
    """
    count, k = len(sections), len(sections[0])
    faces = []
    for s in range(count - 1):
        for i in range(k):
            a, b = s * k + i, s * k + (i + 1) % k
            faces += [[a, b, b + k], [a, b + k, a + k]]
    last = (count - 1) * k
    for i in range(1, k - 1):
        faces += [[0, i + 1, i], [last, last + i, last + i + 1]]
    return TriangleMesh(vertices=np.vstack(sections), faces=np.array(faces))


def to_obj(mesh: TriangleMesh) -> str:
    """Returns a mesh as the text of a Wavefront OBJ file."""
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in mesh.vertices + 0.0]
    lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    return "\n".join(lines) + "\n"


_URDF = """\
<?xml version="1.0"?>
<!-- A planar glider to look at; diagrams/meshes.py writes this file. Its positions
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
"""Limits of a joint whose servo nobody told of [rad, rad/s]: a URDF needs some."""


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
    chord = math.sqrt(parameters.wing_area / ASPECT_RATIO)
    elevator_chord = 2.0 * parameters.elevator_offset
    if elevator_chord <= 0.0:
        elevator_chord = math.sqrt(parameters.elevator_area / _ELEVATOR_ASPECT_RATIO)
    hinge = -parameters.hinge_offset
    nose = parameters.wing_offset + 0.5 * chord + _NOSE
    lower, upper = parameters.elevator_limits or _FREE_TRAVEL
    return _URDF.format(
        **{f"{k}_color": " ".join(f"{c:g}" for c in v) for k, v in colors.items()},
        wing_x=parameters.wing_offset,
        wing_z=0.01,
        chord=chord,
        span=ASPECT_RATIO * chord,
        nose=nose,
        length=nose - hinge,
        hinge=hinge,
        fin=0.6 * chord,
        elevator_chord=elevator_chord,
        elevator_span=parameters.elevator_area / elevator_chord,
        lower=lower,
        upper=upper,
        rate=parameters.elevator_rate_limit or _FREE_RATE,
    )


def write_files(folder: Path) -> None:
    """Writes the meshes and the default vehicle's URDF, as in models/glider."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, mesh in make_meshes().items():
        (folder / f"{name}.obj").write_text(to_obj(mesh), encoding="utf-8")
    urdf = make_urdf(GliderParameters())
    (folder / "glider.urdf").write_text(urdf, encoding="utf-8")
