"""Verification: funnels about a plan by sums of squares, checked in exact arithmetic.

A funnel is a tube of states about a flight that the closed loop does not leave.
dynamics: the physics, expanded about a nominal flight. sos: sums of squares on a
sphere, and exact arithmetic. funnel: makes funnels, saves and loads them. proof: checks
one without a solver. trials: tries to falsify one with flights. monitor: a Drake System
that distinguishes inside from outside. check_report: what was checked, in sentences.

Shapes in docstrings: T times, n states, M monomials up to order 3, C₃ and C₄ monomials
of degree 3 and 4 and C of both, E entries of a Gram matrix's lower triangle and s of
its rows, B points, flights or boxes.
"""
