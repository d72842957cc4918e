"""Replay of a log by a model: its errors and their derivatives.

smoothing: noise and smooth signals. record: the data of a fit. vehicle: which of its
parameters are known. replayed: elevator, true states and residual.
"""
