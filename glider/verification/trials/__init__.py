"""Trials of a funnel by flights: nothing here is proved.

flights: the glider under a funnel's feedback. falsify: the attempt to find a flight
that leaves. estimated: how much estimation error a funnel bears.
"""
