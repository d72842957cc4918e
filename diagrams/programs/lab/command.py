"""The command `lab`: a session in the lab, with the loop closed between throws."""

import argparse
import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from glider.commands.parsing import CommandParser

if TYPE_CHECKING:
    from diagrams.programs.lab.launches import Launches

DESCRIPTION = """\
Watches the folder of a session: each throw that comes is checked, flown again by the
nominal and by the corrected model, and traced in the background with all before it. A
page in the browser shows the last throw, all throws and what was excluded, the effects
against the number of throws, the verdict, the perches and the next throw to make.
"""

EPILOG = """\
The folder is a campaign, as `glider fly --log FOLDER` writes it live, or it holds a
MAP.yaml and takes that other software exports (glider import --guess proposes the
map). All that the session finds is in FOLDER/lab: report/ is that of close-the-loop,
and a session that was ended goes on where it was, at the same address. The page is
served on this computer only, to those who have the address with its token.

examples:
  glider lab out/session
  glider lab out/session --simulate head_wind             # launch from the page
  glider fly --simulate head_wind --model out/session/lab/report/model.yaml

exit code: 0 when the session was ended, 2 when the input cannot be used.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_argument("folder", type=Path, help="folder that throws come into")
    words = "launch a simulated glider: a model file, or a name in models/truths"
    parser.add_argument("--simulate", metavar="TRUTH", help=words)
    words = "scenario of the station, for its bus, or of simulated launches"
    parser.add_path("--scenario", "YAML", words)
    words = "simulated launches that the page offers at a time (default: 10)"
    parser.add_number("--throws", words, 10, least=3)
    words = "of the page (default: any free one)"
    parser.add_number("--port", words, 0, most=65535)
    parser.add_seed("of simulated launches and noise")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from diagrams.programs.lab.launches import Launches
    from diagrams.programs.station.scenario import make_scenario

    scenario = make_scenario(args.scenario, args.simulate)
    bus = scenario.address
    launches = None
    if args.simulate is not None:
        _ = scenario.truth  # It is there.
        args.folder.mkdir(parents=True, exist_ok=True)
        launches = Launches(
            folder=args.folder,
            truth=args.simulate,
            scenario=args.scenario,
            seed=args.seed,
            count=args.throws,
            bus=bus,
        )
    _serve(args, launches, bus)
    return 0


def _serve(args: argparse.Namespace, launches: "Launches | None", bus: str) -> None:
    """Opens the session and serves its page until Ctrl-C."""
    from diagrams.programs.lab.link import StationLink
    from diagrams.programs.lab.server import serve
    from diagrams.programs.lab.session import LabSession

    link = None
    try:
        link = StationLink(bus)
    except RuntimeError as error:  # As without any network.
        _show(f"No bus {bus}: the page has no Stop, and shows no station ({error}).")
    session = LabSession(args.folder, _show, launches, link)
    try:
        serve(session, args.port, _show)
    finally:
        session.close()


def _show(line: str) -> None:
    with contextlib.suppress(OSError):  # A terminal that is gone ends no session.
        print(line, flush=True)
