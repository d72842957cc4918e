"""A glider from the side, to scale, at a pose."""

import math

import numpy as np
from matplotlib.axes import Axes

from diagrams.urdf import make_outline
from glider.physics.parameters import GliderParameters


def draw_glider(
    ax: Axes,
    parameters: GliderParameters,
    pose: np.ndarray,
    *,
    color: str,
    alpha: float = 1.0,
) -> None:
    """Draws boom, wing and elevator.

    Args:
        ax: of the vertical plane, x to the right and z up [m].
        parameters: of the vehicle.
        pose: x, z of the center of mass [m], pitch, elevator [rad].
        color: of all parts.
        alpha: opacity.
    """
    outline = make_outline(parameters)
    center, pitch, elevator = pose[:2], pose[2], pose[3]
    body = _along(pitch)
    hinge = center + outline["hinge"] * body
    nose = center + outline["nose"] * body
    wing = center + outline["wing_x"] * body
    half = 0.5 * outline["chord"] * body
    tip = hinge - outline["elevator_chord"] * _along(pitch + elevator)
    lines = ((hinge, nose, 1.2), (wing - half, wing + half, 3.5), (hinge, tip, 2.5))
    for start, end, width in lines:
        x, z = zip(start, end, strict=True)
        ax.plot(x, z, color=color, alpha=alpha, lw=width, solid_capstyle="round")


def _along(angle: float) -> np.ndarray:
    """Unit vector (x, z) along a plate at an angle about +y [rad]."""
    return np.array([math.cos(angle), -math.sin(angle)])
