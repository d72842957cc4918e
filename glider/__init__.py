"""A toolkit for a planar glider that perches, on Drake: the public names.

A name is imported from its module when it is first asked for. So ``import glider``
costs next to nothing, and pydrake and numba load when something needs them.
"""

import importlib
from typing import TYPE_CHECKING

_HOMES = {
    "Campaign": "glider.campaign.logs",
    "CampaignPlan": "glider.simulation.campaigns",
    "EffectKind": "glider.physics.effects",
    "GliderModel": "glider.physics.model",
    "GliderPlant": "glider.systems.plant",
    "InputError": "glider.errors",
    "LaunchSpread": "glider.simulation.monte_carlo",
    "ModelPredictiveController": "glider.control.mpc",
    "MppiController": "glider.control.mppi",
    "Perches": "glider.simulation.flown_flights",
    "PerchingProblem": "glider.planning.problem",
    "Plan": "glider.planning.plan",
    "Result": "glider.sysid.result",
    "close_the_loop": "glider.sysid.pipeline",
    "draw_launches": "glider.simulation.monte_carlo",
    "fly": "glider.simulation.fly",
    "headline": "glider.report.wording",
    "import_campaign": "glider.campaign.importing.campaign_import",
    "load_campaign": "glider.campaign.reader",
    "load_model": "glider.physics.model",
    "load_problem": "glider.planning.problem",
    "perching_filter": "glider.estimation.perching",
    "plan": "glider.planning.dircol",
    "print_summary": "glider.report.terminal",
    "save_model": "glider.physics.model",
    "scalar": "glider.physics.formulas",
    "simulate_campaign": "glider.simulation.campaigns",
    "tracking_policy": "glider.control.tvlqr",
    "tracking_regulator": "glider.control.tvlqr_drake",
    "write_report": "glider.report.folder",
}
"""Name to the module that it is imported from."""

_MODULES = {
    "effects": "glider.physics.effects",
    "funnels": "glider.funnels",
    "reach": "glider.planning.reach",
    "refly": "glider.simulation.refly",
    "throws": "glider.throws",
}
"""Name to a module that is public as a whole."""

__all__ = list(_HOMES | _MODULES)

if TYPE_CHECKING:  # The same names, for mypy and editors.
    from glider import funnels, throws
    from glider.campaign.importing.campaign_import import import_campaign
    from glider.campaign.logs import Campaign
    from glider.campaign.reader import load_campaign
    from glider.control.mpc import ModelPredictiveController
    from glider.control.mppi import MppiController
    from glider.control.tvlqr import tracking_policy
    from glider.control.tvlqr_drake import tracking_regulator
    from glider.errors import InputError
    from glider.estimation.perching import perching_filter
    from glider.physics import effects
    from glider.physics.effects import EffectKind
    from glider.physics.formulas import scalar
    from glider.physics.model import GliderModel, load_model, save_model
    from glider.planning import reach
    from glider.planning.dircol import plan
    from glider.planning.plan import Plan
    from glider.planning.problem import PerchingProblem, load_problem
    from glider.report.folder import write_report
    from glider.report.terminal import print_summary
    from glider.report.wording import headline
    from glider.simulation import refly
    from glider.simulation.campaigns import CampaignPlan, simulate_campaign
    from glider.simulation.flown_flights import Perches
    from glider.simulation.fly import fly
    from glider.simulation.monte_carlo import LaunchSpread, draw_launches
    from glider.sysid.pipeline import close_the_loop
    from glider.sysid.result import Result
    from glider.systems.plant import GliderPlant
else:

    def __getattr__(name):
        """Returns one of the names above; Python asks once, as it is kept."""
        if name in _MODULES:
            value = importlib.import_module(_MODULES[name])
        elif name in _HOMES:
            value = getattr(importlib.import_module(_HOMES[name]), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*globals(), *__all__})
