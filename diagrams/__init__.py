"""Functions that wire the library's systems into Drake diagrams: the public names.

A name is imported from its module when it is first asked for.
"""

from typing import TYPE_CHECKING

from glider.lazy import attach

if TYPE_CHECKING:
    import diagrams.playback as playback
    from diagrams.loops import closed_loop, estimated_loop, open_loop
    from diagrams.scene import AddScene
    from diagrams.simulate import simulate_flights
    from diagrams.tube import draw_tube, plot_tube
else:
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
