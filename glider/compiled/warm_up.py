"""Compiling the loops of the tracer, before the first log needs them."""

import numpy as np

from glider.compiled import filter_error, replay
from glider.physics.effects import NO_GAUSSIANS
from glider.physics.parameter_space import ParameterSpace
from glider.physics.parameters import GliderParameters


def warm_up(space: ParameterSpace) -> None:
    """Compiles the loops, or loads them where they have been compiled before.

    Args:
        space: of the glider that logs are replayed with.
    """
    _warm_up_filter()
    kinds = space.flown
    theta = space.pack(GliderParameters())
    nodes = np.zeros((3, space.num_states))
    nodes[:, 4] = 7.0
    times = 0.01 * np.arange(3.0)
    elevator = np.zeros((2, 3))
    path = replay.log_path(times, elevator, np.zeros(2))
    replay.measure_nodes(kinds, nodes, theta)
    replay.roll_out(kinds, path, nodes[0], theta, NO_GAUSSIANS)
    at_rest = np.zeros(3)
    replay.flow_at(kinds, path.times, nodes, at_rest, at_rest, theta, NO_GAUSSIANS)


def _warm_up_filter() -> None:
    """Compiles the loops that are the same for all gliders."""
    flight = filter_error.no_flight()
    filter_error.filter_flight(*flight)
    filter_error.smooth_flight(*np.zeros((5, 0)), *flight)
