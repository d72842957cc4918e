"""Flights by compiled code: `fly(model, policy, starts)` returns `Flights`.

fly: the simulator, and sweeps of very many launches. flown_flights: its results.
campaigns: logs of flights with a known truth. refly: logged flights flown again by
models.
"""
