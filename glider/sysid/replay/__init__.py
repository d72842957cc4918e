"""A log flown again by a model: its errors, and their slopes by every number.

noise, smoothing: clean signals. signs: angles turned back. attitude: roll and yaw.
record: what a fit is handed. theta, vehicle: what the numbers are, and which are known.
signals, nodes: elevator and sensors. residual: accelerations that a model lacks.
"""
