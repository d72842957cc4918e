"""A glider from the side, to scale, at a pose."""

import math

import numpy as np
from matplotlib.axes import Axes

from glider.physics.parameters import GliderParameters

_WING_ASPECT_RATIO = 4.0  # As in Meshcat: the parameters give only its area.
_NOSE = 0.09  # From the leading edge to the nose, as in Meshcat [m].


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
    chord = math.sqrt(parameters.wing_area / _WING_ASPECT_RATIO)
    center, pitch, elevator = pose[:2], pose[2], pose[3]
    body = _along(pitch)
    hinge = center - parameters.hinge_offset * body
    nose = center + (parameters.wing_offset + 0.5 * chord + _NOSE) * body
    wing = center + parameters.wing_offset * body
    tip = hinge - 2.0 * parameters.elevator_offset * _along(pitch + elevator)
    lines = (
        (hinge, nose, 1.2),
        (wing - 0.5 * chord * body, wing + 0.5 * chord * body, 3.5),
        (hinge, tip, 2.5),
    )
    for start, end, width in lines:
        x, z = zip(start, end, strict=True)
        ax.plot(x, z, color=color, alpha=alpha, lw=width, solid_capstyle="round")


def _along(angle: float) -> np.ndarray:
    """Unit vector (x, z) along a plate at an angle about +y [rad]."""
    return np.array([math.cos(angle), -math.sin(angle)])
