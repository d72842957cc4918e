"""Verification: funnels about a plan by sums of squares, checked in exact arithmetic.

A funnel is a tube of states about a flight that the closed loop does not leave.
dynamics: the physics, expanded about a nominal flight. sos: sums of squares on a
sphere, and exact arithmetic. funnel: makes funnels, saves and loads them. proof: checks
one without a solver. trials: tries to falsify one with flights.

Shapes in docstrings: T times, n states, M monomials up to order 3, C₃ and C₄ monomials
of degree 3 and 4 and C of both, odd then even, E entries of a Gram matrix's lower
triangle and s of its rows, B points, flights or boxes, m numbers that deviate and r
dimensions of their set. Arguments of these names are the same everywhere, with one more
axis where there are several:

    S (n, n), slopes (n, n)       matrices of sets eᵀ S e <= 1, and Ṡ
    beta (n,), weights (n,)       bounds β of the Taylor remainder, and their λ
    coefficients (n, M)           Taylor polynomials of ė, `Nominal.closed_loop`
    quadratic (n, n), cubic (C₃,), quartic (C₄,)    zᵀ N z, c₃, c₄ on the boundary
    directions (n,), bounds ()    a and b of limits |aᵀ e| <= b
    states, errors (n,)           x, and deviations e from the nominal
    center                        of the gliders of a set; None for the model's own
    deviation (m,)                δ of a glider in that set
    at, k                         indices of times
    starts (B, n)                 points of the unit sphere where an ascent starts
    progress                      is called with the share that is done, or the stage
    seed, rng                     of what is drawn
"""
