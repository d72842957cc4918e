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
    times, free = np.array([0.0, 0.01, 0.02]), np.zeros(0, dtype=np.int64)
    nodes = np.zeros((3, n))
    nodes[:, 4] = 7.0
    path, rate, pitch = np.zeros((2, 3)), np.zeros(2), np.zeros((2, 3, 2))
    wind, bank = np.zeros((2, 2)), np.ones(2)
    along = path, rate, wind, bank
    model = theta, NO_FIELD
    moved, sizes = theta[None][:0].copy(), np.zeros(0)
    replay.with_extras(kinds, times, nodes, path, rate, *model)
    replay.slopes_along(kinds, times, nodes, *along, theta, moved, sizes, NO_FIELD)
    replay.measure_nodes(kinds, nodes, theta, free, layout.scale)
    replay.translate(kinds, times, nodes[0], pitch, *along, *model)
    replay.flow_at(kinds, times, nodes, np.zeros(3), np.zeros(3), theta, NO_FIELD)
