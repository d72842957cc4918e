# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # Your own effect and your own logs
#
# Your glider may have an effect that the library lacks, and your logs are unlikely to
# be in its format. You can add both: an effect as one formula, logs through one MAP
# file.
#
# {nb-download}`Download this page as a notebook <own_effect.ipynb>`.
#
# ## An effect is a formula
#
# Suppose that your glider trails a thread, whose friction is proportional to airspeed
# rather than to its square. It is a force, so it enters at the stage `wrench`. Its
# formula receives the flow (a [`Flow`](#glider.physics.effects.effect.Flow)) and the
# coefficients, and returns one number for each term in `adds_to`. Write it into a
# module, not into the notebook: code compiled from a module is cached for the next
# session.

# %%
# %%writefile thread_drag.py
from glider import effects


@effects.scalar
def _thread_drag(flow, coefficient):
    return -coefficient * flow.air_x, -coefficient * flow.air_z  # [N]


THREAD_DRAG = effects.EffectKind(
    kind="thread_drag",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(
        effects.Coefficient(
            name="coefficient", unit="N s/m", scale=0.02, lower=0.0, upper=1.0
        ),
    ),
    formula=_thread_drag,
    words="a trailing thread, whose drag is linear in airspeed",
    depends_on=("V",),
)

# %% [markdown]
# ## Flights with a known answer
#
# Before you rely on the effect for your own flights, simulate a campaign of a glider
# that has it, and check that it is found.

# %%
import sys

import numpy as np

sys.path.insert(0, ".")
from thread_drag import THREAD_DRAG

from glider import CampaignPlan, GliderModel, close_the_loop

truth = GliderModel(effects=(THREAD_DRAG(coefficient=0.03),))
plan = CampaignPlan(flights=12)
campaign = plan.simulate(truth, np.random.default_rng(0), name="thread")
print(len(campaign.flights), "flights of", round(campaign.flights[0].time[-1], 2), "s")

# %% [markdown]
# ## Logs in another format
#
# Here is a file as another lab might keep it: semicolons, decimal commas, milliseconds,
# degrees, and north and down as axes, with pitch positive nose **up** and the elevator
# positive trailing edge **down**. (This cell writes it from the flights above; yours
# come from your software.)

# %%
from pathlib import Path

Path("takes").mkdir(exist_ok=True)
for flight in campaign.flights:
    x, z, pitch = flight.pose.T
    columns = {
        "Zeit": 1000.0 * flight.time,
        "north": x,
        "down": -z,
        "Nick": -np.degrees(pitch),
        "de": -np.degrees(flight.elevator),
        "de_cmd": -np.degrees(flight.command),
    }
    lines = [";".join(columns), "ms;m;m;deg;deg;deg/s"]
    lines += [
        ";".join(f"{value:.6f}".replace(".", ",") for value in row)
        for row in np.column_stack(list(columns.values()))
    ]
    Path("takes", flight.name).write_text("\n".join(lines))
print(*lines[:4], sep="\n")

# %% [markdown]
# One MAP file describes the format. `glider import takes/*.csv --guess --map
# MAP.yaml` would propose one, with a reason for each line; here is ours. [Your own
# logs](../import.md) has examples for Motive, PX4, MATLAB and ROS.

# %%
MAP = """\
columns: {time: Zeit, x: north, z: down, pitch: Nick, elevator: de,
          elevator_rate_command: de_cmd}
units: {time: ms, angle: deg, rate: deg/s}
frame: {axes: NED, elevator: trailing_edge_down}
vehicle: {mass: 0.08, pitch_inertia: 0.0015, wing_area: 0.0885, elevator_area: 0.0147,
          wing_offset: 0.0, hinge_offset: 0.27, elevator_offset: 0.022,
          air_density: 1.204, gravity: 9.81, elevator_rate_limit: 13.0,
          elevator_limits: [-0.4463, 0.9473]}
command_rate: 50
"""
written = Path("MAP.yaml").write_text(MAP)

# %%
from glider import import_campaign

files = sorted(Path("takes").glob("*.csv"))
imported = import_campaign(files, "MAP.yaml", "throws")
print(*imported.describe().splitlines()[:3], "...", sep="\n")

# %% [markdown]
# The import compares the flights with the MAP, and rejects a MAP that they contradict.
# This happens if we forget that this lab's elevator is positive trailing edge down:

# %%
from glider import InputError

wrong = MAP.replace("trailing_edge_down", "trailing_edge_up")
Path("WRONG.yaml").write_text(wrong)
try:
    import_campaign(files, "WRONG.yaml", "wrong")
except InputError as error:
    print(error)
else:
    raise AssertionError("a wrong sign was accepted")

# %% [markdown]
# ## Is it found?
#
# The result is a campaign like any other. We trace it with the whole library plus the
# new effect; `glider close-the-loop throws` would do the same with the
# library alone.

# %%
result = close_the_loop("throws", own_effects=(THREAD_DRAG,))
print(result.verdict, "-", result.reason)
for effect in result.effects:
    for name, c in effect.coefficients.items():
        print(f"{effect.kind}.{name} = {c.value:.4f} ± {c.std:.1g} {c.unit}")
assert result.verdict == "effect_found"
assert [effect.kind for effect in result.effects] == ["thread_drag"]

# %% [markdown]
# The coefficient agrees with the one that we simulated. Sets of effects that are nearly
# as likely would be rivals; here the flights leave none.

# %%
for alternative in result.alternatives:
    kinds = [effect.kind.kind for effect in alternative.model.effects]
    print(f"{alternative.probability:.2f}", *kinds)

# %% [markdown]
# `CONTRIBUTING.md` explains how to add an effect to the library for good. It then
# appears in the [catalogue](../effects/index.md) automatically.
