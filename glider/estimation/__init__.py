"""Estimation: extended Kalman filters for gliders, and what proves them consistent.

ekf: the filter as numbers. running: beliefs, and the filter along whole flights.
system: the same as a Drake System. flights: noisy flights for a filter to watch.
consistency: NEES and NIS. perching: the filter that perches. knowledge: what a flight
could tell about a number.
"""
