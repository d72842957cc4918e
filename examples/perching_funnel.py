"""Certifies a perch: how large may launch errors be, nominal and corrected model?

A funnel is a tube of states about the plan that the closed loop never leaves and that
ends at the wire. Sums of squares prove it for the third-order dynamics, the servo's
rate and travel limits inside, and exact arithmetic checks the proof. Flights of the
full dynamics from its boundary try to leave it. (`glider check-funnel FILE --prove`
proves, in continuous time, that no flight leaves a funnel that was made with a
remainder.)

The true glider has an effect that its nominal model lacks. It flies with that model's
plan, its logs are traced, and a second funnel is made with the corrected model. Does
the true glider stay in the first funnel, and in the second?

    python examples/perching_funnel.py --load models/funnels
    python examples/perching_funnel.py --truth slow_servo --save out --figure tubes.png
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from diagrams import closed_loop, draw_tube, playback, plot_tube, simulate_flights
from diagrams.programs import program
from glider import (
    GliderModel,
    InputError,
    PerchingProblem,
    close_the_loop,
    funnels,
    plan,
    tracking_policy,
    tracking_regulator,
)

SETTINGS = funnels.FunnelSettings(remainder=1.1)
"""How a funnel is made: with a bound 1.1 times the largest remainder that is found."""


def make_funnels(
    truth: GliderModel, rng: np.random.Generator, progress: program.Progress
) -> list[funnels.Funnel]:
    """Makes funnels of the nominal model and of the one that its flights' logs show."""
    problem = PerchingProblem()
    nominal = GliderModel(parameters=truth.parameters)
    planned = plan(nominal, problem, progress=progress)
    loop = closed_loop(
        truth,
        tracking_regulator(nominal, planned),
        planned=nominal,
        command_rate=50.0,
        motion_capture=120.0,
    )
    starts = problem.draw_launches(20, rng)
    end = planned.duration + 0.1
    flown = simulate_flights(loop, starts, end, capture_noise=rng, progress=progress)
    found = close_the_loop(flown.campaign, progress=progress)
    made = []
    for model in (nominal, found.model):
        policy = tracking_policy(model, plan(model, problem))
        made.append(funnels.make_funnel(model, policy, SETTINGS, progress=progress))
    return made


def escapes(
    funnel: funnels.Funnel,
    samples: int,
    rng: np.random.Generator,
    truth: GliderModel | None = None,
) -> int:
    """Counts the flights from a funnel's boundary that leave it."""
    levels = funnels.falsify_funnel(funnel, samples, rng, truth)
    return int(np.count_nonzero(levels > funnels.ESCAPE_LEVEL))


def least_margin(funnel: funnels.Funnel, truth: GliderModel) -> float:
    """Flies a glider as planned, a FunnelMonitor watching it in its Drake diagram.

    Returns:
        the least margin: 1 at the nominal flight, negative outside of the funnel.
    """
    model = funnel.nominal.model
    loop = closed_loop(truth, funnels.funnel_regulator(funnel), planned=model)
    builder = DiagramBuilder()
    builder.AddSystem(loop)
    monitor = builder.AddNamedSystem("monitor", funnels.FunnelMonitor(funnel))
    builder.Connect(loop.GetOutputPort("state"), monitor.get_input_port())
    log = LogVectorOutput(monitor.GetOutputPort("margin"), builder, 0.005)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    glider = loop.GetSubsystemByName("glider").GetMyMutableContextFromRoot(context)
    glider.SetContinuousState(funnel.nominal.states[0])
    simulator.AdvanceTo(funnel.nominal.times[-1])
    return float(log.FindLog(context).data().min())


def main(arguments: Sequence[str] | None = None) -> None:
    """Makes or loads both funnels, tries them and shows them."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "head_wind")
    parser.add_number("--samples", "flights from a boundary", 8000, least=8)
    parser.add_seed("of flights")
    words = "folder of drawn.npz and TRUTH.npz, which are not made then"
    parser.add_argument("--load", metavar="DIR", type=Path, help=words)
    parser.add_argument("--save", metavar="DIR", type=Path, help="where to save them")
    args = program.read_options(parser, arguments, figure="tubes, as PNG")
    truth = GliderModel.load(args.truth)
    names = ("drawn.npz", f"{Path(args.truth).stem}.npz")
    if args.save:
        program.check_files(*(args.save / name for name in names))

    rng = np.random.default_rng(args.seed)
    with program.working("plan (compiles once)") as progress:
        if args.load:
            both = [funnels.load_funnel(args.load / name) for name in names]
        else:
            both = make_funnels(truth, rng, progress)
    if args.save:
        for name, funnel in zip(names, both, strict=True):
            funnels.save_funnel(args.save / name, funnel)

    paths = []
    for words, funnel in zip(("nominal", "corrected"), both, strict=True):
        with program.working(f"check and fly the funnel of the {words} model"):
            purpose = funnels.Purpose(problem=PerchingProblem())
            holds = funnels.check_funnel(funnel, purpose=purpose).holds
            own = escapes(funnel, args.samples, rng)
            paths.append(funnels.fly_inside(funnel, 40, rng))
        _, height, pitch, _, speed = funnel.half_widths()[:5]
        print(
            f"{words} model: launch errors of up to {100 * height:.1f} cm in height, "
            f"{np.degrees(pitch):.1f}° in pitch or {speed:.2f} m/s in speed.\n"
            f"  Its certificate {'holds' if holds else 'DOES NOT HOLD'}; {own} "
            f"of {args.samples} flights from its boundary leave it."
        )
        try:
            flown = escapes(funnel, args.samples, rng, truth)
            margin = least_margin(funnel, truth)
        except InputError:
            print(f"  {args.truth} lacks states of its model, and is not flown.")
            continue
        print(
            f"  Flown by {args.truth}, {flown} of {args.samples} leave it. "
            f"Launched as planned, its least margin is {margin:.2f}."
        )

    if args.figure:
        figure = Figure(figsize=(10.0, 6.0), layout="constrained")
        for ax, funnel, flown in zip(figure.subplots(2, 1), both, paths, strict=True):
            plot_tube(ax, funnel)
            for path in flown:
                ax.plot(*path[:, :2].T, color="k", lw=0.5, alpha=0.35)
        figure.savefig(args.figure, dpi=120)
    plan_of_funnel = funnels.funnel_policy(both[-1]).plan
    inside = playback.Track(
        name="a flight inside",
        times=plan_of_funnel.times,
        poses=paths[-1][0, :, :4],
        color=playback.GREY,
    )
    tracks = [playback.track_of("nominal", plan_of_funnel), inside]
    meshcat = program.start_meshcat(args)
    if meshcat is not None:
        draw_tube(meshcat, both[-1])
        playback.play(tracks, meshcat, rate=args.rate)
    program.finish(args, meshcat, tracks, f"A certified perch: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
