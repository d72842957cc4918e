"""Replay of a log by a model: its errors and their derivatives.

smoothing: noise and smooth signals. record: the data of a fit. theta, vehicle: the
parameters, and which are known. replayed: elevator, true states and residual.
"""
