"""Feedback: along a plan, and by planning again.

tvlqr_drake: finite-horizon LQR by Drake. tvlqr: the same gains by compiled code, as a
table over time. mppi: a controller that samples. mpc: one that plans by collocation.
predictor: held commands, and what makes up for their latency.
"""
