"""The physics expanded about a nominal flight, with several kinds of number.

nominal: the flight that a funnel is about, and Taylor polynomials of deviations from
it. defect: what it lacks to be a flight. moving_center: where the gliders of a set fly,
to first order. numbers: kinds of number that go through `glider.physics.compose`, and
monomials; taylor_models: the kind that is a polynomial with a proven remainder bound.
"""
