"""Feedback: along a plan, and by planning again.

tvlqr: gains along a plan by compiled code, as a table over time. mppi: a controller
that samples. mpc: one that plans by quadratic programs about the last plan. predictor:
held commands, and what makes up for their latency.
"""
