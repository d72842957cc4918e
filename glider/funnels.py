"""Funnels: tubes of states that a closed loop never leaves, made, checked and tried.

    funnel = funnels.make_funnel(model, tracking_policy(model, plan), FunnelSettings())
    verdict = funnels.check_funnel(funnel)  # In exact arithmetic.
    proof = funnels.prove_flights(funnel)  # In continuous time; minutes.
    levels = funnels.falsify_funnel(funnel, 8000, rng)

Funnel, FunnelSettings, load_funnel, save_funnel: the funnel and its file.
make_confidence, describe_set: the set of gliders that logs allow, for which a funnel
can be made too. Purpose: what a funnel must be good for. Verdict, FlightProof,
describe_proof: what check and proof show.
falsify_funnel: flights from the boundary that try to leave; above ESCAPE_LEVEL one has.
fly_inside: flights from inside.
FunnelMonitor: a Drake System that reports the margin of a state. funnel_regulator: the
funnel's own feedback as a Drake System; funnel_policy: the same as a policy.
SolverError: there is no funnel.
"""

from glider.physics.confidence import ConfidenceSet, describe_set, make_confidence
from glider.report.check_funnel import describe_proof
from glider.systems.funnel_monitor import FunnelMonitor, funnel_regulator
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.funnel import (
    Funnel,
    funnel_policy,
    load_funnel,
    save_funnel,
)
from glider.verification.funnel.settings import LAUNCH_SIZES, FunnelSettings
from glider.verification.proof.check import Verdict, check_funnel
from glider.verification.proof.flight_proof import FlightProof, prove_flights
from glider.verification.proof.purpose import Purpose
from glider.verification.sos.programs import SolverError
from glider.verification.trials import ESCAPE_LEVEL, falsify_funnel, fly_inside
