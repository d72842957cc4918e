"""The picture of an import: is this how the gliders flew?"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from glider.campaign.logs import Campaign

_NOSES = 8  # Arrows along each flight.


def save_import_figure(campaign: Campaign, path: Path) -> None:
    """Draws flights from the side with their noses, and their angles over time."""
    figure = Figure(figsize=(9, 7), layout="constrained")
    side, angles = figure.subplots(2, 1)
    for flight in campaign.flights:
        x, z, pitch = flight.pose.T
        [line] = side.plot(x, z, lw=1)
        rows = np.linspace(0, len(x) - 1, _NOSES).astype(int)
        color = line.get_color()
        shape = {"width": 0.003, "scale": 18}
        nose = np.cos(pitch[rows]), -np.sin(pitch[rows])
        side.quiver(x[rows], z[rows], *nose, angles="xy", color=color, **shape)
        time = flight.time - flight.time[0]
        angles.plot(time, np.degrees(pitch), color=color)
        if flight.elevator is not None:
            angles.plot(time, np.degrees(flight.elevator), "--", color=color)
    side.set_aspect("equal", adjustable="datalim")
    side.set(xlabel="x, along the throw [m]", ylabel="z, up [m]")
    side.set_title("From the side; arrows point where the nose does")
    angles.set(xlabel="time since release [s]", ylabel="angle [°]")
    dashed = "; dashed: elevator (trailing edge up +)"
    shown = dashed if campaign.elevator == "servo" else ""
    angles.set_title(f"Pitch (nose down +){shown}")
    figure.savefig(path, dpi=110)
