"""Pages with figures: the data of these, which `static/page.js` draws with plotly.js.

Numbers have five digits.
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
    """Data of a page's figures."""
    return {"figures": {name: _packed(figure) for name, figure in figures.items()}}


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


def _packed(value: Any) -> Any:
    """A part of a figure as JSON has it."""
    if isinstance(value, np.ndarray):
        return value if value.dtype.kind in "iu" else rounded(value)
    if isinstance(value, (list, tuple)):
        return [_packed(part) for part in value]
    if not dataclasses.is_dataclass(value):
        return value
    names = [field.name for field in dataclasses.fields(value)]
    names += [name for name in _DERIVED if hasattr(value, name)]
    parts = {name: _packed(getattr(value, name)) for name in names}
    return {"is": type(value).__name__, **parts}


_DERIVED = ("line_width", "dashes")
"""Properties of lines that a page is given as well."""


def rounded(values: np.ndarray) -> np.ndarray:
    """Numbers of five digits; infinite ones become NaN."""
    digits = np.char.mod("%.5g", np.asarray(values, dtype=float)).astype(float)
    return np.where(np.isfinite(digits), digits, np.nan)
