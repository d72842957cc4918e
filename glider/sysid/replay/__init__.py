"""Replay of a log by a model: its errors and their derivatives.

log_space: the numbers of a glider whose logs are replayed. record: the data of a fit,
and its noise. vehicle: which parameters are known, and which effects logs can show.
replayed: elevator, true states and residual.
"""
