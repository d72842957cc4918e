"""A new throw flown again by the models, beside what was measured."""

import numpy as np

from glider.campaign.logs import Campaign, Flight
from glider.physics.model import GliderModel
from glider.report.flight_figures import flight_panels
from glider.report.plots.as_file import to_png
from glider.report.plots.figure import Figure
from glider.report.plots.style import LABELS
from glider.simulation.refly import Motion, position_errors, refly
from glider.sysid.constants import BEGINNING, BEGINNING_ROWS, BEGINNING_WITH_TRIM
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.result import HeldOutFlight


def predict_throw(
    campaign: Campaign, flight: Flight, models: dict[str, GliderModel]
) -> tuple[dict[str, float], bytes]:
    """RMS of the position error of each model [m], and a picture as PNG."""
    motions = refly(campaign, flight, models)
    errors = {name: rms for name, (rms, _) in position_errors(motions).items()}
    measured = motions.pop("measured")
    time, known = measured.time, make_vehicle(campaign).trim_is_known
    share = BEGINNING if known else BEGINNING_WITH_TRIM
    shown = HeldOutFlight(
        name=flight.name,
        time=time,
        measured=measured.poses[:, :3],
        flown={name: _to_end(motion, time) for name, motion in motions.items()},
        fitted_until=max(share * time[-1], time[min(BEGINNING_ROWS, len(time)) - 1]),
    )
    keys = {name: LABELS[name] for name in ("measured", *motions)}
    keys |= {"fitted": "launch state fitted"}
    return errors, to_png(Figure(keys=keys, panels=flight_panels(shown)))


def _to_end(motion: Motion, time: np.ndarray) -> np.ndarray:
    """Poses (n, 3) of a model at all times; NaN after it has diverged."""
    poses = np.full((len(time), 3), np.nan)
    poses[: len(motion.time)] = motion.poses[:, :3]
    return poses
