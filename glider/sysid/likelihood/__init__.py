"""The likelihood of flights: sensor noise, moving air, and what differs per flight.

directions: what may be wrong, as columns. linear_flight: a flight linear in all of
them. scales: how strong each noise is. gram: what flights know, as one matrix each.
"""
