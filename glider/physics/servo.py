"""What a servo makes of a rate command at its rate limit and near its stops.

One formula for the diagram's ElevatorServo and for the compiled closed loop.
"""

from glider.physics.formulas import scalar

STOPPING_TIME = 0.005
"""τ: how the servo slows down before a stop [s]. At 13 rad/s it does so over the
last 0.065 rad; at the 3.4 rad/s of the article's plan over 0.017 rad, and that
plan stays 0.3 rad away from its stops."""


@scalar
def limited_rate(command, elevator, low, high, rate_limit):
    """Returns the elevator rate that the servo makes of a command [rad/s].

    The command, clipped to the rate limit and to what keeps the elevator φ
    between its stops: [(low - φ) / τ, (high - φ) / τ]. So the elevator comes
    to a stop as exp(-t / τ), and the rate is a Lipschitz function of φ, which
    integrators and the compiled loop need. An elevator beyond a stop returns.

    Takes floats and AutoDiffXd, and numba compiles it.

    Args:
        command: [rad/s].
        elevator: φ [rad].
        low: stop of the trailing edge down [rad].
        high: stop of the trailing edge up [rad].
        rate_limit: [rad/s].
    """
    top = max(min((high - elevator) / STOPPING_TIME, rate_limit), -rate_limit)
    bottom = max((low - elevator) / STOPPING_TIME, -rate_limit)
    return min(max(command, bottom), top)
