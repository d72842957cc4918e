"""The command `rehearse`: which effects a campaign's flights would show."""

import argparse

from glider.commands.output import output, working
from glider.commands.parsing import CommandParser, default_folder, output_folder

DESCRIPTION = """\
Rehearses a campaign: which effects would its flights show, from which size up, and what
would be taken for another? Launches, commands, clocks, gaps, noise and moving air are
those of the campaign. Each effect is planted in many campaigns that are drawn to first
order, and in one that is flown and traced; campaigns without it show the false alarms.
"""

EPILOG = """\
examples:
  glider rehearse throws
  glider rehearse throws --effects camber,tail_wake --size 0.1
  glider rehearse throws --no-flights

The model of the glider is that of --report; without a report, the campaign is traced
first. Its campaign.yaml must give the mass and areas of the glider, and effects that
the model has already cannot be planted. Ten effects take about two minutes.

exit code: 0 when it ran, 2 when the input cannot be used.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_campaign()
    words = "folder that close-the-loop wrote of it (default: out/CAMPAIGN, if there)"
    parser.add_path("--report", "DIR", words)
    words = "effects to plant, none that the model has (default: ten that are likely)"
    parser.add_effects("--effects", words)
    words = "their size, 0.001 to 3 typical ones of the catalogue (default: 1)"
    parser.add_number("--size", words, 1.0, kind=float, least=1e-3, most=3.0)
    parser.add_switch("--no-flights", "draw campaigns only; fly and trace none")
    parser.add_out("rehearsal.json and rehearsal.png", "out/CAMPAIGN/rehearsal")
    parser.add_seed("of what is drawn")
    parser.add_json("rehearsal.json, no table")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    folder = output_folder(args.out, args.campaign, "rehearsal")
    report = args.report or default_folder(args.campaign)
    with working() as progress:
        from glider.campaign.samples import campaign_folder
        from glider.experiments.explanations import load_findings
        from glider.experiments.rehearsal import rehearse
        from glider.files.schema import json_text
        from glider.report.rehearsal import print_rehearsal, to_json, write_rehearsal
        from glider.sysid.pipeline import check_names

        check_names(args.effects)
        campaign_folder(args.campaign)  # Else its report would be missed.
        has_report = args.report or (report / "report.json").exists()
        findings = load_findings(report) if has_report else None
        rehearsal = rehearse(
            args.campaign,
            findings,
            effects=args.effects,
            size=args.size,
            flies=not args.no_flights,
            seed=args.seed,
            progress=progress,
        )
        write_rehearsal(rehearsal, folder)
    if args.json:
        print(json_text(to_json(rehearsal)))
    else:
        with output() as console:
            print_rehearsal(rehearsal, console)
        print(f"Picture: {folder / 'rehearsal.png'}")
    return 0
