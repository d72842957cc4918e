"""Sphinx extension: pages of the library's effects, made from the library itself.

For each effect it writes the docstring from its module, its formula as it is computed,
its coefficients, a picture of what it does to a flight, and one of its signature: the
residual of flights of a glider that has the effect, under the model without it and with
it.
"""

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from pathlib import Path

from signatures import Signature, draw, draw_flights, signatures, sizes_of
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

from glider.physics import effects
from glider.physics.effects import LIBRARY, STAGES, Coefficient, EffectKind
from glider.report.model_figures import RESIDUALS
from glider.report.plots.style import VARIABLES

WORDS = {
    "actuator": "How the servo follows a commanded rate.",
    "air": "How the air moves.",
    "geometry": "Angles and positions of the plates.",
    "surface": "Force coefficients of the plates.",
    "wrench": "Forces and moments on the whole body.",
    "inertia": "Mass and inertia.",
    "sensor": "How the measured pose differs from the true pose.",
    "log": "Errors of the log, corrected before any other step.",
}
"""Maps a stage to what its effects change."""


_INTRODUCTION = """\
# Effect catalogue

These are the {count} effects that a flat-plate model may lack. Each is a formula that
adds to one link of the chain

    command -> [actuator] -> [air] -> [geometry] -> [surface] -> forces -> [wrench]
            -> [inertia] -> acceleration -> state -> [sensor] -> log

These pages are generated from the library when the docs are built: the description of
each effect, its formula as it is computed, and flights simulated with it. Quantities
are in SI units and radians. Pitch is positive nose **down**, the elevator positive
trailing edge **up**, and z points up.

The arguments of a formula are the flow (see
[`Flow`](#glider.physics.effects.effect.Flow) for its fields), the states of the effect,
if it has any, and its coefficients. The *typical size* of a coefficient sets step
sizes, the prior and the pictures. A coefficient whose neutral value is *any* only sets
the shape of the effect; several starting values are tried for it.

The first picture of an effect shows what it does to a flight. The second shows the
*residual* as in the report: measured minus modelled acceleration of eight flights,
along the wing, normal to it, and in pitch (positive nose down). Grey is the model
without the effect, blue the model with it. The signs give the contribution of the
effect at its typical size: *0* for nothing visible above the noise, *+* for mostly
positive, *−* for mostly negative, *±* for both. The tracer compares whole flights and
may therefore find an effect whose picture shows little.

What no formula describes is found as a curve or a free function, see [how it
works](../how_it_works.md). [Your own effect](../tutorials/own_effect.py) needs a
formula of a few lines. """


def page_of(stage: str, signatures: list[Signature], texts: dict[str, str]) -> str:
    """Returns the page of a stage, in Markdown."""
    terms = ", ".join(f"`{term}`" for term in STAGES[stage])
    adds = f" Its effects may add to {terms}." if terms else ""
    parts = [f"# {stage.capitalize()}\n\n{WORDS[stage]}{adds}\n"]
    for signature in signatures:
        kind = signature.effect.kind
        size = ", ".join(
            f"{name} = {_short(value)} {unit_of(kind, name)}".removesuffix(" -")
            for name, value in signature.effect.to_dict().items()
        )
        directions = ", ".join(
            f"{label} **{signature.direction(k)}**" for k, label in enumerate(RESIDUALS)
        )
        over = VARIABLES[signature.variable][0].split(" [")[0]
        parts.append(
            f"(effect-{kind.kind})=\n## {kind.kind}\n\n"
            f"*{kind.words[0].upper()}{kind.words[1:]}.*\n\n{texts[kind.kind]}\n\n"
            f"```python\n{''.join(_sources(kind))}```\n\n"
            f"{_coefficient_table(kind)}\n\n"
            f"```{{figure}} pictures/{kind.kind}_flight.png\n"
            f":alt: a flight with {kind.kind} beside the same launch without it\n\n"
            f"One launch under one tape of commands, as cameras see it: the glider "
            f"without the effect (grey) and with {size} (blue){_times(signature)}.\n"
            f"```\n\n"
            f"```{{figure}} pictures/{kind.kind}.png\n"
            f":alt: residuals of flights with {kind.kind}\n\n"
            f"Flights of a glider with {size}: residual of the model without it (grey) "
            f"and with it (blue), over {over}.\n"
            f"```\n\n"
            f"Contribution to the residual: {directions}."
            f" It varies with {', '.join(kind.depends_on)}.\n"
        )
    return "\n".join(parts)


