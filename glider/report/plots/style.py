"""One look for all figures: what a model's colour, name and line are.

The palette is Okabe and Ito's, which colour-blind readers can tell apart.
"""

import math
from typing import Any

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E08A00", "#009E73", "#D55E00"
PURPLE, GREY = "#CC79A7", "#8A8A8A"
"""Colours of the palette; its red is called vermilion."""

COLORS = {
    "measured": "#000000",
    "nominal": GREY,
    "refitted": ORANGE,
    "calibrated": PURPLE,
    "corrected": BLUE,
}
"""Model to its colour."""

DARK = {
    "measured": "#F2F4F6",
    "nominal": "#9AA3AC",
    "refitted": "#F0A72E",
    "calibrated": "#E39CC2",
    "corrected": "#56B4E9",
}
"""The same on a dark ground, for pages."""

LABELS = {
    "measured": "measured",
    "nominal": "nominal",
    "refitted": "refitted",
    "calibrated": "pitch zero",
    "corrected": "corrected",
}
"""Model to its name for people."""

DASHES = {
    "nominal": (0, (4, 1.5)),
    "refitted": (0, (4, 1.2, 1, 1.2)),
    "calibrated": (0, (1, 1)),
}
"""Lines differ without colour too; those not named here are solid."""

STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#444444",
    "axes.grid": True,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "axes.labelsize": 9.5,
    "font.family": "DejaVu Sans",  # Comes with matplotlib.
    "font.size": 9.5,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "text.usetex": False,
    "xtick.color": "#444444",
    "xtick.labelsize": 8.5,
    "ytick.color": "#444444",
    "ytick.labelsize": 8.5,
}
"""Settings for `matplotlib.rc_context`, round the making of a figure."""

TERMS = {
    "c_normal": "normal force $C_n$",
    "c_axial": "axial force $C_a$",
    "c_moment": "moment $C_M$ [m]",
    "elevator_factor": "force of the tail, factor",
    "c_lift": "lift $C_L$",
    "c_drag": "drag $C_D$",
    "wind_x": "air moving forward [m/s]",
    "wind_z": "air moving up [m/s]",
}
"""Term of a curve to its name for people."""

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
}
"""Variable to its axis label and the factor from SI."""

WIDTHS = {"nominal": 2.4, "refitted": 2.4, "calibrated": 2.0}
"""Widths of lines; those not named here are thinner, and show what lies below."""


def line(model):
    """Returns how a model's line is drawn, for `ax.plot`."""
    return {
        "color": COLORS[model],
        "label": LABELS[model],
        "lw": WIDTHS.get(model, 1.6),
        "ls": DASHES.get(model, "-"),
    }
