"""The same direct collocation of Drake with SNOPT as it comes."""

from benchmarks.bench_planning import KNOTS, plan_plainly
from benchmarks.peers.pairs import Pair
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem


def pairs() -> tuple[Pair, ...]:
    """Returns the article's perch on 41 knots."""
    model, problem = GliderModel(), PerchingProblem()
    costs: dict[str, float] = {}

    def ours():
        costs["ours"] = plan(model, problem, KNOTS).cost

    def theirs():
        costs["theirs"] = plan_plainly(problem)

    return (
        Pair(
            task="plan on 41 knots, checked",
            peer="the same program with SNOPT's defaults",
            ours=ours,
            theirs=theirs,
            told=lambda: f"cost {costs['ours']:.3f} and {costs['theirs']:.3f}",
            rounds=5,
        ),
    )
