"""Sums of squares on the unit sphere, their programs, and exact arithmetic.

forms: V̇/V on the boundary of an ellipsoid, in the coordinates of the unit ball. sphere:
polynomials on the sphere and their Gram matrices. programs, solving: semidefinite
programs through Drake, in other processes. grams: a Gram matrix from a neighbor's,
without a solver. exact, exact_forms: matrices and forms in whole numbers.
"""
