"""Effects of the servo: how the elevator follows a rate command.

Their formulas take the incoming rate instead of a Flow and return the outgoing
one. Replaying a log, `glider.physics.actuator_replay` solves the same equations
exactly.
"""

from glider.physics.effects.effect import Coefficient, EffectKind
from glider.physics.formulas import scalar


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
def _command_delay(rate, first, second, delay):
    return rate - 12.0 / delay * second


@scalar
def _command_delay_rate(rate, first, second, delay):
    return second, rate - 12.0 / (delay * delay) * first - 6.0 / delay * second


@scalar
def _command_delay_steady(rate, delay):
    return rate * delay * delay / 12.0, 0.0 * rate


def _replay_lag(replay, time_constant):
    return replay._replace(time_constant=time_constant)


def _replay_delay(replay, delay):
    return replay._replace(delay=delay)


SERVO_LAG = EffectKind(
    kind="servo_lag",
    stage="actuator",
    adds_to=(),
    coefficients=(
        Coefficient(
            name="time_constant",
            unit="s",
            scale=0.03,
            lower=0.0,
            upper=0.5,
            grid=(0.005, 0.03),
        ),
    ),
    formula=_servo_lag,
    words="a slow servo (first-order lag)",
    depends_on=("elevator_rate", "elevator"),
    states=("servo_rate",),
    state_rate=_servo_lag_rate,
    steady_state=_servo_lag_steady,
    replay=_replay_lag,
)
"""Servo lag: the elevator rate r follows the command u as τ ṙ = u - r. The angle
then follows the integrated command with the same lag."""

COMMAND_DELAY = EffectKind(
    kind="command_delay",
    stage="actuator",
    adds_to=(),
    coefficients=(
        Coefficient(
            name="delay",
            unit="s",
            scale=0.025,
            lower=0.0,
            upper=0.3,
            grid=(0.005, 0.025),
        ),
    ),
    formula=_command_delay,
    words="a delay between command and servo",
    depends_on=("elevator_rate", "elevator"),
    states=("delay_first", "delay_second"),
    state_rate=_command_delay_rate,
    steady_state=_command_delay_steady,
    replay=_replay_delay,
)
"""Command delay: r(t) = u(t - T). A plant has finitely many states and therefore uses
the second-order Padé approximant (1 - sT/2 + s²T²/12) / (1 + sT/2 + s²T²/12); a log is
replayed with the exact delay."""
