"""Machine-code loops over the one physics, each behind a typed function.

A module holds the loops of a `Family` or two as plain text of Python, and below them
the functions that others call: they allocate what the loops write. Nothing else in the
library calls numba.

kernel: what compiles. runge_kutta: the step that all loops share. jacobian: exact
slopes. rollouts, closed_loop: batches of gliders under tapes and under feedback.
replay: flights along a log. actuators: an elevator behind a user's own actuator. ekf,
riccati, sampling: the loops of the filter and of the planners. points: a glider
along a collocated path. collocation, stages, barrier, interior_point: the solver of
direct collocation, compiled once for all gliders.
"""
