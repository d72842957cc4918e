"""Estimation: extended Kalman filters for gliders, and checks of their consistency.

ekf: the filter's settings. running: beliefs, and the filter along whole flights.
system: the filter as a Drake System. noisy_flights: flights with the filter's noise,
and the least covariance that a flight allows. consistency: NEES and NIS. perching: the
filter for perches.
"""
