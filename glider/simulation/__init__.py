"""Flights by compiled code: `fly(model, policy, starts)` returns `Flights`.

fly: the simulator. flown_flights: its results. miss: distances from the wire.
monte_carlo: many launches, and sweeps over cases. campaigns: logs of flights with a
known truth. refly: logged flights flown again by models.
"""
