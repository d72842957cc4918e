"""The article's exercises, each worked through with the packages below.

basis: accelerations by a few features each. coefficients, flight_weights: a learned
residual of the coefficients. learning, low_reynolds: plan, fly, learn, plan again.
filter_study, cruising: parameters estimated in flight. van_der_pol, planar: regions of
attraction.
"""
