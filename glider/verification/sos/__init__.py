"""Sums of squares on the unit sphere, their programs, and exact arithmetic.

sphere: polynomials on the sphere and their Gram matrices. forms: V̇/V on the boundary of
an ellipsoid, in doubles and exactly. programs: semidefinite programs by Drake, in
another process. exact: arrays of exact numbers, and polynomials of them in time.
"""
