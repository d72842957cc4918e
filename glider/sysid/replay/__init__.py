"""Replay of a log by a model: its errors and their derivatives.

record: the data of a fit, and its noise. vehicle: which parameters are known.
replayed: elevator, true states and residual.
"""
