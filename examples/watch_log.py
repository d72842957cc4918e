"""Shows a logged flight in Meshcat, with the flights that two models make of it.

The measured glider is solid; arrows show the forces of wing and elevator that the
corrected model sees along its way. Its ghosts are the nominal model (red) and the
corrected model (green), both launched as the flight was and then left alone.

    python examples/watch_log.py attached_lift flight_003
    python examples/watch_log.py CAMPAIGN FLIGHT --model out/CAMPAIGN/model.yaml
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from diagrams import playback
from diagrams.programs import program
from glider import Campaign, GliderModel, close_the_loop, load_campaign, refly


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """A flight "measured", "nominal" where that model is known, and "corrected"."""

    flight: refly.Flight
    motions: dict[str, refly.Motion]

    @property
    def errors(self) -> dict[str, tuple[float, float]]:
        """RMS and last distance of each model from what was measured [m]."""
        return refly.position_errors(self.motions)


def fly(
    campaign: Campaign,
    name: str,
    model: Path | None = None,
    progress: program.Progress = program.silent,
) -> Result:
    """Flies a logged flight again, with the nominal and with a corrected model."""
    flight, nominal = refly.find_flight(campaign, name), refly.nominal_model(campaign)
    models = {} if nominal is None else {"nominal": nominal}
    if model:
        models["corrected"] = GliderModel.load(model)
    else:
        models["corrected"] = close_the_loop(campaign, progress=progress).model
    return Result(flight=flight, motions=refly.refly(campaign, flight, models))


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    parser.add_argument("campaign", type=Path, help="folder of flight logs or sample")
    parser.add_argument("flight", help="one of them, such as flight_003")
    words = "corrected model (default: what closing the loop finds, in a minute)"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    args = program.read_options(parser, arguments)
    campaign = load_campaign(args.campaign)
    with program.working("fly again (compiles once)") as progress:
        flown = fly(campaign, args.flight, args.model, progress)
    name, time = flown.flight.name, flown.motions["measured"].time
    print(f"{name}: {len(time)} rows in {time[-1]:.2f} s")
    duration = float(time[-1])
    figures: dict = {"flight": name, "rows": len(time), "duration_s": duration}
    for model, (rms, end) in flown.errors.items():
        figures[model] = {"position_rms_m": rms, "position_end_m": end}
        print(f"{model}: {1000 * rms:.0f} mm off (RMS), {1000 * end:.0f} mm at the end")
    program.write_json(args, figures)
    colors = {"nominal": playback.RED, "corrected": playback.GREEN}
    tracks = [playback.track_of(n, m, colors.get(n)) for n, m in flown.motions.items()]
    title, parameters = f"{campaign.name}, {name}", refly.nominal_parameters(campaign)
    program.show(args, tracks, title, parameters=parameters, has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
