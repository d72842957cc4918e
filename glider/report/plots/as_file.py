"""Figures as pictures: marks drawn by Agg, matplotlib's renderer, and texts by Pillow.

Matplotlib's figures, axes and texts stay out: they take several times as long as all
marks. Lengths are points (1/72 inch) from the lower left corner of a picture.
"""

import functools
import io
import math
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.backend_bases import GraphicsContextBase
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D, Bbox
from PIL import Image, ImageDraw, ImageFont

from glider.report.plots import figure as spec
from glider.report.plots.binning import bounds
from glider.report.plots.style import COLORS, FRAME, GRID

WIDTH, DPI = 720.0, 110.0  # Of a picture, and its dots per inch.
_PIXEL = 72.0 / 92.0  # Of a page.
_LETTER, _LINE = 5.2, 12.2  # Width of a letter and height of a line.


class Text(NamedTuple):
    """A text of a picture; the anchor at its place is Pillow's."""

    x: float
    y: float
    text: str
    anchor: str = "ms"
    size: float = 9.5
    color: str = "#000000"
    is_upright: bool = False


class Picture:
    """A picture in the making, white at first; its `texts` come on top."""

    def __init__(self, width: float, height: float, dpi: float) -> None:
        self.width, self.height, self.scale = width, height, dpi / 72.0
        self._size = round(width * self.scale), round(height * self.scale)
        self._renderer = RendererAgg(*self._size, dpi)
        self._transform = Affine2D().scale(self.scale)
        self.texts: list[Text] = []
        self.draw(_box(0.0, 0.0, width, height), "#FFFFFF")

    def draw(
        self,
        outline: np.ndarray,
        color: str,
        width: float = 0.0,
        opacity: float = 1.0,
        within: Bbox | None = None,
        dashes: tuple[float, ...] = (),
    ) -> None:
        """Draws a line through points (n, 2), NaN breaks it; fills it without a width.

        Dashes are in widths.
        """
        style = self._style(color, width, opacity, within)
        if dashes:
            style.set_dashes(0.0, [width * dash for dash in dashes])
        face = None if width else to_rgb(color)
        self._renderer.draw_path(style, Path(outline), self._transform, face)

    def dots(
        self, points: np.ndarray, color: str, size: float, opacity: float, within: Bbox
    ) -> None:
        """Draws round dots at points (n, 2)."""
        style = self._style(color, 0.0, opacity, within)
        shape = Path.unit_circle(), Affine2D().scale(0.5 * size * self.scale)
        places = Path(points), self._transform
        self._renderer.draw_markers(style, *shape, *places, to_rgb(color))

    def png(self) -> bytes:
        """The picture as a file."""
        pixels = self._renderer.buffer_rgba()
        image = Image.frombuffer("RGBA", self._size, pixels, "raw", "RGBA", 0, 1)
        image = image.convert("RGB")
        canvas = ImageDraw.Draw(image)
        for text in self.texts:
            self._write(canvas, text)
        buffer = io.BytesIO()
        image.save(buffer, "png", compress_level=1)
        return buffer.getvalue()

    def _style(
        self, color: str, width: float, opacity: float, within: Bbox | None
    ) -> GraphicsContextBase:
        style = self._renderer.new_gc()
        style.set_foreground(color)
        style.set_linewidth(width)
        style.set_alpha(opacity)
        if within is not None:
            style.set_clip_rectangle(within.transformed(self._transform))
        return style

    def _write(self, canvas: ImageDraw.ImageDraw, text: Text) -> None:
        x, y = text.x * self.scale, self._size[1] - text.y * self.scale
        normal, small = (font(s * text.size * self.scale) for s in (1.0, 0.7))
        if text.is_upright:
            turned = ImageFont.TransposedFont(normal, Image.Transpose.ROTATE_90)
            y -= 0.5 * turned.getbbox(text.text)[3]
            canvas.text((x, y), text.text, text.color, turned)
            return
        # "$C_n$" is a C with a subscript: each third part.
        parts = re.split(r"\$(C)_(\w)\$", text.text)
        fonts = [small if i % 3 == 2 else normal for i in range(len(parts))]
        widths = [f.getlength(part) for f, part in zip(fonts, parts, strict=True)]
        x -= {"l": 0.0, "m": 0.5, "r": 1.0}[text.anchor[0]] * sum(widths)
        for part, own, width in zip(parts, fonts, widths, strict=True):
            lower = 0.2 * normal.size if own is small else 0.0
            canvas.text((x, y + lower), part, text.color, own, f"l{text.anchor[1]}")
            x += width


def _box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


@functools.cache
def font(size: float) -> ImageFont.FreeTypeFont:
    """The font of all texts, which comes with matplotlib; its size in pixels."""
    path = f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans.ttf"
    return ImageFont.truetype(path, size, layout_engine=ImageFont.Layout.BASIC)


def to_png(figure: spec.Figure, dpi: float = DPI, width: float = WIDTH) -> bytes:
    """Draws a figure as a PNG file."""
    return draw(figure, dpi, width).png()


