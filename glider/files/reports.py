"""Where a report is that `close-the-loop` wrote."""

from pathlib import Path

from glider.errors import InputError


def find_report(path: Path) -> Path:
    """Returns the report.json of a folder, or the file itself.

    Raises:
        InputError: there is none.
    """
    file = path / "report.json" if path.is_dir() else path
    if not file.exists():
        raise InputError(
            f"{file}: there is no such file; a folder that close-the-loop wrote, or "
            "its report.json, is needed."
        )
    return file
