# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # From a corrected model to a perch
#
# A glider flies in a head wind that its model does not include. We plan a perch with
# the model, miss the wire, trace the logs of the misses, and plan again.
#
# {nb-download}`Download this page as a notebook <perch.ipynb>`;
# `examples/perch_corrected.py` does the same with a hundred launches and in Meshcat.

# %%
import matplotlib.pyplot as plt
import numpy as np

from diagrams.studies.rehearsal import rehearse
from glider import GliderModel, PerchingProblem, close_the_loop, load_model
from glider.paths import models_path
from glider.simulation.monte_carlo import LaunchSpread, draw_launches

truth = load_model(models_path("truths", "head_wind.yaml"))
nominal = GliderModel(parameters=truth.parameters)
problem = PerchingProblem()
print("the true glider:", {e.kind.kind: e.to_dict() for e in truth.effects})
print("its model:      ", nominal.effects or "no effects")

# %% [markdown]
# ## Plan and fly with the nominal model
#
# `rehearse` plans a flight to the wire from 3.5 m away (direct collocation), designs a
# feedback along it (time-varying LQR), and flies the *true* glider with both. Commands
# are sent at 50 Hz. The launches are perturbed, with standard deviations of 4 cm in
# height, 0.1 m/s in speed and 0.02 rad in pitch. Motion capture records the flights.

# %%
rng = np.random.default_rng(0)
starts = draw_launches(problem, LaunchSpread(), 10, rng)
before = rehearse(truth, nominal, problem, starts, rng)
print(before.flights.describe())

# %% [markdown]
# A flight perches if it comes within the hook's reach of the wire, slowly enough and
# with the nose up far enough (`models/problems/perching.yaml` has the limits). None of
# these flights does.
#
# ## Find the cause
#
# The logs of the misses are a campaign like any other.

# %%
found = close_the_loop(before.campaign)
print(found.verdict, "-", found.reason)
for effect in found.effects:
    for name, c in effect.coefficients.items():
        print(f"{effect.kind}.{name} = {c.value:.3f} ± {c.std:.1g} {c.unit}")
assert [effect.kind for effect in found.effects] == ["wind"]

# %% [markdown]
# ## Plan and fly again
#
# The corrected model takes the place of the nominal one, and nothing else changes. The
# commands differ from the first moment, because the wind acts from the first moment.

# %%
starts = draw_launches(problem, LaunchSpread(), 10, rng)
after = rehearse(truth, found.model, problem, starts, rng)
print("planned nominal:  ", before.flights.describe())
print("planned corrected:", after.flights.describe())
assert after.flights.perched > before.flights.perched

# %%
figure, ax = plt.subplots(figsize=(8, 3.6), layout="constrained")
for flown, color, label in (
    (before, "#8A8A8A", "planned with the nominal model"),
    (after, "#0072B2", "planned with the corrected model"),
):
    for k, flight in enumerate(flown.flights):
        x, z = flight.states[:, :2].T
        ax.plot(x, z, color=color, lw=1, label=label if k == 0 else None)
ax.plot(*problem.wire, "o", ms=9, mfc="none", color="#D55E00", label="wire")
ax.set(xlabel="x [m]", ylabel="z [m]", aspect="equal")
figure.legend(loc="outside lower center", ncols=3, frameon=False)
plt.show()
# %% [markdown]
# ## How large may the launch error be?
#
# Thousands of launches can be flown quickly, because the loops are compiled. Here are
# five hundred with continuous feedback, for launches perturbed as above and for
# launches perturbed twice as much.

# %%
from glider import fly
from glider.control.tvlqr import tracking_policy

policy = tracking_policy(found.model, after.plan)
for times in (1.0, 2.0):
    usual = LaunchSpread()
    wider = LaunchSpread(
        height=times * usual.height,
        speed=times * usual.speed,
        pitch=times * usual.pitch,
    )
    launches = draw_launches(problem, wider, 500, rng)
    flights = fly(truth, policy, launches)
    print(
        f"launch errors {times:.0f} times as large: {flights.perched.mean():.0%} perch"
    )

# %% [markdown]
# `examples/perching_funnel.py` continues from here to a *proof*: a funnel of states
# from which the feedback brings the glider to the wire, checked in exact arithmetic.