def draw(figure: spec.Figure, dpi: float = DPI, width: float = WIDTH) -> Picture:
    """Draws the shown panels of a figure, row by row, below its legend."""
    panels = figure.shown
    columns = min(figure.columns, len(panels))
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    heights = [_PIXEL * max(panel.height for panel in row) for row in rows]
    legend = _legend_rows(figure, width)
    edge = sum(heights)
    picture = Picture(width, edge + 4.3 + 1.2 * _LINE * len(legend), dpi)
    for k, entries in enumerate(legend):
        _draw_legend(picture, figure, entries, picture.height - (0.9 + 1.2 * k) * _LINE)
    for row, height in zip(rows, heights, strict=True):
        shares = [panel.share for panel in row] + [1.0] * (columns - len(row))
        starts = width * np.append(0.0, np.cumsum(shares)) / sum(shares)
        for panel, start, end in zip(row, starts, starts[1:], strict=False):
            left, below, above = _margins(panel)
            corners = start + left, edge - height + below, end - 8.6, edge - above
            _Plot(picture, panel, Bbox.from_extents(*corners)).draw()
        edge -= height
    return picture


def _margins(panel: spec.Panel) -> tuple[float, float, float]:
    """Space left of, below and above a panel for its texts."""
    longest = 6 if panel.y.ticks is None else max(map(len, panel.y.ticks.values()))
    left = 8.6 + longest * _LETTER + (_LINE if panel.y.label else 0.0)
    lines = 1
    if panel.x.ticks is not None:
        lines += max(label.count("\n") for label in panel.x.ticks.values())
    below = 8.6 + lines * _LINE + (1.1 * _LINE if panel.x.label else 0.0)
    return left, below, 1.7 * _LINE if panel.title else 5.8


def _legend_rows(figure: spec.Figure, width: float) -> list[dict[str, float]]:
    """Keys of the legend with the widths of their entries, row by row."""
    rows: list[dict[str, float]] = []
    for key, label in figure.keys.items():
        needed = 43.0 + font(9.0).getlength(label)
        if not rows or sum(rows[-1].values()) + needed > width:
            rows.append({})
        rows[-1][key] = needed
    return rows


def _draw_legend(
    picture: Picture, figure: spec.Figure, entries: dict[str, float], y: float
) -> None:
    """Draws a row of the legend: each key's line or area, and its label."""
    x = 0.5 * (picture.width - sum(entries.values())) + 7.0
    marks = [mark for panel in figure.shown for mark in panel.marks]
    for key, width in entries.items():
        mine = [mark for mark in marks if getattr(mark, "key", "") == key]
        lines = [mark for mark in mine if isinstance(mark, spec.Line)]
        if lines or not mine:
            width_drawn = max((line.line_width for line in lines), default=4.0)
            dashes = next((line.dashes for line in lines if line.dashes), ())
            ends = np.array([(x, y), (x + 22.0, y)])
            picture.draw(ends, COLORS[key], width_drawn, dashes=dashes)
        else:
            is_pale = any(isinstance(mark, spec.Ground) for mark in mine)
            opacity = min(getattr(mark, "opacity", 1.0) for mark in mine)
            box = _box(x, y - 3.2, x + 22.0, y + 3.2)
            picture.draw(box, COLORS[key], opacity=0.2 if is_pale else opacity)
        picture.texts.append(Text(x + 28.0, y, figure.keys[key], "lm", 9.0))
        x += width


