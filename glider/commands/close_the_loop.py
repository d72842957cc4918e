"""The command `close-the-loop`: find what the model lacks, from logs of flights."""

import argparse

from glider.commands.output import output, working
from glider.commands.parsing import CommandParser, names, output_folder

DESCRIPTION = """\
Finds what a glider's model lacks, from logs of its flights.

The logs are smoothed, the residual of the flat-plate model is traced to a physical
effect of the library (wind, a slow servo, attached lift, ...), the effect is added
to the model, and the errors on held-out flights are reported before and after.
"""

EPILOG = """\
A campaign is a folder with campaign.yaml and flight_*.csv (columns time, x, z, pitch
and, where there is a servo, elevator, elevator_rate_command; SI units, radians,
positive pitch is nose down), or the name of a sample: glider samples lists these.

examples:
  glider close-the-loop attached_lift
  glider close-the-loop throws --flights flight_000,flight_004 --out out/two
  glider close-the-loop throws --effects wind,servo_lag --json

exit code: 0 when it ran, 2 when the input cannot be used or a file cannot be written,
130 when it was interrupted.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_campaign()
    files = "report.json, report.html, model.yaml and rivals/"
    parser.add_out(files, "out/CAMPAIGN")
    parser.add_argument(
        "--flights", metavar="FILE,...", type=names, help="use only these flights"
    )
    parser.add_argument(
        "--held-out",
        metavar="FRACTION",
        type=float,
        default=0.3,
        help="share of the flights that are held out to measure errors (default: 0.3)",
    )
    parser.add_seed("of the split into fitted and held-out flights")
    words = "try only these effects; others cannot be found then (default: all)"
    parser.add_effects("--effects", words)
    parser.add_cluster()
    parser.add_json("report.json instead of the summary")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    folder = output_folder(args.out, args.campaign)
    with working() as progress:
        from glider.compiled.parallel import workers_of
        from glider.sysid.pipeline import close_the_loop

        with workers_of(args.cluster):
            result = close_the_loop(
                args.campaign,
                flights=args.flights,
                held_out=args.held_out,
                seed=args.seed,
                effects=args.effects,
                progress=progress,
            )
    # Matplotlib takes half a second to import: not before the input is read.
    from glider.files.schema import json_text
    from glider.report.folder import write_report
    from glider.report.terminal import print_summary

    try:
        with working() as progress:
            progress("writing the report")
            write_report(result, folder)
    finally:  # The result is printed even where it cannot be saved.
        if args.json:
            print(json_text(result.report), flush=True)
        else:
            with output() as console:
                print_summary(result, console)
    if not args.json:
        if len(result.alternatives) > 1:
            print(f"Other models that are nearly as likely: {folder / 'rivals'}")
        print(f"Report: {folder / 'report.html'}")
    return 0
