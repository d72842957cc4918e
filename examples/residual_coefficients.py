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
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console

from diagrams.playback import (
    GREEN,
    GREY,
    RED,
    Track,
    stage_of,
)
from diagrams.showing import (
    add_options,
    check_folders,
    run,
    show,
    whole_number,
    write_figures,
)
from glider.campaign.logs import (
    Campaign,
    Flight,
)
from glider.campaign.reader import load_campaign
from glider.paths import models_path
from glider.physics.model import (
    GliderModel,
    save_model,
)
from glider.studies.coefficients import (
    COEFFICIENTS,
    ResidualModel,
    ResidualStudy,
    corrected_coefficients,
    learn_residuals,
)
from glider.studies.plots.coefficients import save_coefficients_figure
from glider.sysid import refly

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


def read_options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Returns the options of the command line."""
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
    return args


def tell(campaign: Campaign, study: ResidualStudy) -> dict:
    """Prints what each model errs on held-out flights; returns it for --json."""
    for name, model in study.models.items():
        print(
            f"{WORDS[name]}: C_L {model.rms[0]:.3f}, C_D {model.rms[1]:.3f}, "
            f"C_M {model.rms[2]:.4f} m off (RMS); rollouts "
            f"{1000 * model.errors.position_rms_m:.0f} mm"
        )
    fitted, held_out = (len(data.plate) for data in (study.fitted, study.held_out))
    return {
        "campaign": campaign.name,
        "rows": {"fitted": fitted, "held_out": held_out},
        "models": {name: describe(model) for name, model in study.models.items()},
    }


def draw(file: Path, study: ResidualStudy) -> None:
    """Saves the coefficients of the held-out flights as a figure."""
    seen = study.held_out
    values = {
        WORDS[name]: corrected_coefficients(seen, model.field)
        for name, model in study.models.items()
    }
    save_coefficients_figure(file, seen.variables["alpha"], seen.measured, values)


def fly(
    campaign: Campaign, flight: Flight, models: Mapping[str, GliderModel]
) -> list[Track]:
    """Returns a held-out flight as measured and as the models fly it."""
    motions = refly.refly(campaign, flight, models).items()
    return [
        Track(name=name, times=motion.time, poses=motion.poses, color=color)
        for (name, motion), color in zip(motions, (None, GREY, RED, GREEN), strict=True)
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Learns from a campaign, compares on held-out flights, and shows one of them."""
    args = read_options(arguments)
    campaign = load_campaign(args.campaign)
    with Console(stderr=True).status("learn (compiles once)"):
        study = learn_residuals(campaign, seed=args.seed)
    write_figures(args, tell(campaign, study))
    drawing = refly.drawing_of(campaign)
    models = {
        WORDS[name]: GliderModel(parameters=drawing, field=model.field)
        for name, model in study.models.items()
    }
    if args.model:
        save_model(args.model, models[WORDS["26"]])
    if args.figure:
        draw(args.figure, study)
    if args.headless and not args.html:
        return
    flight = study.unseen[0]
    tracks = fly(campaign, flight, models)
    stage = stage_of(tracks[0], wire=None)
    title = f"{campaign.name}, {flight.name}"
    show(args, tracks, title, parameters=drawing, stage=stage)


if __name__ == "__main__":
    sys.exit(run(main))
