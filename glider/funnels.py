"""Funnels: tubes of states that a closed loop never leaves, made, checked and tried.

    funnel = funnels.make_funnel(model, tracking_policy(model, plan), FunnelSettings())
    verdict = funnels.check_funnel(funnel)  # In exact arithmetic.
    proof = funnels.prove_flights(funnel)  # In continuous time; minutes.
    trial = funnels.falsify_funnel(funnel, 8000, rng)

Funnel, FunnelSettings, load_funnel, save_funnel: the funnel and its file.
make_confidence, describe_set: the set of gliders that logs allow, for which a funnel
can be made too. Verdict, FlightProof, describe_proof: what check and proof show.
falsify_funnel, Falsification: flights from the boundary that try to leave; fly_loop,
FlownLoop, FlownTrial: the same of held and late commands in wind. fly_inside: flights
from inside. study_estimates, EstimatedFlights: flights on a filter's estimate.
FunnelMonitor: a Drake System that reports the margin of a state. funnel_regulator: the
funnel's own feedback as a Drake System; funnel_policy: the same as a policy.
make_phases, phase_faults, rest_for: funnels for any phase between launch and clock,
made, checked and chosen in flight. SolverError: there is no funnel.
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
from glider.verification.phases import make_phases, rest_for
from glider.verification.proof.check import Verdict, check_funnel
from glider.verification.proof.flight_proof import FlightProof, prove_flights
from glider.verification.proof.phases import phase_faults
from glider.verification.sos.programs import SolverError
from glider.verification.trials.as_flown import FlownLoop, FlownTrial, fly_loop
from glider.verification.trials.estimated import EstimatedFlights, study_estimates
from glider.verification.trials.falsify import Falsification, falsify_funnel, fly_inside
