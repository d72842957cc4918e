"""A figure, specified once: panels of lines, bands, points and bars, with their axes.

`as_page` makes of it what `static/page.js` draws, `as_file` a picture. A mark has the
colour, width and dash of its key (see `palette`), which is also its legend entry. What
is said of a point under the cursor is a template with plotly's placeholders. Texts are
plain, but for symbols with a subscript: "$C_n$".
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from glider.report.plots.style import WIDTHS


@dataclasses.dataclass(frozen=True, kw_only=True)
class Axis:
    """An axis of a panel.

    Attributes:
        label: with its unit.
        range: what it shows at first; all if None.
        is_log: whether it is logarithmic.
        ticks: place to label; None for numbers.
        link: axes of a figure with the same link are zoomed together.
    """

    label: str = ""
    range: tuple[float, float] | None = None
    is_log: bool = False
    ticks: Mapping[float, str] | None = None
    link: str = ""

    @property
    def has_grid(self) -> bool:
        """Whether lines at its ticks help: at numbers, not at names."""
        return self.ticks is None or any(
            label.lstrip("-")[:1].isdigit() for label in self.ticks.values()
        )


@dataclasses.dataclass(frozen=True)
class Line:
    """A line; NaN breaks it.

    Attributes:
        key: entry of the legend.
        x: (n,).
        y: (n,).
        hover: template of what is said of a point, empty for nothing.
        extra: (n,) a further number for the template.
        width: by default that of the key.
        opacity: 0 to 1.
        has_dots: whether its points are marked.
        is_solid: whether it goes without the dashes of its key.
        flight: (n,) index into the figure's flights, where the reader may pick one.
    """

    key: str
    x: np.ndarray
    y: np.ndarray
    _: dataclasses.KW_ONLY
    hover: str = "%{x:.3r}: %{y:.3r}"
    extra: np.ndarray | None = None
    width: float | None = None
    opacity: float = 1.0
    has_dots: bool = False
    is_solid: bool = False
    flight: np.ndarray | None = None

    @property
    def line_width(self) -> float:
        """Width of the line, its own or that of its key."""
        return WIDTHS.get(self.key, 1.6) if self.width is None else self.width


@dataclasses.dataclass(frozen=True)
class Band:
    """The ground between two lines over the same places x."""

    key: str
    x: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclasses.dataclass(frozen=True)
class Points:
    """Single points; attributes as of `Line`.

    Attributes:
        size: in pixels.
        names: of the points, for the template.
        labels: text beside each point.
        time: (n,) of each point [s], where the reader may pick a flight.
    """

    key: str
    x: np.ndarray
    y: np.ndarray
    _: dataclasses.KW_ONLY
    hover: str = "%{x:.3r}: %{y:.3r}"
    size: float = 7.0
    opacity: float = 1.0
    names: Sequence[str] = ()
    labels: Sequence[str] = ()
    flight: np.ndarray | None = None
    time: np.ndarray | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bars:
    """Bars from zero.

    Attributes:
        key: entry of the legend.
        places: (n,) on the axis that they stand on.
        values: (n,).
        texts: at the end of each bar.
        hover: template of what is said of a bar.
        names: of the bars, for the template.
        width: of a bar, in units of the axis.
        is_across: whether they lie instead of standing.
    """

    key: str
    places: np.ndarray
    values: np.ndarray
    texts: Sequence[str]
    hover: str
    names: Sequence[str] = ()
    width: float = 0.8
    is_across: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class Level:
    """A thin line across a panel at a height."""

    value: float = 0.0
    is_dotted: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ground:
    """A pale ground under a span of x, or of y."""

    start: float
    end: float
    along: str = "x"
    key: str = "soft"


Mark = Line | Band | Points | Bars | Level | Ground


@dataclasses.dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes.

    Attributes:
        title: above it.
        marks: what it shows, from the bottom up.
        x: axis across.
        y: axis up.
        height: in pixels of the page.
        share: of the width of its row in a file, relative to the other panels.
    """

    title: str
    marks: Sequence[Mark]
    x: Axis = Axis()
    y: Axis = Axis()
    height: int = 270
    share: float = 1.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Choice:
    """Panels that are shown on request, or from the start; a file has the latter."""

    label: str
    note: str
    panels: Sequence[Panel]
    is_shown: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class Figure:
    """Panels with one legend.

    Attributes:
        keys: entry of the legend to its label.
        panels: that are always shown.
        choices: of which the reader of a page shows some.
        columns: of panels in a file; a page has as many as it has space for.
        flights: names, where the reader of a page may pick one.
        least_width: of a panel of a page, in its letters [rem].
    """

    keys: Mapping[str, str] = dataclasses.field(default_factory=dict)
    panels: Sequence[Panel] = ()
    choices: Sequence[Choice] = ()
    columns: int = 3
    flights: Sequence[str] = ()
    least_width: float = 18.5

    @property
    def every(self) -> list[Panel]:
        """All panels, those to choose from among them."""
        return [*self.panels, *(panel for c in self.choices for panel in c.panels)]

    @property
    def shown(self) -> list[Panel]:
        """Panels that are shown at first."""
        chosen = [panel for c in self.choices if c.is_shown for panel in c.panels]
        return [*self.panels, *chosen]
