# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # Your first campaign
#
# A *campaign* is a folder of flight logs of one glider. Six ship with the project. This
# one has forty launches of a glider whose wing generates more lift than the flat plate
# of the model, because the flow stays attached below stall. The tool does not know
# this. Let us see whether it finds out.
#
# Everything on this page was computed when the page was built. Download it as a
# {nb-download}`notebook <first_campaign.ipynb>`, or run the same command in a shell:
#
#     glider close-the-loop attached_lift

# %%
import html
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import HTML
from rich.console import Console

from glider import close_the_loop, load_campaign, print_summary, write_report

campaign = load_campaign("attached_lift")
print(len(campaign.flights), "flights at", campaign.pose_rate, "Hz")
print(campaign.vehicle)

# %% [markdown]
# ## Look at the logs first
#
# Each flight is a table: time; x, z and pitch from motion capture; the measured
# elevator angle; and the commanded elevator rate. Pitch is positive **nose down**, the
# elevator positive trailing edge **up**. Units are SI and radians.

# %%
figure, (paths, angles) = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
for flight in campaign.flights[:10]:
    x, z, pitch = flight.pose.T
    paths.plot(x, z, lw=1)
    angles.plot(flight.time - flight.time[0], np.degrees(pitch), lw=1)
paths.set(xlabel="x [m]", ylabel="z [m]", title="ten flights")
angles.set(xlabel="time [s]", ylabel="pitch, nose down > 0 [°]")
plt.show()
# %% [markdown]
# ## Close the loop
#
# One call smooths the logs, tests whether the model lacks anything at all, searches the
# [library of effects](../effects/index.md) for the set that explains the flights, fits
# it, and measures the improvement on held-out flights. Twenty of the forty flights are
# enough here.

# %%
few = [flight.name for flight in campaign.flights[:20]]
result = close_the_loop("attached_lift", flights=few)
print_summary(result, Console(width=88, force_jupyter=False, force_terminal=False))

# %% [markdown]
# Read it from the top:
#
# - The **verdict** is a sentence.
# - The **effect** is listed with its coefficients, their standard errors, and its
#   evidence in nats, the log marginal likelihood that it gains. *Inclusion
#   100 %* means that it does not depend on a few launches.
# - The **errors** are those of free rollouts: each model flies on its own from a launch
#   state fitted on the first fifth of a held-out flight. The columns are the nominal
#   model, the flat plate with its own parameters refitted, the same with a constant
#   error of the pitch reading, and the corrected model. *Noise* is what the cameras
#   alone would leave.

# %%
corrected, nominal = result.errors["corrected"], result.errors["nominal"]
assert result.verdict == "effect_found"
assert [effect.kind for effect in result.effects] == ["attached_lift"]
gain = nominal.position_rms_m / corrected.position_rms_m
print(f"held-out position error: {gain:.0f} times smaller")

# %% [markdown]
# ## The report
#
# Its figures zoom. Look at two of them first. *Held-out flights* are shown as measured
# (black) and as predicted by each model, which see only the part on the grey ground.
# *Coefficients* of lift, drag and moment over the angle of attack are measured and
# modelled, before and after: up to 15° the wing lifts more than a plate, and beyond no
# more than a plate. This is attached flow, which the corrected model has.

# %%
write_report(result, Path("attached_lift"))
page = html.escape(Path("attached_lift/report.html").read_text(encoding="utf-8"))
HTML(f'<div><iframe srcdoc="{page}" width="100%" height="700"></iframe></div>')

# %% [markdown]
# ## The files
#
# `write_report` wrote them; the command line does the same into `out/attached_lift`.
# `report.html` is one page with all figures, which you can zoom. `report.json` is the
# same for programs. `model.yaml` is the corrected glider, for everything that flies or
# plans.

# %%
for path in sorted(Path("attached_lift").glob("*.*")):
    print(f"{path.name:12} {path.stat().st_size / 1024:8.0f} kB")

# %%
print(Path("attached_lift/model.yaml").read_text())

# %% [markdown]
# Next: [what the corrected model is worth in flight](perch.py), and [your own effect
# and your own logs](own_effect.py).
