"""Which throw next? Proposes throws to a hidden glider until two rivals are separated.

The servo of the hidden glider is a millisecond late: by a lag, or by a delay? Four
random flights cannot distinguish the two. Each round proposes the throw that separates
them best and predicts the outcome, flies it (the launch a little missed, motion capture
with its noise) and weighs both explanations again, until one has probability 0.95.

    python examples/next_throw.py --figure proposal.png
    python examples/next_throw.py --effect servo_lag --headless
"""

import dataclasses
import sys
from collections.abc import Sequence

import numpy as np

from diagrams import playback
from diagrams.programs import program
from glider import CampaignPlan, GliderModel, effects, throws

LATE = 0.0012
"""By how much the hidden glider's servo is late [s]."""

RIVALS = {
    "servo_lag": effects.SERVO_LAG(time_constant=LATE),
    "command_delay": effects.COMMAND_DELAY(delay=LATE),
}
"""Effects that are indistinguishable while they are small."""

ENOUGH = 0.95
"""Probability at which the loop ends."""

GIVEN = 4
"""Number of random flights at the start."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Proposes and flies throws, and prints what they show."""
    parser = program.make_parser(__doc__)
    words = "what the hidden glider has (default: %(default)s)"
    parser.add_argument("--effect", choices=RIVALS, default="command_delay", help=words)
    program.add_launches(parser, 6)
    words = "the first proposal, as PNG"
    args = program.read_options(parser, arguments, figure=words)

    rng = np.random.default_rng(args.seed)
    hidden = GliderModel(effects=(RIVALS[args.effect],))
    campaign = CampaignPlan(flights=GIVEN).simulate(hidden, rng)
    # What an analysis of these flights would find: a late servo, of either kind.
    models = tuple(GliderModel(effects=(rival,)) for rival in RIVALS.values())
    findings = throws.Findings(models=models)
    for flown in range(args.launches + 1):
        with program.working("propose (compiles once)") as progress:
            proposal = throws.next_throw(
                campaign, findings, launches=1, seed=args.seed, progress=progress
            )
        known = {e.name: e.probability for e in proposal.explanations}
        shown = ", ".join(f"{name} {p:.2f}" for name, p in known.items())
        print(f"{GIVEN} flights and {flown} throws: {shown}")
        if max(known.values()) >= ENOUGH or flown == args.launches:
            break
        if flown == 0:
            print(*throws.sentences(proposal), sep="\n")
            if args.figure:
                form = args.figure.suffix.removeprefix(".")
                args.figure.write_bytes(throws.draw_proposal(proposal, form))
        flight = throws.fly_throw(hidden, proposal.throws[0], proposal.place, rng)
        name = f"flight_{len(campaign.flights):03d}.csv"
        flight = dataclasses.replace(flight, name=name)
        flights = (*campaign.flights, flight)
        campaign = dataclasses.replace(campaign, flights=flights)
    print(f"the hidden effect was {args.effect}")

    tracks = []
    for k, flight in enumerate(campaign.flights):
        is_given = k < GIVEN
        track = playback.Track(
            name=f"{'given' if is_given else 'proposed'} {k}",
            times=flight.time,
            poses=np.column_stack([flight.pose, flight.elevator]),
            color=playback.GREY if is_given else None,
        )
        tracks.append(track)
    program.show(args, tracks[::-1], f"Which throw: {args.effect}", has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
