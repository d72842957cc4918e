"""What users read is in the words of the field: pages, docstrings and messages."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

DIALECT = {
    r"fore(tell|tells|told)": "predict",
    r"anew": "again",
    r"as drawn|as_drawn": "nominal",
    r"beforehand": "prior",
    r"from which on": "above which, threshold",
    r"set aside|sets aside|setting aside": "excluded",
    r"(its|plate's|vehicle's|glider's) own numbers": "parameters",
    r"(is|are|was|were|not) told": "given, known, reported",
    r"nobody (told|tells|knows|knew|asked|measures)": "unknown, not given",
    r"who(so)?ever": "the user, the caller",
    r"by lot": "at random",
    r"lest": "so that ... not",
    r"blows? up|blew up": "diverges",
    r"laid to": "attributed to",
    r"mend(s|ed|ing)?": "fix, correct",
    r"in whole numbers": "in exact arithmetic",
    r"strangers?": "outlier, reader",
    r"what it buys|what .{1,20} buys": "improvement",
    r"launches that err": "perturbed launches",
    r"differs from flight to flight": "flight-to-flight variation",
    r"worth its price|plain price|at its price": "penalty, evidence threshold",
    r"middle (one|flight)": "median",
    r"so it is where": "likewise",
    r"of an own": "of its own, independent",
    r"could be confused with": "indistinguishable from",
    r"behind the best": "Δ evidence",
    r"is needed\.?$": "expected",
}
"""Turns of phrase that the field does not have, and what it has instead."""

_PATTERN = re.compile(rf"\b(?:{'|'.join(DIALECT)})(?!\w)", re.IGNORECASE)

PAGES = (
    "*.md",
    "docs/**/*.md",
    "examples/**/*.md",
    "glider/**/*.html",
    "docs/tutorials/*.py",
)
CODE = ("glider/**/*.py", "diagrams/**/*.py", "examples/**/*.py", "tests/**/*.py")
KEYS = {"set_aside", "as_drawn"}
"""Keys of report.json, of today and of older versions."""


def strings_of(path: Path) -> list[tuple[int, str]]:
    """Returns line and text of each string of a module, its docstrings too."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [
        (node.lineno, node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


def may_have_dialect(path: Path) -> bool:
    """Whether a string of a module may: its whole text is quick to search.

    Strings that stand beside one another are joined, and a turn that ends a string
    counts anywhere.
    """
    text = re.sub(r"""["']\s*[rfb]*["']""", "", path.read_text(encoding="utf-8"))
    anywhere = _PATTERN.pattern.replace("$", "")
    return re.search(anywhere, re.sub(r"\s+", " ", text), re.IGNORECASE) is not None


def find_dialect(text: str) -> list[str]:
    """Returns what a text says that is none of the field's words."""
    flat = re.sub(r"\s+", " ", text)
    return [match.group() for match in _PATTERN.finditer(flat)]


def files_of(patterns: tuple[str, ...]) -> list[Path]:
    """Returns the files of the tree that match."""
    found = {path for pattern in patterns for path in ROOT.glob(pattern)}
    return sorted(path for path in found if ROOT / "docs/effects" not in path.parents)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("The model foretells it.", ["foretells"]),
        ("rows that are set\n    aside", ["set aside"]),
        ("field 'mass' is 'x'; a number is needed.", ["is needed."]),
        ("The latest estimate is needed by the filter.", []),
        ("It recommends an amendment.", []),
    ],
)
def test_dialect_is_found(text, found):
    assert find_dialect(text) == found


def test_pages_use_the_words_of_the_field():
    faults = [
        f"{path.relative_to(ROOT)}: {word!r}"
        for path in files_of(PAGES)
        for word in find_dialect(path.read_text(encoding="utf-8"))
    ]
    assert faults == []


def test_docstrings_and_messages_use_the_words_of_the_field():
    faults = [
        f"{path.relative_to(ROOT)}:{line}: {word!r}"
        for path in files_of(CODE)
        if path != Path(__file__) and may_have_dialect(path)
        for line, text in strings_of(path)
        if text not in KEYS
        for word in find_dialect(text)
    ]
    assert faults == []
