"""Trials: flights of the full dynamics that try to falsify a funnel, and prove nothing.

falsify: from the boundary, climbing to the worst launch and the worst glider; and from
inside. as_flown: with held and late commands, in wind. estimated: how much
estimation error a funnel tolerates.
"""
