"""Functions that wire the library's systems into Drake diagrams: the public names.

A name is imported from its module when it is first asked for.
"""

import importlib
from typing import TYPE_CHECKING

_HOMES = {
    "AddScene": "diagrams.scene",
    "campaign_of_flights": "diagrams.simulate",
    "closed_loop": "diagrams.loops",
    "estimated_loop": "diagrams.loops",
    "open_loop": "diagrams.loops",
    "plot_perches": "diagrams.perch_plots",
    "serve_page": "diagrams.page",
    "simulate_flights": "diagrams.simulate",
}
"""Name to the module that it is imported from."""

_MODULES = {"playback": "diagrams.playback", "program": "diagrams.program"}
"""Name to a module that is public as a whole."""

__all__ = list(_HOMES | _MODULES)

if TYPE_CHECKING:  # The same names, for mypy and editors.
    from diagrams import playback, program
    from diagrams.loops import closed_loop, estimated_loop, open_loop
    from diagrams.page import serve_page
    from diagrams.perch_plots import plot_perches
    from diagrams.scene import AddScene
    from diagrams.simulate import campaign_of_flights, simulate_flights
else:

    def __getattr__(name):
        """Returns one of the names above; Python asks once, as it is kept."""
        if name in _MODULES:
            value = importlib.import_module(_MODULES[name])
        elif name in _HOMES:
            value = getattr(importlib.import_module(_HOMES[name]), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*globals(), *__all__})
