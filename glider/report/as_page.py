"""Pages with figures: the data of these, which `static/page.js` draws with plotly.js.

Numbers have five digits. What several panels show is written once: "#3" is the page's
column of numbers 3.
"""

import dataclasses
import functools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from glider.files.schema import json_text
from glider.report.plots import figure as spec
from glider.report.plots.style import INKS
from glider.report.wording import TEMPLATES

STATIC = Path(__file__).parent / "static"

_SHORT = 8  # Numbers up to which a column is written where it stands.


def render_page(
    template: str, figures: Mapping[str, spec.Figure], **values: Any
) -> str:
    """Renders a page with the figures that its template shows, one file for all."""
    return TEMPLATES.get_template(template).render(
        figures=figures,
        data=_script(page_data(figures)),
        colors=color_style(),
        style=_static("page.css"),
        script=_static("page.js"),
        plotly=_static("plotly-basic.min.js"),
        **values,
    )


def color_style() -> Markup:
    """CSS of the colors of figures, on light and on dark ground."""
    light, dark = (
        "".join(f"--c-{key}: {inks[i]}; " for key, inks in INKS.items()) for i in (0, 1)
    )
    return Markup(
        f":root {{ {light}}}\n@media screen and (prefers-color-scheme: dark) {{\n"
        f"  :root:not(.printing) {{ {dark}}}\n}}"
    )


def page_data(figures: Mapping[str, spec.Figure]) -> dict[str, Any]:
    """Data of a page's figures, with the columns that they share."""
    columns = _Columns()
    found = {name: columns.packed(figure) for name, figure in figures.items()}
    return {"figures": found, "columns": columns.values}


def with_contents(page: str) -> Markup:
    """Gives each section of a page an anchor, and links to all below the header."""
    page = str(page)
    links = ""
    for title in re.findall(r"<h2>(.*?)</h2>", page):
        anchor = "section-" + "-".join(re.findall(r"\w+", title.lower()))
        page = page.replace(f"<h2>{title}<", f'<h2 id="{anchor}">{title}<')
        links += f'<a href="#{anchor}">{title}</a> '
    return Markup(page.replace("</header>", f"</header>\n<nav>{links}</nav>", 1))


TEMPLATES.filters["with_contents"] = with_contents


def _script(data: Any) -> Markup:
    """JSON that cannot end the script that it stands in."""
    text = json_text(data, indent=-1)
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


@functools.cache
def _static(name: str) -> Markup:
    """Text of a file that a page carries within it."""
    return Markup((STATIC / name).read_text(encoding="utf-8"))


class _Columns:
    """Numbers of a page, each column once."""

    def __init__(self) -> None:
        self.values: list[np.ndarray] = []
        self._places: dict[tuple[str, bytes], str] = {}

    def packed(self, value: Any) -> Any:
        """A part of a figure as JSON has it, with references to its columns."""
        if isinstance(value, np.ndarray):
            return self._add(value)
        if isinstance(value, (list, tuple)):
            return [self.packed(part) for part in value]
        if not dataclasses.is_dataclass(value):
            return value
        names = [field.name for field in dataclasses.fields(value)]
        names += [name for name in _DERIVED if hasattr(value, name)]
        parts = {name: self.packed(getattr(value, name)) for name in names}
        return {"is": type(value).__name__, **parts}

    def _add(self, values: np.ndarray) -> np.ndarray | str:
        """A column's reference; the column itself where it is short."""
        values = values if values.dtype.kind in "iu" else rounded(values)
        if len(values) <= _SHORT:
            return values
        key = values.dtype.kind, values.tobytes()
        if key not in self._places:
            self._places[key] = f"#{len(self.values)}"
            self.values.append(values)
        return self._places[key]


_DERIVED = ("line_width", "dashes")
"""Properties of lines that a page is given as well."""


def rounded(values: np.ndarray) -> np.ndarray:
    """Numbers of five digits; infinite ones become NaN."""
    digits = np.char.mod("%.5g", np.asarray(values, dtype=float)).astype(float)
    return np.where(np.isfinite(digits), digits, np.nan)
