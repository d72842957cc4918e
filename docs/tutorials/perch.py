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

from diagrams import closed_loop, simulate_flights
from glider import (
    GliderModel,
    PerchingProblem,
    close_the_loop,
    fly,
    plan,
    tracking_policy,
    tracking_regulator,
)

truth = GliderModel.load("head_wind")
nominal = GliderModel(parameters=truth.parameters)
problem = PerchingProblem()
print("the true glider:", {e.kind.kind: e.to_dict() for e in truth.effects})
print("its model:      ", nominal.effects or "no effects")

# %% [markdown]
# ## Plan and fly with the nominal model
#
# Plan a flight to the wire from 3.5 m away (direct collocation), design a feedback
# along it (time-varying LQR), and fly the *true* glider with both, in a Drake diagram.
# Commands are sent at 50 Hz. The launches are perturbed, with standard deviations of
# 4 cm in height, 0.1 m/s in speed and 0.02 rad in pitch. Motion capture records the
# flights at 120 Hz, with noise.

# %%
rng = np.random.default_rng(0)


def rehearse(model):
    """Plans with a model; flies ten launches of the true glider and logs them."""
    starts = problem.draw_launches(10, rng)
    planned = plan(model, problem)
    loop = closed_loop(
        truth,
        tracking_regulator(model, planned),
        planned=model,
        command_rate=50.0,
        motion_capture=120.0,
    )
    duration = planned.duration + 0.1  # It may pass the wire late.
    return planned, simulate_flights(loop, starts, duration, capture_noise=rng)


_, before = rehearse(nominal)
print(before.describe())

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
assert found.verdict == "effect_found"
assert [effect.kind for effect in found.effects] == ["wind"]

# %% [markdown]
# ## Plan and fly again
#
# The corrected model takes the place of the nominal one, and nothing else changes. The
# commands differ from the first moment, because the wind acts from the first moment.

# %%
planned, after = rehearse(found.model)
print("planned nominal:  ", before.describe())
print("planned corrected:", after.describe())
assert after.perched > before.perched

# %%
figure, ax = plt.subplots(figsize=(8, 3.6), layout="constrained")
for flown, color, label in (
    (before, "#8A8A8A", "planned with the nominal model"),
    (after, "#0072B2", "planned with the corrected model"),
):
    for k, flight in enumerate(flown):
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
policy = tracking_policy(found.model, planned)
for times in (1.0, 2.0):
    launches = problem.draw_launches(500, rng, scale=times)
    flights = fly(truth, policy, launches)
    print(
        f"launch errors {times:.0f} times as large: {flights.perched.mean():.0%} perch"
    )

# %% [markdown]
# `examples/perching_funnel.py` continues from here to a *proof*: a funnel of states
# from which the feedback brings the glider to the wire, checked in exact arithmetic.
