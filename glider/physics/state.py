"""State, input and frame of the planar glider; the one place of the signs.

Axes: x forward, z up [m]. All angles turn about +y (right-handed, y to the
left), as Drake's pitch does, so **positive pitch is nose down** and positive
elevator is trailing edge up, which pitches the nose up. The angle of attack is
atan2(-zdot, xdot) - pitch, positive when the nose is above the velocity.
"""

STATE_NAMES = ("x", "z", "pitch", "elevator", "xdot", "zdot", "pitchdot")
"""Position [m], angles [rad], then their rates [m/s, rad/s]; the elevator's
rate is the input."""

POSE_NAMES = ("x", "z", "pitch")
"""States that motion capture measures [m, m, rad]."""

NUM_STATES = len(STATE_NAMES)

PITCH = STATE_NAMES.index("pitch")
"""Index of the pitch."""

ELEVATOR = STATE_NAMES.index("elevator")
"""Index of the elevator's angle."""

POSITION = [STATE_NAMES.index("x"), STATE_NAMES.index("z")]
"""Indices of the position."""

VELOCITY = [STATE_NAMES.index("xdot"), STATE_NAMES.index("zdot")]
"""Indices of the velocity."""
