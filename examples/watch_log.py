"""Shows a logged flight in Meshcat, with the flights that two models make of it.

The measured glider is solid; arrows show the forces of wing and elevator that the
corrected model sees along its way. Its ghosts are the drawing (red) and the
corrected model (green), both launched as the flight was and then left alone.

    python examples/watch_log.py models/campaigns/attached_lift flight_003
    python examples/watch_log.py CAMPAIGN FLIGHT --model out/CAMPAIGN/model.yaml
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from diagrams.playback import (
    GREEN,
    RED,
    Track,
    stage_of,
)
from diagrams.showing import (
    add_options,
    check_folders,
    run,
    show,
    write_figures,
)
from glider.campaign.reader import load_campaign
from glider.physics.model import load_model
from glider.sysid import refly
from glider.sysid.pipeline import close_the_loop


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, flies again, prints and shows what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaign", type=Path, help="folder of flight logs")
    parser.add_argument("flight", help="one of them, such as flight_003")
    model_help = "corrected model (default: what closing the loop finds, in a minute)"
    parser.add_argument("--model", metavar="FILE", type=Path, help=model_help)
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html)

    campaign = load_campaign(args.campaign)
    flight = refly.find_flight(campaign, args.flight)
    drawn = refly.drawn_model(campaign)
    models = {} if drawn is None else {"as drawn": drawn}
    with Console(stderr=True).status("fly again (compiles once)") as status:
        if args.model:
            models["corrected"] = load_model(args.model)
        else:
            models["corrected"] = close_the_loop(campaign, progress=status.update).model
        motions = refly.refly(campaign, flight, models)
    measured = motions["measured"]
    figures: dict = {"flight": flight.name, "rows": len(measured.time)}
    figures["duration_s"] = float(measured.time[-1])
    print(f"{flight.name}: {figures['rows']} rows in {figures['duration_s']:.2f} s")
    for name in models:
        rms, end = refly.position_error(measured, motions[name])
        figures[name.replace(" ", "_")] = {"position_rms_m": rms, "position_end_m": end}
        print(f"{name}: {1000 * rms:.0f} mm off (RMS), {1000 * end:.0f} mm at the end")
    write_figures(args, figures)

    color = {"as drawn": RED, "corrected": GREEN}.get
    tracks = [
        Track(name=n, times=m.time, poses=m.poses, color=color(n), forces=m.forces)
        for n, m in motions.items()
    ]
    stage = stage_of(tracks[0], wire=None)
    title = f"{campaign.name}, {flight.name}"
    show(args, tracks, title, parameters=refly.drawing_of(campaign), stage=stage)


if __name__ == "__main__":
    sys.exit(run(main))
