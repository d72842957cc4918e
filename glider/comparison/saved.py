"""A report.json, read back, with the model beside it."""

import dataclasses
from pathlib import Path

from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.sysid.report_file import read_report
from glider.sysid.result import Report


@dataclasses.dataclass(frozen=True, kw_only=True)
class SavedReport(Report):
    """A report as it was saved.

    Attributes:
        path: of its report.json.
        given: parameters of the vehicle that were specified, if model.yaml is beside
            it.
    """

    path: Path
    given: GliderParameters | None


def load_report(path: Path) -> SavedReport:
    """Reads a report: its folder, or its report.json.

    Raises:
        InputError: it is no report, or one of another version.
    """
    report, file = read_report(path)
    return SavedReport(**vars(report), path=file, given=_given(file, report))


def _given(file: Path, report: Report) -> GliderParameters | None:
    """The vehicle that was specified; None where it was not, or is not known."""
    model = file.with_name("model.yaml")
    if report.vehicle or not model.exists():
        return None
    try:
        return GliderModel.load(model).parameters
    except InputError:  # With effects of the user's own: they compare without it.
        return None
