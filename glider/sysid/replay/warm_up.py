"""Compiles what flying logs takes, before the clock of a stage runs."""

import numpy as np

from glider.compiled import filter_error, replay
from glider.physics.effects import NO_FIELD
from glider.physics.parameters import GliderParameters
from glider.sysid.replay.theta import LIBRARY_LAYOUT, Layout


def warm_up(layout: Layout = LIBRARY_LAYOUT) -> None:
    """Compiles the loops, or loads them where they have been compiled before."""
    filter_error.filter_flight(*filter_error.no_flight())
    kinds, n = layout.compiled_kinds, layout.num_states
    theta = layout.dynamics(layout.default_theta(GliderParameters()))
    times = np.array([0.0, 0.01, 0.02])
    nodes = np.zeros((3, n))
    nodes[:, 4] = 7.0
    path = replay.log_path(times, np.zeros((2, 3)), np.zeros(2))
    replay.with_extras(kinds, path, nodes, theta, NO_FIELD)
    replay.advance_nodes(kinds, path, nodes, theta, NO_FIELD)
    replay.measure_nodes(kinds, nodes, theta)
    replay.roll_out(kinds, path, nodes[0], theta, NO_FIELD)
    replay.flow_at(kinds, times, nodes, np.zeros(3), np.zeros(3), theta, NO_FIELD)
