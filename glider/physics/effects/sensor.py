"""Effects of the sensors: how the log differs from the flight."""

import numpy as np

from glider.physics.effects.effect import Coefficient, EffectKind
from glider.physics.formulas import scalar


@scalar
def _marker_offset(flow, ahead, above):
    return (
        ahead * flow.cos_pitch + above * flow.sin_pitch,
        above * flow.cos_pitch - ahead * flow.sin_pitch,
    )


@scalar
def _pose_latency(flow, latency):
    return -latency * flow.xdot, -latency * flow.zdot, -latency * flow.pitchdot


@scalar
def _frame_tilt(flow, angle):
    turned_x = flow.x * np.cos(angle) + flow.z * np.sin(angle)
    turned_z = flow.z * np.cos(angle) - flow.x * np.sin(angle)
    return turned_x - flow.x, turned_z - flow.z, angle


@scalar
def _position_scale(flow, x, z):
    return x * flow.x, z * flow.z


@scalar
def _pitch_offset(flow, angle):
    return angle


@scalar
def _angle_sign(flow, pitch, elevator, command):
    return (pitch - 1.0) * flow.pitch


def _replay_latency(replay, latency):
    return replay._replace(latency=latency)


MARKER_OFFSET = EffectKind(
    kind="marker_offset",
    stage="sensor",
    adds_to=("pose_x", "pose_z"),
    coefficients=(
        Coefficient(name="ahead", unit="m", scale=0.02, lower=-0.5, upper=0.5),
        Coefficient(name="above", unit="m", scale=0.02, lower=-0.5, upper=0.5),
    ),
    formula=_marker_offset,
    words="a tracked point away from the center of mass",
    depends_on=("pitch", "pitchdot"),
)
"""Marker offset: the tracked point lies `ahead` along the body axis and `above`
along its normal."""

POSE_LATENCY = EffectKind(
    kind="pose_latency",
    stage="sensor",
    adds_to=("pose_x", "pose_z", "pose_pitch"),
    coefficients=(
        Coefficient(name="latency", unit="s", scale=0.02, lower=-0.2, upper=0.2),
    ),
    formula=_pose_latency,
    replay=_replay_latency,
    words="a pose that is logged late relative to elevator and command",
    depends_on=("elevator_rate", "pitchdot"),
)
"""Pose latency: the pose logged at t is that of t - latency. The formula is the first
order of this; the replay of a log shifts the clocks exactly instead."""

FRAME_TILT = EffectKind(
    kind="frame_tilt",
    stage="sensor",
    adds_to=("pose_x", "pose_z", "pose_pitch"),
    coefficients=(
        Coefficient(name="angle", unit="rad", scale=0.03, lower=-0.5, upper=0.5),
    ),
    formula=_frame_tilt,
    words="a motion-capture frame that is not level",
    depends_on=("V", "pitch"),
)
"""Frame tilt: the whole pose is measured in a frame turned by -angle about +y, so that
the logged pitch is larger by the angle."""

POSITION_SCALE = EffectKind(
    kind="position_scale",
    stage="sensor",
    adds_to=("pose_x", "pose_z"),
    coefficients=(
        Coefficient(name="x", unit="-", scale=0.03, lower=-0.5, upper=0.5),
        Coefficient(name="z", unit="-", scale=0.03, lower=-0.5, upper=0.5),
    ),
    formula=_position_scale,
    words="lengths that the motion capture measures too large or too small",
    depends_on=("V",),
)
"""Position scale: logged x and z are 1 + `x` and 1 + `z` times the true ones, as with
cameras calibrated with a wrong length. Gravity scales with z and reveals the error."""

PITCH_OFFSET = EffectKind(
    kind="pitch_offset",
    stage="sensor",
    adds_to=("pose_pitch",),
    coefficients=(
        Coefficient(name="angle", unit="rad", scale=0.03, lower=-0.7, upper=0.7),
    ),
    formula=_pitch_offset,
    words="a constant error of the pitch reading",
    depends_on=("alpha", "V"),
)
"""Pitch offset: the logged pitch is the true pitch plus the angle."""

ANGLE_SIGN = EffectKind(
    kind="angle_sign",
    stage="log",
    adds_to=("pose_pitch",),
    coefficients=(
        Coefficient(name="pitch", unit="-", default=1.0, lower=-1.0, upper=1.0),
        Coefficient(name="elevator", unit="-", default=1.0, lower=-1.0, upper=1.0),
        Coefficient(name="command", unit="-", default=1.0, lower=-1.0, upper=1.0),
    ),
    formula=_angle_sign,
    words="an angle that is logged with the opposite sign",
    depends_on=("pitch", "elevator"),
)
"""Angle sign: logged pitch, elevator and elevator-rate command are ±1 times the true
values."""
