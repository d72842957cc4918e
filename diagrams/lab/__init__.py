"""A session in the lab: throws come into a folder, and the loop is closed as they do.

`command` is `python -m glider lab`; `session` does the work, and runs without a page.
"""

from typing import TYPE_CHECKING

from glider.lazy import attach

if TYPE_CHECKING:
    from diagrams.lab.simulated import fly_session
else:
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
