"""Certificates: funnels about a plan by sums of squares, checked exactly.

nominal, jets, error_dynamics, between: the one physics, expanded about a flight.
sphere, forms, programs, solving, grams: sums of squares on a sphere, solved in other
processes. settings, limits, remainder, shape_flow, descent, ascent, build: a funnel is
shaped, scaled and certified. exact, check: the certificate, without a solver. attack:
the attempt to break it. funnel, file, monitor: what is kept, and used in a diagram.
"""
