"""How is the flat plate wrong? C_L, C_D and C_M learned from a campaign of flights.

Measured accelerations, referred to ½ρV²S_w, stand beside the flat plate's. What it
lacks is learned as Gaussian functions of the angle of attack and the elevator (26
weights a coefficient, one linear solve), and of the airspeed as well (126). Flights
left out tell what the residual is worth in the plant, as an effect like any other.
No weight tells why: for that, see `close_the_loop.py`, which names the effect.

    python examples/residual_coefficients.py
    python examples/residual_coefficients.py CAMPAIGN --figure coefficients.png
    python examples/residual_coefficients.py --headless --model glider.yaml

--json, errors on held-out flights: {"campaign", "rows": {"fitted", "held_out"},
"models": {"plate" | "26" | "126": {"c_lift", "c_drag", "c_moment": RMS error,
"equation": {"tangential", "normal", "pitch": RMS [m/s², m/s², rad/s²]},
"rollout": {"position_rms_m", "position_end_m", "pitch_rms_rad"}}}}.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from diagrams.playback import GREEN, GREY, RED, Track, stage_of
from diagrams.showing import (
    add_options,
    check_folders,
    run,
    show,
    whole_number,
    write_figures,
)
from glider.model_file import GliderModel, save_model
from glider.paths import models_path
from glider.plots.coefficients import save_coefficients_figure
from glider.sysid import refly
from glider.sysid.campaign_reader import load_campaign
from glider.sysid.coefficients import (
    COEFFICIENTS,
    ResidualModel,
    corrected_coefficients,
    learn_residuals,
)

WORDS = {"plate": "flat plate", "26": "26 weights", "126": "126 weights"}


def describe(model: ResidualModel) -> dict:
    """Returns a model's errors on held-out flights for --json."""
    e = model.errors
    return {
        **dict(zip(COEFFICIENTS, model.rms.tolist(), strict=True)),
        "equation": {k: getattr(e, k) for k in ("tangential", "normal", "pitch")},
        "rollout": {
            k: getattr(e, k)
            for k in ("position_rms_m", "position_end_m", "pitch_rms_rad")
        },
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, learns, compares, prints and shows what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    sample = models_path("campaigns", "attached_lift")
    parser.add_argument("campaign", nargs="?", type=Path, default=sample)
    parser.add_argument("--seed", type=whole_number(0), default=0, help="of the split")
    parser.add_argument("--model", metavar="FILE", type=Path, help="glider, 26 weights")
    parser.add_argument("--figure", metavar="FILE", type=Path, help="as PNG")
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure, args.model)

    campaign = load_campaign(args.campaign)
    with Console(stderr=True).status("learn (compiles once)"):
        study = learn_residuals(campaign, seed=args.seed)
    seen = study.held_out
    figures: dict = {"campaign": campaign.name, "models": {}}
    figures["rows"] = {"fitted": len(study.fitted.plate), "held_out": len(seen.plate)}
    drawing, models, values = refly.drawing_of(campaign), {}, {}
    for name, model in study.models.items():
        figures["models"][name] = describe(model)
        models[WORDS[name]] = GliderModel(parameters=drawing, field=model.field)
        values[WORDS[name]] = corrected_coefficients(seen, model.field)
        print(
            f"{WORDS[name]}: C_L {model.rms[0]:.3f}, C_D {model.rms[1]:.3f}, "
            f"C_M {model.rms[2]:.4f} m off (RMS); rollouts "
            f"{1000 * model.errors.position_rms_m:.0f} mm"
        )
    write_figures(args, figures)
    if args.model:
        save_model(args.model, models[WORDS["26"]])
    if args.figure:
        alpha, measured = seen.variables["alpha"], seen.measured
        save_coefficients_figure(args.figure, alpha, measured, values)
    if args.headless and not args.html:
        return
    flight = study.unseen[0]
    colors = [None, GREY, RED, GREEN]
    motions = refly.refly(campaign, flight, models).items()
    tracks = [
        Track(name=name, times=motion.time, poses=motion.poses, color=color)
        for (name, motion), color in zip(motions, colors, strict=True)
    ]
    stage = stage_of(tracks[0], wire=None)
    title = f"{campaign.name}, {flight.name}"
    show(args, tracks, title, parameters=drawing, stage=stage)


if __name__ == "__main__":
    sys.exit(run(main))
