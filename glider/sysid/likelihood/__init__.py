"""The likelihood of flights: sensor noise, moving air, and what differs per flight.

directions: what may be wrong, as columns. linear_flight: a flight linear in all of
them. scales: how strong each noise is. model_fit: everything fitted together.
candidates, evidence: what else may be wrong, and which of it explains the flights.
curves: what formulas get wrong.
"""
