"""Estimation: extended Kalman filters for gliders.

ekf: the filter's settings. running: beliefs, and the filter along whole flights.
perching: the filter for perches.
"""
