"""A figure, specified once: panels of lines, bands and points, with their axes.

`as_page` makes of it what `static/page.js` draws. A mark has the
colour, width and dash of its key (see `style`), which is also its legend entry. Texts
are plain, but for symbols with a subscript: "$C_n$". `hover` is what is said of a point
under the cursor, a template with plotly's placeholders.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from glider.report.plots.style import DASHES, WIDTHS


@dataclasses.dataclass(frozen=True)
class Axis:
    """An axis of a panel."""

    label: str = ""  #: With its unit.
    range: tuple[float, float] | None = None  #: What it shows at first; all if None.
    _: dataclasses.KW_ONLY
    is_log: bool = False
    link: str = ""  #: Axes of a figure with the same link are zoomed together.


@dataclasses.dataclass(frozen=True)
class Line:
    """A line; NaN breaks it."""

    key: str
    x: np.ndarray  #: (n,)
    y: np.ndarray  #: (n,)
    _: dataclasses.KW_ONLY
    hover: str = "%{x:.3r}: %{y:.3r}"
    extra: np.ndarray | None = None  #: (n,) a further number for `hover`.
    width: float | None = None  #: By default that of the key.
    opacity: float = 1.0
    has_dots: bool = False  #: At its points.
    is_solid: bool = False  #: Without the dashes of its key.

    @property
    def line_width(self) -> float:
        """Width of the line, its own or that of its key."""
        return WIDTHS.get(self.key, 1.6) if self.width is None else self.width

    @property
    def dashes(self) -> tuple[float, ...]:
        """Dash, gap, ... in widths of the line; none where it is solid."""
        return () if self.is_solid else DASHES.get(self.key, ())


@dataclasses.dataclass(frozen=True)
class Band:
    """The area between two lines over the same places x."""

    key: str
    x: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclasses.dataclass(frozen=True)
class Points:
    """Single points."""

    key: str
    x: np.ndarray  #: (n,)
    y: np.ndarray  #: (n,)
    _: dataclasses.KW_ONLY
    hover: str = "%{x:.3r}: %{y:.3r}"  #: Empty for nothing.
    size: float = 7.0  #: In pixels.
    opacity: float = 1.0
    names: Sequence[str] = ()  #: For `hover`.
    flight: np.ndarray | None = None  #: (n,) index into the flights to pick from.
    time: np.ndarray | None = None  #: (n,) of each point [s], for the same.


@dataclasses.dataclass(frozen=True)
class Level:
    """A thin horizontal line across a panel."""

    value: float = 0.0
    is_dotted: bool = False


@dataclasses.dataclass(frozen=True)
class Ground:
    """A pale background over a span of x, or of y."""

    start: float
    end: float
    along: str = "x"
    key: str = "soft"


Mark = Line | Band | Points | Level | Ground


@dataclasses.dataclass(frozen=True)
class Panel:
    """One pair of axes and its marks, from the bottom up."""

    title: str
    marks: Sequence[Mark]
    x: Axis = Axis()
    y: Axis = Axis()
    _: dataclasses.KW_ONLY
    height: int = 270  #: In pixels of the page.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Choice:
    """Panels that are shown on request, or from the start."""

    label: str
    note: str
    panels: Sequence[Panel]
    is_shown: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class Figure:
    """Panels with one legend."""

    keys: Mapping[str, str] = dataclasses.field(default_factory=dict)  #: To labels.
    panels: Sequence[Panel] = ()  #: That are always shown.
    choices: Sequence[Choice] = ()  #: Of which the reader of a page shows some.
    flights: Sequence[str] = ()  #: Of which the reader of a page may pick one.
    least_width: float = 18.5  #: Of a panel of a page, in its letters [rem].
