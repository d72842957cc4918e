"""Counts and lists that the pages write out are those of the code."""

import math
import re
from pathlib import Path

import pytest

from glider.__main__ import main
from glider.physics.effects import ADDED_MASS, LIBRARY
from glider.report.folder import write_report
from glider.sysid import constants
from tests.report.results import make_result

ROOT = Path(__file__).parents[2]
FILES = {
    "README.md": r"close-the-loop throws +# (.*)",
    "docs/report.md": r"^\| `([\w./]+)` \| ",
    "docs/getting_started.md": r"^`([\w./]+)`\n:",
}
"""Pages that list the files of a report, and what finds their names."""


def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


def test_the_readme_counts_the_effects():
    assert f"| {len(LIBRARY)} effects, and your own |" in text_of("README.md")


def test_the_threshold_of_evidence_is_for_as_many_effects_as_there_are():
    """An effect more than it counts makes a false one likelier than UNLIKELY."""
    tried = constants.UNLIKELY * math.exp(constants.EVIDENCE_THRESHOLD)
    assert len(LIBRARY) <= round(tried)


def test_the_limits_name_what_is_not_quasi_steady():
    """Effects with a state of the air, and the one that acts by an acceleration."""
    [words] = re.findall(
        r"\*\*Quasi-steady\*\*, (.*?)\.\n", text_of("docs/limits.md"), re.S
    )
    steady = {ADDED_MASS.kind} | {
        kind.kind for kind in LIBRARY if kind.states and kind.stage != "actuator"
    }
    assert set(re.findall(r"`(\w+)`", words)) == steady


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Names of the files and folders of a report."""
    folder = tmp_path_factory.mktemp("report")
    write_report(make_result(), folder)
    return {p.name + "/" * p.is_dir() for p in folder.iterdir()}


@pytest.mark.parametrize("page", [*FILES, "help"])
def test_the_files_of_a_report_are_listed(page, written, capsys):
    """The folder rivals/ is there if there are some; a first list may leave it out."""
    if page == "help":
        with pytest.raises(SystemExit):
            main(["close-the-loop", "--help"])
        said = " ".join(capsys.readouterr().out.split())
        found = re.findall(r"where to write (.*?) \(default: out/CAMPAIGN", said)
    else:
        found = re.findall(FILES[page], text_of(page), re.MULTILINE)
    listed = set(re.findall(r"\w+(?:\.\w+|/)", " ".join(found)))
    assert listed | {"rivals/"} == written | {"rivals/"}