class _Scale:
    """Where the values of an axis lie, from `start` to `end`."""

    def __init__(self, panel: spec.Panel, name: str, start: float, end: float) -> None:
        self.axis: spec.Axis = getattr(panel, name)
        self.start, self.end = start, end
        if self.axis.range is not None:
            self.low, self.high = self._flat(np.array(self.axis.range))
            return
        found = [
            np.ravel(getattr(mark, field))
            for mark in panel.marks
            for field in _FIELDS[name]
            if hasattr(mark, field) and getattr(mark, "along", name) == name
        ]
        every = self._flat(np.concatenate([*found, np.zeros(0)]))
        margin = 0.02 if name == "x" else 0.15
        self.low, self.high = bounds(every, margin, 0.0) or (0.0, 1.0)

    def _flat(self, values: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log10(values) if self.axis.is_log else values

    def __call__(self, values: Any) -> Any:
        shares = (self._flat(values) - self.low) / (self.high - self.low)
        # What is far outside cannot overflow the renderer.
        return self.start + np.clip(shares, -1e3, 1e3) * (self.end - self.start)

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """Places and labels of about so many ticks."""
        if self.axis.ticks is not None:
            found = dict(self.axis.ticks)
        elif self.axis.is_log:
            powers = range(math.ceil(self.low), math.floor(self.high) + 1)
            found = {10.0**power: f"{10.0**power:g}" for power in powers}
        else:
            locator = MaxNLocator(most, steps=[1, 2, 5, 10])
            values = locator.tick_values(self.low, self.high)
            digits = max(0, -math.floor(math.log10(values[1] - values[0]) + 1e-9))
            found = {v: f"{v + 0.0:.{digits}f}".replace("-", "−") for v in values}
        places = {float(self(place)): label for place, label in found.items()}
        return [p for p in places.items() if self.start - 0.1 <= p[0] <= self.end + 0.1]


_FIELDS = {
    "x": ("x", "places", "start", "end"),
    "y": ("y", "low", "high", "value", "values", "start", "end"),
}
"""Fields of marks that an axis without a range shows."""


class _Plot:
    """A panel within its box of a picture."""

    def __init__(self, picture: Picture, panel: spec.Panel, box: Bbox) -> None:
        self.picture, self.panel, self.box = picture, panel, box
        self.x = _Scale(panel, "x", box.x0, box.x1)
        self.y = _Scale(panel, "y", box.y0, box.y1)
        points = [m for m in panel.marks if isinstance(m, spec.Points)]
        self.has_cloud = any(mark.size < 5.0 for mark in points)

    def draw(self) -> None:
        """Draws the panel, and its texts around the box."""
        draw, write, box = self.picture.draw, self.picture.texts.append, self.box
        small: Any = {"size": 8.5, "color": FRAME}
        for x, label in self.x.ticks(max(3, min(7, int(box.width / 36.0)))):
            if self.panel.x.has_grid:
                draw(np.array([(x, box.y0), (x, box.y1)]), GRID, 0.6)
            for k, line in enumerate(label.split("\n")):
                write(Text(x, box.y0 - 3.0 - 10.2 * k, line, "ma", **small))
        for y, label in self.y.ticks(5):
            if self.panel.y.has_grid:
                draw(np.array([(box.x0, y), (box.x1, y)]), GRID, 0.6)
            write(Text(box.x0 - 4.0, y, label, "rm", **small))
        for mark in self.panel.marks:
            self._draw(mark, COLORS[getattr(mark, "key", "soft")])
        draw(_box(box.x1, box.y0, box.x0, box.y1)[[0, 1, 2]], FRAME, 0.8)
        left, below, _ = _margins(self.panel)
        x, y = 0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)
        write(Text(x, box.y1 + 4.0, self.panel.title, size=10.0))
        write(Text(x, box.y0 - below + 4.3, self.panel.x.label, "md"))
        write(Text(box.x0 - left + 7.2, y, self.panel.y.label, is_upright=True))

    def _place(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.column_stack([self.x(x), self.y(y)])

    def _draw(self, mark: spec.Mark, color: str) -> None:
        box, picture = self.box, self.picture
        draw = functools.partial(picture.draw, color=color, within=box)
        match mark:
            case spec.Level():
                y = self.y(mark.value)
                dots = (1.0, 1.65) if mark.is_dotted else ()
                draw(np.array([(box.x0, y), (box.x1, y)]), width=0.8, dashes=dots)
            case spec.Ground():
                ends = np.array([mark.start, mark.end])
                left, right = self.x(ends) if mark.along == "x" else box.intervalx
                low, high = self.y(ends) if mark.along == "y" else box.intervaly
                draw(_box(left, low, right, high), opacity=0.14)
            case spec.Band():
                edges = self._place(mark.x, mark.low), self._place(mark.x, mark.high)
                keep = np.isfinite(np.hstack(edges)).all(axis=1)
                there, back = (edge[keep] for edge in edges)
                draw(np.vstack([there, back[::-1]]), opacity=0.17)
            case spec.Bars():
                self._draw_bars(mark, draw)
            case spec.Line():
                points, width = self._place(mark.x, mark.y), 0.85 * mark.line_width
                if self.has_cloud:
                    picture.draw(points, "#FFFFFF", width + 1.6, within=box)
                draw(points, width=width, opacity=mark.opacity, dashes=mark.dashes)
                if mark.has_dots:
                    picture.dots(points, color, 6.0, mark.opacity, box)
            case spec.Points():
                points = self._place(mark.x, mark.y)
                picture.dots(points, color, 0.55 * mark.size, mark.opacity, box)
                for at, label in zip(points, mark.labels, strict=False):
                    if label and math.isfinite(at[1]):
                        text = Text(at[0], at[1] + 5.0, label, size=8.0)
                        picture.texts.append(text)

    def _draw_bars(self, mark: spec.Bars, draw: Callable[..., None]) -> None:
        across, up = (self.y, self.x) if mark.is_across else (self.x, self.y)
        half, foot = 0.5 * mark.width, float(up(np.zeros(())))
        sides = across(mark.places - half), across(mark.places + half)
        tops = up(np.nan_to_num(mark.values, posinf=0.0, neginf=0.0))
        for start, end, top, text in zip(*sides, tops, mark.texts, strict=True):
            middle = 0.5 * (start + end)
            if mark.is_across:
                draw(_box(foot, start, top, end))
                label = Text(max(top, foot) + 4.0, middle, text, "lm", 8.5)
            else:
                draw(_box(start, foot, end, top))
                size = min(0.42 * (end - start), 8.5)
                label = Text(middle, max(top, self.box.y0) + 2.0, text, size=size)
            self.picture.texts.append(label)
