"""Figures of a report, drawn into axes: arrays and an `ax` in, nothing out.

One palette and one name for each model in all figures. No pyplot, so no global
state and no window. Angles are in degrees here, at the edge; all else stays SI.
"""
