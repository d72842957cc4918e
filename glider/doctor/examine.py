"""All checks in order, as lines of text."""

import textwrap
from collections.abc import Iterable, Iterator

from glider.doctor import checks, drake
from glider.doctor.finding import Finding

_WIDTH = 80
_NAME = 15  # Columns for the name of what was looked at.


def examine() -> Iterator[Finding]:
    """Yields what each check finds, the quick ones first."""
    yield checks.check_python()
    yield checks.check_package()
    yield from checks.check_requirements()
    yield checks.check_data()
    yield checks.check_threads()
    yield checks.check_memory()
    yield checks.check_cache()
    yield checks.check_output()
    yield drake.check_compiler()
    yield drake.check_drake()
    yield from drake.check_solvers()
    yield drake.check_meshcat()
    yield checks.check_browser()


def lines_of(finding: Finding) -> str:
    """Returns a finding as lines within 80 columns, the advice under it."""
    start = f"{finding.state:6}{finding.name:{_NAME}}  "
    indent = " " * (6 + _NAME + 2)
    words = [finding.found]
    if finding.advice:
        words.append(f"-> {finding.advice}")
    lines = []
    for text in words:
        lines += textwrap.wrap(
            text, _WIDTH - len(indent), break_on_hyphens=False, break_long_words=False
        )
    return start + f"\n{indent}".join(lines)


def summary_of(findings: Iterable[Finding]) -> str:
    """Returns what all findings come to, as a sentence."""
    states = [f.state for f in findings]
    failing, looking = states.count("fails"), states.count("look")
    if failing:
        return f"{failing} of {len(states)} fail: do what stands after the arrows."
    if looking:
        return f"All that is needed works; {looking} of {len(states)} need a look."
    return "All works."
