"""Flights by compiled code: `fly(model, policy, starts)` returns `Flights`.

fly: one way to fly. flights: what became of them. miss: how far from the wire.
monte_carlo: many launches, and sweeps over cases. campaigns: logs of flights with a
known truth. refly: logged flights flown again by models.
"""
