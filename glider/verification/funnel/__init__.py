"""Funnels: what one is, and how one is made from a feedback.

funnel: a Funnel; file: its file. settings: what is asked for. build: makes one, by
shape_flow (the shapes, backward from the goal), their size and a Gram matrix at each
time. On the way: growth (V̇/V on the boundary, and its largest
value), servo_limits (what the servo can follow), remainder (what the Taylor polynomials
omit).
"""
