"""Which throw next? Proposes throws to a hidden glider until two rivals are separated.

The servo of the hidden glider is two milliseconds late: by a lag, or by a delay? Four
random flights cannot distinguish the two. Each round proposes the throw that separates
them best and predicts the outcome, flies it (the launch a little missed, motion capture
with its noise) and weighs both explanations again, until one has probability 0.95.

    python examples/next_throw.py --figure proposal.png
    python examples/next_throw.py --effect servo_lag --headless --json out.json

--json: {"truth", "found", "throws", "probabilities", "promised"}; the probabilities are
those before the first throw and after each. --figure: the first proposal.
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from diagrams import playback
from diagrams.programs import program
from glider import Campaign, CampaignPlan, GliderModel, InputError, effects, throws

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Separation:
    """How the rivals were separated, flight by flight."""

    truth: str
    """Effect of the hidden glider."""

    probabilities: tuple[dict[str, float], ...]
    """Of each explanation, before the first throw and after each."""

    proposals: tuple[throws.Proposal, ...]
    """Of one throw each, in the order in which they were flown."""

    flights: tuple[throws.Flight, ...]
    """Logs of all flights, the random ones first."""

    @property
    def found(self) -> str:
        """The most probable explanation at the end."""
        last = self.probabilities[-1]
        return max(last, key=lambda name: last[name])

    def key_figures(self) -> dict[str, Any]:
        """Returns the result for a file."""
        return {
            "truth": self.truth,
            "found": self.found,
            "throws": len(self.proposals),
            "probabilities": list(self.probabilities),
            "promised": [p.chance_then for p in self.proposals],
        }

    def describe(self) -> str:
        """Returns the result, a line for each throw."""
        first, *after = (
            ", ".join(f"{name} {p:.2f}" for name, p in probabilities.items())
            for probabilities in self.probabilities
        )
        lines = [f"{GIVEN} flights: {first}"]
        for proposal, now in zip(self.proposals, after, strict=True):
            lines.append(f"one more throw, predicted {proposal.chance_then:.2f}: {now}")
        return "\n".join([*lines, f"the hidden effect was {self.truth}"])


def run(
    effect: str,
    launches: int = 6,
    seed: int = 0,
    progress: program.Progress = program.silent,
) -> Separation:
    """Flies proposed throws of a glider until one of RIVALS has probability ENOUGH.

    Args:
        effect: one of RIVALS, the hidden glider's.
        launches: throws at most.
        seed: of all that is random.
        progress: called with a line of text as the work goes on.
    """
    if effect not in RIVALS:
        raise InputError(
            f"The hidden effect is '{effect}'; expected one of {', '.join(RIVALS)}."
        )
    rng = np.random.default_rng(seed)
    hidden = GliderModel(effects=(RIVALS[effect],))
    campaign = CampaignPlan(flights=GIVEN).simulate(hidden, rng)
    # What an analysis of these flights would find: a late servo, of either kind.
    findings = throws.Findings(
        models=tuple(GliderModel(effects=(rival,)) for rival in RIVALS.values())
    )
    probabilities: list[dict[str, float]] = []
    proposals: list[throws.Proposal] = []
    while True:
        proposal = throws.next_throw(
            campaign, findings, launches=1, seed=seed, progress=progress
        )
        known = {e.name: e.probability for e in proposal.explanations}
        probabilities.append(known)
        if max(known.values()) >= ENOUGH or len(proposals) == launches:
            break
        proposals.append(proposal)
        flight = throws.fly_throw(hidden, proposal.throws[0], proposal.place, rng)
        campaign = with_flight(campaign, flight)
    return Separation(
        truth=effect,
        probabilities=tuple(probabilities),
        proposals=tuple(proposals),
        flights=campaign.flights,
    )


def with_flight(campaign: Campaign, flight: throws.Flight) -> Campaign:
    """Returns a campaign with one more flight, named by its number."""
    name = f"flight_{len(campaign.flights):03d}.csv"
    named = dataclasses.replace(flight, name=name)
    return dataclasses.replace(campaign, flights=(*campaign.flights, named))


def save_proposal(path: Path, found: Separation) -> None:
    """Saves the picture of the first proposal."""
    form = path.suffix.removeprefix(".")
    path.write_bytes(throws.draw_proposal(found.proposals[0], form))


def main(arguments: Sequence[str] | None = None) -> None:
    """Separates the rivals as the command line says, prints and shows how."""
    parser = program.make_parser(__doc__)
    words = "what the hidden glider has (default: %(default)s)"
    parser.add_argument("--effect", choices=RIVALS, default="command_delay", help=words)
    program.add_launches(parser, 6)
    args = program.read_options(parser, arguments, figure="the first proposal, as PNG")
    with program.working("compile (once)") as progress:
        found = run(args.effect, args.launches, args.seed, progress)
    for proposal in found.proposals[:1]:
        print(*throws.sentences(proposal), sep="\n")
    print(found.describe())
    program.write_json(args, found.key_figures())
    if found.proposals:
        program.write_figure(args, save_proposal, found)
    tracks = [
        playback.Track(
            name=f"{'given' if k < GIVEN else 'proposed'} {k}",
            times=flight.time,
            poses=np.column_stack([flight.pose, flight.elevator]),
            color=playback.GREY if k < GIVEN else None,
        )
        for k, flight in enumerate(found.flights)
    ]
    program.show(args, tracks[::-1], f"Which throw: {args.effect}", has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
