"""Trials: flights of the full dynamics that try to falsify a funnel, and prove nothing.

funnel_flights: flies under a funnel's feedback. falsify: from the boundary, climbing to
the worst launch and the worst glider. estimated: how much estimation error a funnel
tolerates.
"""
