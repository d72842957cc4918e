"""The command `doctor`: tell what works of this installation."""

import argparse

from glider.commands.parsing import Commands, add_command

_DESCRIPTION = """\
Tells what works of this installation and what does not, and what to do then: Python,
libraries and extras, Drake and its solvers, threads, memory, caches, Meshcat, browser.

exit code: 0 when all that is needed works, 1 when something does not.
"""


def add(commands: Commands) -> None:
    """Adds the command to a parser's."""
    add_command(
        commands,
        "doctor",
        run,
        help="tell what works of this installation",
        description=_DESCRIPTION,
    )


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    del args
    from glider.doctor.examine import examine, lines_of, summary_of

    findings = []
    for finding in examine():
        findings.append(finding)
        print(lines_of(finding), flush=True)
    print(f"\n{summary_of(findings)}")
    return 1 if any(f.state == "fails" for f in findings) else 0
