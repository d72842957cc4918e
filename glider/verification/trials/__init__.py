"""Trials of a funnel by flights: nothing here is proved.

flights: the glider under a funnel's feedback. falsify: the attempt to find a flight
that leaves; falsify_set: the same with all gliders that the data allow; words: what
came of that. estimated: how much estimation error a funnel bears.
"""
