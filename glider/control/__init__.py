"""Feedback: along a plan, in cruise, and by planning anew.

tvlqr_drake: finite-horizon LQR by Drake. tvlqr: the same gains by compiled code.
policy: feedback as a table over time. cruise: trim, and the LQR that holds it. mppi: a
controller that samples. mpc: one that plans by collocation.
"""
