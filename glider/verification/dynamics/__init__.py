"""The physics expanded about a nominal flight, with several kinds of number.

nominal: the flight that a funnel is about, and Taylor polynomials of deviations from
it. defect: what it lacks to be a flight. moving_center: where the gliders of a set fly,
to first order. Kinds of number that go through `glider.physics.compose`: jets (their
base, what a formula depends on, and truncated Taylor polynomials), taylor_models (with
a proven remainder bound).
"""
