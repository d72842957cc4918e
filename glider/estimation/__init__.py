"""Estimation: extended Kalman filters for gliders.

ekf: the filter's settings. running: beliefs, and the filter along whole flights.
system: the filter as a Drake System. perching: the filter for perches.
"""
