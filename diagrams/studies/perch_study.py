"""A study of a perch: the plan, its replay without feedback, flights with feedback."""

import dataclasses

import numpy as np

from glider.planning.plan import Plan
from glider.simulation.flights import FlownFlight


@dataclasses.dataclass(frozen=True, kw_only=True)
class PerchStudy:
    """A plan and what came of it."""

    plan: Plan
    """Plan that was flown."""

    replayed: FlownFlight
    """Flight of its commands without feedback, from the launch that was planned."""

    blind: list[FlownFlight]
    """Flights of the same from launches that err."""

    flights: list[FlownFlight]
    """Flights from those launches, with feedback."""

    @property
    def misses(self) -> list[float]:
        """Least distance of each flight with feedback from the wire [m]."""
        return [flight.miss for flight in self.flights]

    @property
    def perched(self) -> int:
        """Number of flights with feedback that came within reach of the wire."""
        return sum(flight.perched for flight in self.flights)

    @property
    def worst(self) -> FlownFlight:
        """The flight with feedback that misses by most."""
        return max(self.flights, key=lambda flight: flight.miss)

    def key_figures(self) -> dict[str, object]:
        """Returns the plan's numbers, misses and successes, for a file."""
        return {
            "cost": self.plan.cost,
            "duration": self.plan.duration,
            "knots": len(self.plan.times),
            "plan_seconds": self.plan.seconds,
            "max_defect": self.plan.max_defect,
            "path_defect": self.plan.path_defect,
            "open_loop_miss_m": self.replayed.miss,
            "open_loop_from_launches_miss_m": [flight.miss for flight in self.blind],
            "closed_loop_miss_m": self.misses,
            "perched": self.perched,
            "launches": len(self.flights),
        }

    def describe(self) -> str:
        """Returns the plan, its replay and its flights in a few sentences."""
        plan, blind = self.plan, self.blind
        return (
            f"The plan costs {plan.cost:.2f} and takes {plan.duration:.4f} s "
            f"({len(plan.times)} knots, solved in {plan.seconds:.2f} s).\n"
            f"Replayed without feedback it misses by "
            f"{1000 * self.replayed.miss:.2f} mm; from {len(blind)} launches that err, "
            f"{sum(flight.perched for flight in blind)} perch.\n"
            f"With feedback {self.perched} of {len(self.flights)} perch; the median "
            f"miss is {1000 * np.median(self.misses):.1f} mm, the largest "
            f"{1000 * max(self.misses):.1f} mm."
        )
