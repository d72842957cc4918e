"""Shows a logged flight in Meshcat, with the flights that two models make of it.

The measured glider is solid; arrows show the forces of wing and elevator that the
corrected model sees along its way. Its ghosts are the nominal model (red) and the
corrected model (green), both launched as the flight was and then left alone.

    python examples/watch_log.py attached_lift flight_003
    python examples/watch_log.py CAMPAIGN FLIGHT --model out/CAMPAIGN/model.yaml
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from diagrams import playback
from diagrams.programs import program
from glider import GliderModel, close_the_loop, load_campaign, refly


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies a logged flight again, prints the errors of the models and shows it."""
    parser = program.make_parser(__doc__)
    parser.add_argument("campaign", type=Path, help="folder of flight logs or sample")
    parser.add_argument("flight", help="one of them, such as flight_003")
    words = "corrected model (default: what closing the loop finds, in a minute)"
    parser.add_path("--model", "FILE", words)
    args = program.read_options(parser, arguments)

    campaign = load_campaign(args.campaign)
    flight = refly.find_flight(campaign, args.flight)
    models = {}
    if nominal := refly.nominal_model(campaign):  # None of an unknown glider.
        models["nominal"] = nominal
    with program.working("fly again (compiles once)") as progress:
        if args.model:
            models["corrected"] = GliderModel.load(args.model)
        else:
            models["corrected"] = close_the_loop(campaign, progress=progress).model
        motions = refly.refly(campaign, flight, models)

    time = motions["measured"].time
    print(f"{flight.name}: {len(time)} rows in {time[-1]:.2f} s")
    for name, (rms, end) in refly.position_errors(motions).items():
        print(f"{name}: {1000 * rms:.0f} mm off (RMS), {1000 * end:.0f} mm at the end")
    colors = {"nominal": playback.RED, "corrected": playback.GREEN}
    tracks = []
    for name, motion in motions.items():
        tracks.append(playback.track_of(name, motion, colors.get(name)))
    title = f"{campaign.name}, {flight.name}"
    sizes = refly.nominal_parameters(campaign)
    program.show(args, tracks, title, parameters=sizes, has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
