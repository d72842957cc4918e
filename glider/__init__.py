"""A toolkit for a planar glider that perches, on Drake: what people use first.

A name is imported from its module when it is first asked for. So ``import glider``
costs next to nothing, and pydrake and numba load when something needs them.
"""

import importlib
from typing import TYPE_CHECKING

_HOMES = {
    "EffectKind": "glider.physics.effects",
    "GliderModel": "glider.physics.model",
    "GliderPlant": "glider.systems.plant",
    "PerchingProblem": "glider.planning.problem",
    "close_the_loop": "glider.sysid.pipeline",
    "fly": "glider.simulation.fly",
    "load_model": "glider.physics.model",
    "plan": "glider.planning.dircol",
}
"""Name to the module that it is imported from."""

__all__ = list(_HOMES)

if TYPE_CHECKING:  # The same names, for mypy and editors.
    from glider.physics.effects import EffectKind
    from glider.physics.model import GliderModel, load_model
    from glider.planning.dircol import plan
    from glider.planning.problem import PerchingProblem
    from glider.simulation.fly import fly
    from glider.sysid.pipeline import close_the_loop
    from glider.systems.plant import GliderPlant
else:

    def __getattr__(name):
        """Returns one of the names above; Python asks once, as it is kept."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(_HOMES[name]), name)
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*globals(), *_HOMES})
