"""Names for people of models, terms and variables, with units."""

import math

LABELS = {
    "measured": "measured",
    "nominal": "nominal",
    "refitted": "refitted",
    "calibrated": "pitch zero",
    "corrected": "corrected",
}
"""Model to its name, in the order in which models are shown."""

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
}
"""Variable to its axis label and the factor from SI."""
