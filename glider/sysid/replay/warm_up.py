"""Compiles what flying logs takes, before the clock of a stage runs."""

import numpy as np

from glider.physics.effects import NO_FIELD
from glider.physics.parameters import GliderParameters
from glider.sysid.replay.theta import (
    LIBRARY_LAYOUT,
    Layout,
)


def warm_up(layout: Layout = LIBRARY_LAYOUT) -> None:
    """Compiles the loops, or loads them where they have been compiled before."""
    loops = layout.kernel
    theta = layout.dynamics(layout.default_theta(GliderParameters()))
    times, free = np.array([0.0, 0.01, 0.02]), np.zeros(0, dtype=np.int64)
    n = layout.num_states
    nodes = np.zeros((3, n))
    nodes[:, 4] = 7.0
    path, rate, pitch = np.zeros((2, 3)), np.zeros(2), np.zeros((2, 3, 2))
    states, ends = np.empty_like(nodes), np.empty_like(nodes[1:])
    by_x, none = np.empty((3, n, n)), np.empty((3, n, 0))
    field, scale = NO_FIELD, layout.scale
    loops.log_extras(times, nodes, path, rate, theta, field)
    loops.log_advance(times, nodes, path, rate, theta, field, ends)
    loops.log_shoot(
        times, nodes, path, rate, theta, free, scale, field, ends, by_x[:2], none[:2]
    )
    loops.log_propagate(by_x[:2], none[:2], np.empty((3, n, n)))
    loops.log_measure(
        nodes,
        theta,
        free,
        scale,
        states[:, :3].copy(),
        by_x[:, :3].copy(),
        none[:, :3].copy(),
    )
    loops.log_rollout(times, nodes[0], path, rate, theta, field, states)
    loops.log_translation(times, nodes[0], pitch, path, rate, theta, field, states)
    loops.log_flow(
        times, nodes, np.zeros(3), np.zeros(3), theta, field, np.empty((3, 9))
    )
