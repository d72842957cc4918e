"""The command `next-throw`: throws that distinguish a campaign's explanations."""

import argparse

from glider.commands.output import output, working
from glider.commands.parsing import CommandParser, default_folder, output_folder

DESCRIPTION = """\
Proposes the next throws of a campaign: launches and elevator commands that best
distinguish the explanations that its flights leave, then tighten the coefficients that
move the end of a flight. It reports what to expect of them, and when nothing more is to
be learned.
"""

EPILOG = """\
Throws stay within what was flown: launch, floor, speed; --limits FILE.yaml has others:

  launch_height: [0.0, 0.4]   # m; launch_speed [m/s], launch_climb, launch_pitch [rad]
  z: [-0.8, 1.5]              # m, floor and ceiling; x [m], pitch [rad]
  speed: 9.0                  # m/s at most; elevator [rad], elevator_rate [rad/s]
  missed_speed: 0.2           # m/s, launch error (2σ); missed_height, missed_pitch

examples:
  glider close-the-loop throws --out out/throws
  glider next-throw throws --report out/throws --launches 3
  glider next-throw throws --report out/throws --limits launcher.yaml

exit code: 0 when it ran, 2 when the input cannot be used.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_campaign()
    words = "folder that close-the-loop wrote of it (default: out/CAMPAIGN)"
    parser.add_path("--report", "DIR", words)
    words = "how many throws to propose (default: 3)"
    parser.add_number("--launches", words, 3, least=1)
    parser.add_path("--limits", "FILE.yaml", "limits of the throws")
    files = "commands_N.csv, next_throw.json and next_throw.png"
    parser.add_out(files, "out/CAMPAIGN/next_throw")
    parser.add_seed("of the search")
    parser.add_cluster()
    parser.add_json("next_throw.json, no sentences")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    folder = output_folder(args.out, args.campaign, "next_throw")
    with working() as progress:
        from glider.campaign.samples import campaign_folder
        from glider.compiled.parallel import workers_of
        from glider.experiments.explanations import load_findings
        from glider.experiments.proposal import next_throw
        from glider.experiments.throw_limits import load_limits

        limits = load_limits(args.limits) if args.limits else None
        campaign_folder(args.campaign)  # Else its report would be missed.
        report = args.report or default_folder(args.campaign)
        with workers_of(args.cluster):
            proposal = next_throw(
                args.campaign,
                load_findings(report),
                launches=args.launches,
                limits=limits,
                seed=args.seed,
                progress=progress,
            )
        from glider.files.schema import json_text
        from glider.report.next_throw import print_proposal, to_json, write_proposal

        write_proposal(proposal, folder)
    if args.json:
        print(json_text(to_json(proposal)))
    else:
        with output() as console:
            print_proposal(proposal, folder, console)
        print(f"Picture: {folder / 'next_throw.png'}")
    return 0
