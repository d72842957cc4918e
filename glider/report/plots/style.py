"""One look for all figures: colours, widths and dashes of legend entries, and names.

The palette is Okabe and Ito's, which colour-blind readers can distinguish.
"""

import math
from typing import Any

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E08A00", "#009E73", "#D55E00"
PURPLE, _GREY = "#CC79A7", "#8A8A8A"
"""Colours of the palette; its red is called vermilion."""

_LIGHT_BLUE, _LIGHT_ORANGE, _LIGHT_RED = "#56B4E9", "#F0A72E", "#FF8A50"

INKS = {
    "measured": ("#000000", "#F2F4F6"),
    "nominal": (_GREY, "#9AA3AC"),
    "refitted": (ORANGE, _LIGHT_ORANGE),
    "corrected": (BLUE, _LIGHT_BLUE),
    "soft": ("#5B6570", "#A7B0BA"),
    "fitted": (_GREY, "#7C858F"),
    "named": (GREEN, "#2FC79B"),
    "rest": (RED, _LIGHT_RED),
    "worse": (RED, _LIGHT_RED),
    "confused": ("#8CC3E6", "#2F6E96"),
}
"""Entry of a legend to its colour on a light and on a dark ground."""

COLORS = {key: light for key, (light, _) in INKS.items()}
"""The colour on a light ground."""

DASHES = {
    "nominal": (4.0, 1.5),
    "refitted": (4.0, 1.2, 1.0, 1.2),
    "named": (3.0, 1.5),
    "rest": (1.0, 1.0),
}
"""Dash, gap, ... in widths of the line; lines that are not named are solid."""

WIDTHS = {
    **{"measured": 3.0, "nominal": 2.4, "refitted": 2.4},
    **{"named": 2.0, "rest": 2.0},
}
"""Widths of lines; those not named are thinner, and show what lies below."""

TERMS = {
    "c_normal": "normal force $C_n$",
    "c_axial": "axial force $C_a$",
    "c_moment": "moment $C_M$ [m]",
    "elevator_factor": "force of the tail, relative change",
    "tail_downwash": "downwash at the tail [rad]",
    "tail_angle": "angle added to the elevator's [rad]",
    "wing_factor": "force of the wing, relative change",
    "push": "force along the body axis over the mass [m/s²]",
    "added_mass": "added mass over the mass",
    "added_inertia": "added inertia over the pitch inertia",
    "c_lift": "lift $C_L$",
    "c_drag": "drag $C_D$",
    "wind_x": "air moving forward [m/s]",
    "wind_z": "air moving up [m/s]",
    "pose_x": "error of measured x [m]",
    "pose_z": "error of measured z [m]",
    "pose_pitch": "error of measured pitch [rad]",
}
"""Term of a curve to its name."""

VARIABLES = {
    "x": ("x [m]", 1.0),
    "z": ("z [m]", 1.0),
    "t": ("time [s]", 1.0),
    "pitch": ("pitch θ, nose down > 0 [°]", math.degrees(1.0)),
    "V": ("airspeed V [m/s]", 1.0),
    "alpha": ("angle of attack α [°]", math.degrees(1.0)),
    "alphadot": ("rate of α [°/s]", math.degrees(1.0)),
    "pitchdot": ("pitch rate [°/s]", math.degrees(1.0)),
    "elevator": ("elevator, up > 0 [°]", math.degrees(1.0)),
    "elevator_rate": ("elevator rate [°/s]", math.degrees(1.0)),
    "tail_load": ("load of the elevator [Pa]", 1.0),
    "reduced_rate": ("pitch rate over airspeed [°/m]", math.degrees(1.0)),
}
"""Variable to its axis label and the factor from SI."""

# Colours of axes.
_FRAME = "#444444"
_GRID = "#E4E4E4"

STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": _FRAME,
    "axes.grid": True,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "axes.labelsize": 9.5,
    "font.family": "DejaVu Sans",  # Comes with matplotlib.
    "font.size": 9.5,
    "grid.color": _GRID,
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "text.usetex": False,
    "xtick.color": _FRAME,
    "xtick.labelsize": 8.5,
    "ytick.color": _FRAME,
    "ytick.labelsize": 8.5,
}
"""Settings for `matplotlib.rc_context`, round the making of a picture."""
