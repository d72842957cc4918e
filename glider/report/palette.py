"""One look for all figures: colours, widths and dashes of the entries of legends.

The palette is Okabe and Ito's, which colour-blind readers can distinguish.
"""

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E08A00", "#009E73", "#D55E00"
PURPLE, GREY = "#CC79A7", "#8A8A8A"
"""Colours of the palette; its red is called vermilion."""

_LIGHT_BLUE, _LIGHT_ORANGE, _LIGHT_RED = "#56B4E9", "#F0A72E", "#FF8A50"

COLORS = {
    "measured": ("#000000", "#F2F4F6"),
    "nominal": (GREY, "#9AA3AC"),
    "refitted": (ORANGE, _LIGHT_ORANGE),
    "calibrated": (PURPLE, "#E39CC2"),
    "corrected": (BLUE, _LIGHT_BLUE),
    "noise": ("#1B1F24", "#E6E9ED"),
    "soft": ("#5B6570", "#A7B0BA"),
    "fitted": (GREY, "#7C858F"),
    "lack": (BLUE, _LIGHT_BLUE),
    "named": (GREEN, "#2FC79B"),
    "rest": (RED, _LIGHT_RED),
    "better": (BLUE, _LIGHT_BLUE),
    "worse": (RED, _LIGHT_RED),
    "own": (BLUE, _LIGHT_BLUE),
    "chosen": (BLUE, _LIGHT_BLUE),
    "confused": ("#8CC3E6", "#2F6E96"),
    "other": ("#B5B5B5", "#5F6873"),
    "first": (ORANGE, _LIGHT_ORANGE),
    "second": (BLUE, _LIGHT_BLUE),
}
"""Entry of a legend to its colour on a light and on a dark ground."""

DASHES = {
    "nominal": (4.0, 1.5),
    "refitted": (4.0, 1.2, 1.0, 1.2),
    "calibrated": (1.0, 1.0),
    "named": (3.0, 1.5),
    "rest": (1.0, 1.0),
    "noise": (1.0, 1.0),
}
"""Dash, gap, ... in widths of the line; lines that are not named are solid."""

WIDTHS = {
    **{"measured": 3.0, "nominal": 2.4, "refitted": 2.4, "calibrated": 2.0},
    **{"lack": 2.4, "named": 2.0, "rest": 2.0},
}
"""Widths of lines; those not named are thinner, and show what lies below."""
