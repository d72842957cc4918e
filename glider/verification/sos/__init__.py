"""Sums of squares on the unit sphere, their programs, and exact arithmetic.

sphere: polynomials on the sphere and their Gram matrices. forms: forms of several
variables and changes of these, in doubles and exactly. programs: semidefinite programs
by Drake, in another process. exact: arrays of exact numbers, and polynomials of them in
time.
"""
