"""Reports of all variants as text, compared with the files in tests/data/reports.

    python -m tests.report.snapshots

writes the files again, after a sentence or a field was changed on purpose: read what
`git diff` shows of them.
"""

import re
from pathlib import Path
from unittest import mock

from glider.files.schema import json_text
from glider.report.folder import to_html
from tests.report.results import VARIANTS
from tests.report.test_report import Page, summary

FOLDER = Path(__file__).parents[1] / "data" / "reports"


def snapshot(name: str) -> str:
    """Returns a variant's report.json, summary and page, a paragraph a line."""
    result = VARIANTS[name]
    with (
        mock.patch("glider.report.folder.platform.python_version", lambda: "3"),
        mock.patch("glider.report.folder.importlib.metadata.version", lambda _: "1"),
    ):
        html = to_html(result)
    html = " ".join(html.replace("\u00a0", " ").split())
    html = re.sub(r"<(tr|p|li|h\d|dt|caption)\b", r"\n<\1", html)
    text = Page(re.sub(r"<t[dh]\b", " <td", html)).text
    lines = [" ".join(line.split()) for line in text.splitlines()]
    page = "\n".join(line for line in lines if line)
    report = json_text(result.report) if name in ("effect", "diverged") else ""
    text = f"{report}\n{summary(result)}\n{page}"
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())


def file_of(name: str) -> Path:
    """Returns the file of a variant's snapshot."""
    return FOLDER / f"{name.replace(' ', '_')}.txt"


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for variant in VARIANTS:
        file_of(variant).write_text(snapshot(variant), encoding="utf-8")
