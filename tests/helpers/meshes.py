"""Makes the meshes of models/glider, and the default vehicle's URDF beside them.

python -m tests.helpers.meshes
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from diagrams.urdf import make_urdf
from glider.paths import models_path
from glider.physics.parameters import GliderParameters

DIHEDRAL = math.radians(7.0)
"""Dihedral of the wing [rad], for the eye: the dynamics are planar."""


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


def write_files(folder: Path) -> None:
    """Writes the meshes and the default vehicle's URDF, as in models/glider."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, mesh in make_meshes().items():
        (folder / f"{name}.obj").write_text(to_obj(mesh), encoding="utf-8")
    urdf = make_urdf(GliderParameters())
    (folder / "glider.urdf").write_text(urdf, encoding="utf-8")


if __name__ == "__main__":
    write_files(models_path("glider"))
