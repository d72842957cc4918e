"""Machine-code loops over the one physics, each behind a typed function.

A module holds the loops of a `Family` or two as plain Python and, where several
modules call them, functions that allocate their arrays. Nothing else in the library
calls numba, except the doctor's check of the compiler.

kernel: the compiler, its cache and all that machine code depends on.
runge_kutta: the step that all loops share. jacobian: exact slopes. flight: the loop
that flies gliders, under tapes and under feedback. replay: flights along a log, with
slopes. warm_up: compiles these in advance. actuators: an elevator behind actuators.
ekf, riccati, sequence_costs: the loops of the filter, the feedback and the sampling
planners. taylor: series of functions, and Taylor models on many boxes. boxes:
polynomials on boxes in a ball.
"""
