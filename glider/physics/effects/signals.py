"""Effects of servo and sensors: how the elevator and the log differ from commands.

Formulas of the servo take the incoming rate instead of a Flow and return the outgoing
one. Where a log is replayed, `glider.compiled.actuators` solves the same laws exactly.
"""

import numpy as np

from glider.physics.effects.effect import Coefficient, EffectKind, constant
from glider.physics.formulas import scalar

_POSITIONS = ("measured x over x and z", "measured z over x and z")


@scalar
def _servo_lag(rate, lagged, time_constant):
    return lagged


@scalar
def _servo_lag_rate(rate, lagged, time_constant):
    return (rate - lagged) / time_constant


@scalar
def _servo_lag_steady(rate, time_constant):
    return rate


@scalar
def _servo_lag_pending(lagged, time_constant):
    return time_constant * lagged


@scalar
def _command_delay(rate, first, second, delay):
    return rate - 12.0 / delay * second


@scalar
def _command_delay_rate(rate, first, second, delay):
    return second, rate - 12.0 / (delay * delay) * first - 6.0 / delay * second


@scalar
def _command_delay_steady(rate, delay):
    return rate * delay * delay / 12.0, 0.0 * rate


@scalar
def _command_delay_pending(first, second, delay):
    return 12.0 / delay * first


def _replay_lag(replay, time_constant):
    return replay._replace(time_constant=time_constant)


def _replay_delay(replay, delay):
    return replay._replace(delay=delay)


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
def _angle_sign(flow, pitch, elevator, command):
    return (pitch - 1.0) * flow.pitch


def _replay_latency(replay, latency):
    return replay._replace(latency=latency)


SERVO_LAG = EffectKind(
    kind="servo_lag",
    stage="actuator",
    adds_to=(),
    coefficients=(
        Coefficient(
            "time_constant", "s", scale=0.03, lower=0.0, upper=0.5, grid=(0.005, 0.03)
        ),
    ),
    formula=_servo_lag,
    words="a slow servo (first-order lag)",
    depends_on=("elevator_rate", "elevator"),
    states=("servo_rate",),
    state_rate=_servo_lag_rate,
    steady_state=_servo_lag_steady,
    pending=_servo_lag_pending,
    replay=_replay_lag,
    is_likely=True,
)
"""Servo lag: the elevator rate r follows the command u as τ ṙ = u - r. The angle
then follows the integrated command with the same lag."""

COMMAND_DELAY = EffectKind(
    kind="command_delay",
    stage="actuator",
    adds_to=(),
    coefficients=(
        Coefficient(
            "delay", "s", scale=0.025, lower=0.0, upper=0.3, grid=(0.005, 0.025)
        ),
    ),
    formula=_command_delay,
    words="a delay between command and servo",
    depends_on=("elevator_rate", "elevator"),
    states=("delay_first", "delay_second"),
    state_rate=_command_delay_rate,
    steady_state=_command_delay_steady,
    pending=_command_delay_pending,
    replay=_replay_delay,
)
"""Command delay: r(t) = u(t - T). A plant has finitely many states and therefore uses
the second-order Padé approximant (1 - sT/2 + s²T²/12) / (1 + sT/2 + s²T²/12); a log is
replayed with the exact delay."""

MARKER_OFFSET = EffectKind(
    kind="marker_offset",
    stage="sensor",
    adds_to=("pose_x", "pose_z"),
    coefficients=(
        Coefficient("ahead", "m", scale=0.02, lower=-0.5, upper=0.5),
        Coefficient("above", "m", scale=0.02, lower=-0.5, upper=0.5),
    ),
    formula=_marker_offset,
    words="a tracked point away from the center of mass",
    depends_on=("pitch", "pitchdot"),
    needs=("wing_offset",),  # Errors of the moment look like a point ahead.
    families=_POSITIONS,
)
"""Marker offset: the tracked point lies `ahead` along the body axis and `above`
along its normal."""

POSE_LATENCY = EffectKind(
    kind="pose_latency",
    stage="sensor",
    adds_to=("pose_x", "pose_z", "pose_pitch"),
    coefficients=(Coefficient("latency", "s", scale=0.02, lower=-0.2, upper=0.2),),
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
    coefficients=(Coefficient("angle", "rad", scale=0.03, lower=-0.5, upper=0.5),),
    formula=_frame_tilt,
    words="a motion-capture frame that is not level",
    depends_on=("V", "pitch"),
    families=_POSITIONS,
)
"""Frame tilt: the whole pose is measured in a frame turned by -angle about +y, so that
the logged pitch is larger by the angle."""

POSITION_SCALE = EffectKind(
    kind="position_scale",
    stage="sensor",
    adds_to=("pose_x", "pose_z"),
    coefficients=(
        Coefficient("x", "-", scale=0.03, lower=-0.5, upper=0.5),
        Coefficient("z", "-", scale=0.03, lower=-0.5, upper=0.5),
    ),
    formula=_position_scale,
    words="lengths that the motion capture measures too large or too small",
    depends_on=("V",),
    needs=("mass", "wing_area"),  # Longer flights are like a smaller wing.
    is_rare=True,
    families=_POSITIONS,
)
"""Position scale: logged x and z are 1 + `x` and 1 + `z` times the true ones, as with
cameras calibrated with a wrong length. Gravity scales with z and reveals the error."""

PITCH_OFFSET = EffectKind(
    kind="pitch_offset",
    stage="sensor",
    adds_to=("pose_pitch",),
    coefficients=(Coefficient("angle", "rad", scale=0.03, lower=-0.7, upper=0.7),),
    formula=constant,
    words="a constant error of the pitch reading",
    depends_on=("alpha", "V"),
    like=("angle_sign",),
    varies_by="pitch_zero",
    families=("measured pitch over pitch",),
)
"""Pitch offset: the logged pitch is the true pitch plus the angle."""

ANGLE_SIGN = EffectKind(
    kind="angle_sign",
    stage="log",
    adds_to=("pose_pitch",),
    coefficients=(
        Coefficient("pitch", "-", default=1.0, lower=-1.0, upper=1.0),
        Coefficient("elevator", "-", default=1.0, lower=-1.0, upper=1.0),
        Coefficient("command", "-", default=1.0, lower=-1.0, upper=1.0),
    ),
    formula=_angle_sign,
    words="an angle that is logged with the opposite sign",
    depends_on=("pitch", "elevator"),
)
"""Angle sign: logged pitch, elevator and elevator-rate command are ±1 times the true
values."""
