"""A throw as it was measured, beside what the models predict from its beginning."""

import dataclasses
import io
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from diagrams.playback import GREEN, RED, play, stage_of, track_of
from diagrams.programs.lab.state import CORRECTED, NOMINAL
from diagrams.programs.page import open_meshcat, page_of
from diagrams.programs.station.processes import end_with
from glider.campaign.logs import Campaign, Flight
from glider.files.writing import replace_file
from glider.physics.model import GliderModel
from glider.report.as_page import page_data
from glider.report.flight_figures import flight_panels
from glider.report.plots.figure import Axis, Figure, Line, Panel, Points
from glider.report.plots.style import LABELS
from glider.simulation.refly import Motion, nominal_parameters, position_errors, refly
from glider.sysid.fit.prediction import RolloutModel, beginning_rows
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.result import HeldOutFlight

_MEASURED = "measured"

_SLOWED = 0.2
"""Seconds of flight in one second of a replay."""

_COLORS = {NOMINAL: RED, CORRECTED: GREEN}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """A throw, measured and predicted."""

    name: str  #: Of the flight's file.
    motions: dict[str, Motion]  #: _MEASURED, then that of each model.
    fitted_until: float = 0.0  #: End of the part that the launch was fitted to [s].

    @property
    def errors(self) -> dict[str, float]:
        """RMS of the position error of each model [m]."""
        errors = position_errors(self.motions)
        return {name: rms for name, (rms, _) in errors.items()}

    def figure(self, *, has_wire: bool = False) -> dict[str, Any]:
        """Path, pitch, elevator and distance, as a page draws them at "throw"."""
        measured, *models = self.motions
        time = self.motions[measured].time
        flight = HeldOutFlight(
            name=self.name,
            time=time,
            measured=self.motions[measured].poses[:, :3],
            flown={name: _to_end(self.motions[name], time) for name in models},
            fitted_until=self.fitted_until,
        )
        keys = {name: LABELS[name] for name in self.motions}
        keys |= {"fitted": "launch state fitted"} if models else {}
        panels = flight_panels(flight)[: None if models else 2]  # No distance alone.
        if np.ptp(self.motions[measured].poses[:, 3]) > 0.0:
            panels.insert(2, self._elevator_panel(panels[1].x))
        if has_wire:
            keys["named"] = "wire"
            wire = Points("named", np.zeros(1), np.zeros(1), hover="the wire", size=9.0)
            panels[0] = dataclasses.replace(panels[0], marks=[*panels[0].marks, wire])
        return page_data({"throw": Figure(keys=keys, panels=panels)})

    def _elevator_panel(self, clock: Axis) -> Panel:
        """The elevator's angle: measured, and where its commands turn it in models."""
        lines = [
            Line(
                name,
                motion.time,
                np.degrees(motion.poses[:, 3]),
                hover=f"{LABELS[name]}<br>%{{x:.3f}} s: %{{y:.1f}}°",
            )
            for name, motion in self.motions.items()
        ]
        models = " and by its commands" if len(lines) > 1 else ""
        title = f"elevator, measured{models}, trailing edge up > 0 [°]"
        return Panel(title, lines, clock, height=250)

    def replay(self, campaign: Campaign, *, has_wire: bool) -> str:
        """HTML of a Meshcat that replays it, with the models as ghosts.

        The Meshcat stays open until this process ends: Drake holds diagrams with
        systems in Python, and so their Meshcat, for ever.
        """
        tracks = [track_of(n, m, _COLORS.get(n)) for n, m in self.motions.items()]
        stage = None if has_wire else stage_of(tracks[0], wire=None)
        meshcat = open_meshcat()
        parameters = nominal_parameters(campaign)
        play(tracks, meshcat, rate=_SLOWED, parameters=parameters, stage=stage)
        return page_of(meshcat, tracks, self.name, _SLOWED)

    def save(self, file: Path) -> None:
        """Saves it as .npz."""
        arrays = {"fitted_until": np.array(self.fitted_until)}
        for name, motion in self.motions.items():
            arrays |= {f"{name}_time": motion.time, f"{name}_poses": motion.poses}
            if motion.forces is not None:
                arrays[f"{name}_forces"] = motion.forces
        data = io.BytesIO()
        np.savez(data, **arrays)  # type: ignore[arg-type]
        replace_file(file, lambda path: path.write_bytes(data.getvalue()))


def replay_apart(comparison: Comparison, campaign: Campaign, *, has_wire: bool) -> str:
    """As `Comparison.replay`, in a process of its own, which closes the Meshcat."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, spawn, end_with, (os.getpid(),)) as process:
        replayed = process.submit(comparison.replay, campaign, has_wire=has_wire)
        return replayed.result()


def load_comparison(name: str, file: Path) -> Comparison:
    """Loads the comparison of a flight."""
    with np.load(file) as data:
        motions = {
            model: Motion(
                time=data[f"{model}_time"],
                poses=data[f"{model}_poses"],
                forces=data.get(f"{model}_forces"),
            )
            for model in (_MEASURED, NOMINAL, CORRECTED)
            if f"{model}_time" in data
        }
        until = float(data["fitted_until"])
    return Comparison(name=name, motions=motions, fitted_until=until)


def compare(
    campaign: Campaign,
    flight: Flight,
    models: dict[str, GliderModel],
    rollouts: dict[str, RolloutModel],
) -> Comparison:
    """Flies a throw again with models, each from the launch fitted to its beginning."""
    if not models:
        return Comparison(name=flight.name, motions={_MEASURED: _measured(flight)})
    motions = refly(campaign, flight, models, rollouts=rollouts)
    time = motions[_MEASURED].time
    trims = make_vehicle(campaign).per_flight_trims
    until = float(time[beginning_rows(time, trims) - 1])
    return Comparison(name=flight.name, motions=motions, fitted_until=until)


def _measured(flight: Flight) -> Motion:
    """A flight as its log has it."""
    angle = np.zeros(len(flight.time)) if flight.elevator is None else flight.elevator
    poses = np.column_stack([flight.pose, angle])
    rows = np.isfinite(poses).all(axis=1)
    return Motion(time=(flight.time - flight.time[0])[rows], poses=poses[rows])


def _to_end(motion: Motion, time: np.ndarray) -> np.ndarray:
    """Poses (n, 3) of a model at all times; NaN after it has diverged."""
    poses = np.full((len(time), 3), np.nan)
    poses[: len(motion.time)] = motion.poses[:, :3]
    return poses
