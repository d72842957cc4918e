"""A report.json, as close-the-loop wrote it, read back."""

from pathlib import Path

from glider.errors import InputError
from glider.files.schema import convert, parse_json, read_text
from glider.sysid.result import Report


def read_report(path: Path) -> tuple[Report, Path]:
    """Reads a report: its folder, or its report.json; also returns the file.

    Raises:
        InputError: it is no report, or one of another version.
    """
    file = path / "report.json" if path.is_dir() else path
    if not file.exists():
        raise InputError(
            f"{file}: there is no such file; expected a folder that close-the-loop "
            "wrote, or its report.json."
        )
    data = parse_json(read_text(file, "a report.json of close-the-loop"), str(file))
    if isinstance(data, dict) and "as_drawn" in (data.get("errors") or ()):
        raise InputError(
            f"{file}: was written by an older version of drake-glider; expected a "
            "report of this one: run close-the-loop again."
        )
    try:
        return convert(data, Report, str(file)), file
    except InputError as error:
        again = "run close-the-loop again if another version wrote it"
        raise InputError(f"{str(error).rstrip('.')} ({again}).") from None
