"""The physics expanded about a nominal flight, by numbers of several kinds.

nominal: the flight that a funnel is about. nominal_path: it and its slopes between its
times. defect: how far that is from a flight, enclosed in continuous time.
confidence: the set of numbers that the data allow. gliders: those that deviate from a
model so. moving_center: where they fly, to first order.
error_dynamics: Taylor polynomials of how a deviation from it evolves. Kinds of number
that go through `glider.physics.compose`, all on arithmetic: jets (truncated
Taylor polynomials), taylor_models (with a proven bound of their remainder), dependence
(what a formula depends on).
"""
