"""Coefficients from flights: fits, their information, and what they leave.

output_error: the joint fit. information: what one flight knows, as a matrix. field_fit:
a residual field. whiteness: is anything left? prediction: errors on held-out flights.
regression: linear models. simulate: campaigns with a known truth.
"""
