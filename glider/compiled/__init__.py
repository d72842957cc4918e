"""Loops over the dynamics, which `glider.compiled.kernel` compiles with the chain.

Each takes arrays and writes into arrays. A family, a module of this package, is
compiled and kept on disk apart from the others, so that an edit of one leaves
the others' machine code valid. It names, callees first,

    LOOPS: the functions whose text is compiled behind that of `glider.physics.chain`,
        so that `derivatives` means the glider with its effects;
    ENTRIES: those of them that are called from Python;
    USES: entries of other families that they call, shared in machine code.
"""

from glider.compiled import (
    closed_loop,
    ekf,
    ilqr,
    jacobian,
    replay,
    riccati,
    rollouts,
    sampling,
)

FAMILIES = (rollouts, jacobian, riccati, closed_loop, replay, ekf, sampling, ilqr)
