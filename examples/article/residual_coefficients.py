"""How is the flat plate wrong? C_L, C_D and C_M learned from a campaign of flights.

Measured accelerations, referred to ½ρV²S_w, stand beside the flat plate's. What it
lacks is learned as Gaussian functions of the angle of attack and the elevator (26
weights a coefficient, one linear solve), and of the airspeed as well (126). Held-out
flights show what the residual is worth in the plant, as an effect like any other.
No weight explains why: for that, see `close_the_loop.py`, which names the effect.

    python examples/article/residual_coefficients.py
    python examples/article/residual_coefficients.py CAMPAIGN --figure coefficients.png
    python examples/article/residual_coefficients.py --headless --model glider.yaml

--json, errors on held-out flights: {"campaign", "rows": {"fitted", "held_out"},
"models": {"plate" | "26" | "126": {"c_lift", "c_drag", "c_moment": RMS error,
"equation": {"tangential", "normal", "pitch": RMS [m/s², m/s², rad/s²]},
"rollout": {"position_rms_m", "position_end_m", "pitch_rms_rad"}}}}.
"""

import dataclasses
import sys
from collections.abc import Sequence

from coefficient_figures import save_residual_figure
from diagrams.playback import GREEN, GREY, RED, Track
from diagrams.programs import program
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from glider.physics.model import GliderModel
from glider.simulation import refly
from residual_study import WORDS, ResidualStudy, learn_residuals


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """What was learned, as models, and a held-out flight as they fly it."""

    study: ResidualStudy
    models: dict[str, GliderModel]
    motions: dict[str, refly.Motion]


def fly(campaign: Campaign, seed: int = 0) -> Result:
    """Learns from a campaign, and flies one of the held-out flights again."""
    study = learn_residuals(campaign, seed=seed)
    parameters = refly.nominal_parameters(campaign)
    models = {
        WORDS[name]: GliderModel(
            parameters=parameters,
            free_functions=[] if learned.residual is None else [learned.residual],
        )
        for name, learned in study.models.items()
    }
    motions = refly.refly(campaign, study.unseen[0], models)
    return Result(study=study, models=models, motions=motions)


def main(arguments: Sequence[str] | None = None) -> None:
    """Learns as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_campaign(parser)
    program.add_count(parser, "--seed", 0, "of the split", least=0)
    program.add_file(parser, "--model", "glider, 26 weights")
    args = program.read_options(parser, arguments, figure="as PNG")
    program.check_files(args.model)
    campaign = load_campaign(args.campaign)
    with program.working("learn (compiles once)"):
        found = fly(campaign, args.seed)
    print(found.study.describe())
    program.write_json(args, {"campaign": campaign.name, **found.study.key_figures()})
    if args.model:
        found.models[WORDS["26"]].save(args.model)
    program.write_figure(args, save_residual_figure, found.study)
    colors = {WORDS["plate"]: GREY, WORDS["26"]: RED, WORDS["126"]: GREEN}
    flown = found.motions.items()
    tracks = [
        Track(name=n, times=m.time, poses=m.poses, color=colors.get(n))
        for n, m in flown
    ]
    title = f"{campaign.name}, {found.study.unseen[0].name}"
    parameters = refly.nominal_parameters(campaign)
    program.show(args, tracks, title, parameters=parameters, has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
