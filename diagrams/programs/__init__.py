"""Programs about diagrams: their options and pages, live throws, sessions in the lab.

program: steps that all examples take. page: a page that shows a Meshcat. station:
`glider fly`. lab: `glider lab`. The public names are imported from their modules when
they are first asked for.
"""

from typing import TYPE_CHECKING

from glider.lazy import attach

if TYPE_CHECKING:
    import diagrams.programs.program as program
else:
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
