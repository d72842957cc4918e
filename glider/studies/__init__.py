"""The article's exercises, each worked through with the packages below.

basis: accelerations by a few features each. coefficients, flight_weights and
residual_study: a learned residual of the coefficients. learning, learning_study and
low_reynolds: plan, fly, learn, plan again. filter_study, filter_flights and cruising:
parameters estimated in flight. searches: plans without gradients. van_der_pol, planar:
regions of attraction.
"""