def _times(signature: Signature) -> str:
    """Says how much differences are magnified."""
    times = signature.magnification
    return f"; differences are drawn {times} times as large" if times > 1 else ""


def unit_of(kind: EffectKind, name: str) -> str:
    """Returns the unit of a coefficient."""
    return next(c.unit for c in kind.coefficients if c.name == name)


def _sources(kind: EffectKind) -> Iterator[str]:
    """Yields the sources of an effect's functions."""
    for function in (kind.formula, kind.state_rate):
        if function is not None:
            source = inspect.getsource(inspect.unwrap(function))
            yield source.removeprefix("@scalar\n")


def _coefficient_table(kind: EffectKind) -> str:
    rows = ["| coefficient | unit | neutral value | typical size | range |"]
    rows.append("|---|---|---|---|---|")
    for c in kind.coefficients:
        rows.append(
            f"| `{c.name}` | {c.unit} | {_nothing(kind, c)} | {_short(c.scale)} "
            f"| {_short(c.lower)} to {_short(c.upper)} |"
        )
    return "\n".join(rows)


def _nothing(kind: EffectKind, c: Coefficient) -> str:
    is_size = c in sizes_of(kind)
    return _short(c.default) if is_size else f"any; starts at {_short(c.default)}"


def _short(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def index_page(texts: dict[str, str]) -> str:
    """Returns the first page of the catalogue, in Markdown."""
    rows = [
        "| effect | stage | description | unit | typical size |",
        "|---|---|---|---|---|",
    ]
    for kind in LIBRARY:
        sizes = sizes_of(kind)
        rows.append(
            f"| [{kind.kind}](#effect-{kind.kind}) | {kind.stage} | {kind.words} "
            f"| {', '.join(c.unit for c in sizes)} "
            f"| {', '.join(_short(c.scale) for c in sizes)} |"
        )
    toctree = "\n".join(stages())
    return (
        f"{_INTRODUCTION.format(count=len(LIBRARY))}\n" + "\n".join(rows) + "\n\n"
        f"```{{toctree}}\n:maxdepth: 2\n:hidden:\n\n{toctree}\n```\n"
    )


def stages() -> list[str]:
    """Returns the stages that have effects, in the chain's order."""
    return [s for s in STAGES if any(kind.stage == s for kind in LIBRARY)]


def write_catalogue(app: Sphinx) -> None:
    """Writes the pages and pictures into effects/ of the sources."""
    folder = Path(app.srcdir) / "effects"
    pictures = folder / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    texts = texts_of_library()
    found: dict[str, list[Signature]] = {stage: [] for stage in stages()}
    for signature in signatures():
        kind = signature.effect.kind
        (pictures / f"{kind.kind}.png").write_bytes(draw(signature))
        draw_flights(signature).savefig(pictures / f"{kind.kind}_flight.png", dpi=90)
        found[kind.stage].append(signature)
    (folder / "index.md").write_text(index_page(texts), encoding="utf-8")
    for stage, own in found.items():
        page = page_of(stage, own, texts)
        (folder / f"{stage}.md").write_text(page, encoding="utf-8")


def texts_of_library() -> dict[str, str]:
    """Maps each effect to its docstring in its module."""
    found = {}
    for module in pkgutil.iter_modules(effects.__path__, f"{effects.__name__}."):
        documented = ModuleAnalyzer.for_module(module.name).find_attr_docs()
        for (_, name), lines in documented.items():
            kind = getattr(importlib.import_module(module.name), name, None)
            if isinstance(kind, EffectKind):
                found[kind.kind] = "\n".join(lines).strip()
    missing = [kind.kind for kind in LIBRARY if not found.get(kind.kind)]
    if missing:
        raise LookupError(f"Effects without a text below them: {', '.join(missing)}.")
    return found


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the catalogue to a Sphinx build."""
    app.connect("builder-inited", write_catalogue)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
