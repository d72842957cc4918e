"""The physics expanded about a nominal flight, with several kinds of number.

nominal: the flight that a funnel is about, and Taylor polynomials of deviations from
it. defect: what it lacks to be a flight. confidence: the set of gliders that the data
allow. moving_center: where they fly, to first order. Kinds of number that go through
`glider.physics.compose`: arithmetic (their base, and what a formula depends on), jets
(truncated Taylor polynomials), taylor_models (with a proven remainder bound).
"""
