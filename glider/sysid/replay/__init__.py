"""Replay of a log by a model: its errors and their derivatives.

smoothing: noise and smooth signals. signs: angles turned back. record: the data of a
fit. theta, vehicle: the parameters, and which are known. signals: elevator and true
states. residual: unmodelled accelerations.
"""
