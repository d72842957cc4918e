"""A study of a perch: the plan, its replay without feedback, flights with feedback."""

import dataclasses

from glider.planning.plan import Plan
from glider.simulation.flown_flights import FlownFlight, Perches


@dataclasses.dataclass(frozen=True, kw_only=True)
class PerchStudy:
    """A plan and what came of it."""

    plan: Plan
    """Plan that was flown."""

    replayed: FlownFlight
    """Flight of its commands without feedback, from the launch that was planned."""

    blind: Perches
    """Flights of the same from launches that err."""

    flights: Perches
    """Flights from those launches, with feedback."""

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
            "open_loop_from_launches": self.blind.key_figures(),
            "closed_loop": self.flights.key_figures(),
            "launches": len(self.flights),
        }

    def describe(self) -> str:
        """Returns the plan, its replay and its flights in a few sentences."""
        plan = self.plan
        return (
            f"The plan costs {plan.cost:.2f} and takes {plan.duration:.4f} s "
            f"({len(plan.times)} knots, solved in {plan.seconds:.2f} s).\n"
            f"Replayed without feedback it misses by "
            f"{1000 * self.replayed.miss:.2f} mm; from launches that err: "
            f"{self.blind.describe()}.\n"
            f"With feedback {self.flights.describe()}; the largest miss is "
            f"{1000 * max(self.flights.misses):.1f} mm."
        )
