"""Funnels: what one is, and how one is made from a feedback.

funnel: a Funnel and its file. settings: what is asked for. build: makes one, by
shape_flow (the shapes, backward from the goal), scaling (how large they may be) and a
Gram matrix at each time. On the way: growth (V̇/V on the boundary), ascent (largest
values on a sphere), sizes (which deviations count), limits (what the servo can do),
remainder (what the Taylor polynomials leave out).
"""
