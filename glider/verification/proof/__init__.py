"""The proof of a funnel, without a solver and without trust in how it was made.

docs/certificate.md has the theorem, its proof and what is assumed.

check: the verdict about a certificate. purpose: whether it is of the intended problem
and glider. flight_proof: that no flight leaves, interval by interval. interval_proof:
one of them. interval: its polynomials in time, its servo, a ball that holds its sets,
and the centers of a set of gliders. interval_growth: that V falls. enclosure, boxes:
that the Taylor remainder is within the bounds that the certificate assumes. held: what
held commands are off by. latency, slopes: what predicted ones are.

The theorem follows where a funnel passes `check_funnel` with a problem and
`prove_flights` is whole. After `check_funnel` alone R is only sampled, and with every
> 1 nothing follows for a whole flight.

Exact: that sets are ellipsoids, that the servo follows its command, that balls hold the
sets, and that V falls; at the end, E(T) in the goal to 1e-9.
Enclosed, rounding included: R (Taylor models on boxes of deviations and time) and the
nominal's defect in the linear rates (Taylor models in time).
Floating point: the launch, the wire and the problem's bounds are compared to 1e-6 and
1e-4, the goal about the gliders' centers to 1e-9; the coefficients of the linear rates
(positions, pitch, elevator) are taken as computed, so that their rounding, 1e-16 of
them, is omitted, and so is that of the cubic polynomials' coefficients.
"""
