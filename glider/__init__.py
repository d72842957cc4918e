"""A toolkit for a planar glider that perches, on Drake: the public names.

A name is imported from its module when it is first asked for. So ``import glider``
costs next to nothing, and pydrake and numba load when something needs them.
"""

from typing import TYPE_CHECKING

from glider.lazy import attach, warn_if_foreign

if TYPE_CHECKING:
    import glider.funnels as funnels
    import glider.physics.effects as effects
    import glider.simulation.refly as refly
    import glider.throws as throws
    from glider.campaign.importing.campaign_import import import_campaign
    from glider.campaign.logs import Campaign
    from glider.campaign.reader import load_campaign
    from glider.compiled.parallel import workers_of
    from glider.control.tvlqr import tracking_policy
    from glider.errors import InputError
    from glider.estimation.perching import perching_filter
    from glider.physics.model import GliderModel
    from glider.physics.parameters import GliderParameters
    from glider.planning.dircol import can_perch, plan
    from glider.planning.plan import Plan
    from glider.planning.problem import PerchingProblem
    from glider.planning.program import perching_program
    from glider.report.folder import write_report
    from glider.report.terminal import print_summary
    from glider.simulation.campaigns import CampaignPlan
    from glider.simulation.flown_flights import Perches
    from glider.simulation.fly import fly
    from glider.sysid.pipeline import close_the_loop
    from glider.sysid.result import Result
    from glider.systems.elevator_servo import ElevatorServo
    from glider.systems.kalman_filter import ExtendedKalmanFilter
    from glider.systems.mpc import ModelPredictiveController
    from glider.systems.mppi import MppiController
    from glider.systems.noise import SampledNoise
    from glider.systems.observer import ExtraStates
    from glider.systems.plant import GliderPlant
    from glider.systems.regulator import tracking_regulator
else:
    __getattr__, __dir__, __all__ = attach(__name__, __file__)

warn_if_foreign("diagrams", "loops")  # PyPI has another package of that name.
