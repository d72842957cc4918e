"""A throw as it was measured, beside what the models predict from its beginning."""

import dataclasses
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
from glider.files import schema
from glider.files.writing import write_text
from glider.physics.model import GliderModel
from glider.report.as_page import page_data
from glider.report.flight_figures import flight_panels
from glider.report.plots.figure import Axis, Figure, Line, Panel, Points
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
        measured = self.motions[_MEASURED]
        models = [name for name in self.motions if name != _MEASURED]
        flown = {}
        for name in models:
            flown[name] = _to_end(self.motions[name], measured.time)
        flight = HeldOutFlight(
            name=self.name,
            time=measured.time,
            measured=measured.poses[:, :3],
            flown=flown,
            fitted_until=self.fitted_until,
        )
        keys = {name: name for name in self.motions}
        panels = flight_panels(flight)
        if models:
            keys["fitted"] = "launch state fitted"
        else:
            panels = panels[:2]  # No distance alone.
        if np.ptp(measured.poses[:, 3]) > 0.0:
            panels.insert(2, self._elevator_panel(panels[1].x))
        if has_wire:
            keys["named"] = "wire"
            place = np.zeros(1)
            wire = Points("named", place, place, hover="the wire", size=9.0)
            marks = [*panels[0].marks, wire]
            panels[0] = dataclasses.replace(panels[0], marks=marks)
        return page_data({"throw": Figure(keys=keys, panels=panels)})

    def _elevator_panel(self, clock: Axis) -> Panel:
        """The elevator's angle: measured, and where its commands turn it in models."""
        lines = []
        for name, motion in self.motions.items():
            angles = np.degrees(motion.poses[:, 3])
            hover = f"{name}<br>%{{x:.3f}} s: %{{y:.1f}}°"
            lines.append(Line(name, motion.time, angles, hover=hover))
        models = " and by its commands" if len(lines) > 1 else ""
        title = f"elevator, measured{models}, trailing edge up > 0 [°]"
        return Panel(title, lines, clock, height=250)

    def replay(self, campaign: Campaign, *, has_wire: bool) -> str:
        """HTML of a Meshcat that replays it, with the models as ghosts.

        The Meshcat stays open until this process ends: Drake holds diagrams with
        systems in Python, and so their Meshcat, for ever.
        """
        tracks = []
        for name, motion in self.motions.items():
            tracks.append(track_of(name, motion, _COLORS.get(name)))
        stage = None
        if not has_wire:
            stage = stage_of(tracks[0], wire=None)
        meshcat = open_meshcat()
        parameters = nominal_parameters(campaign)
        play(tracks, meshcat, rate=_SLOWED, parameters=parameters, stage=stage)
        return page_of(meshcat, tracks, self.name, _SLOWED)

    def save(self, file: Path) -> None:
        """Saves it as JSON."""
        write_text(file, schema.json_text(self))


def replay_apart(comparison: Comparison, campaign: Campaign, *, has_wire: bool) -> str:
    """As `Comparison.replay`, in a process of its own, which closes the Meshcat."""
    spawn = multiprocessing.get_context("spawn")
    parent = os.getpid()
    with ProcessPoolExecutor(1, spawn, end_with, (parent,)) as process:
        replayed = process.submit(comparison.replay, campaign, has_wire=has_wire)
        return replayed.result()


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
    last = beginning_rows(time, trims) - 1
    until = float(time[last])
    return Comparison(name=flight.name, motions=motions, fitted_until=until)


def _measured(flight: Flight) -> Motion:
    """A flight as its log has it."""
    angle = flight.elevator
    if angle is None:
        angle = np.zeros(len(flight.time))
    poses = np.column_stack([flight.pose, angle])
    rows = np.isfinite(poses).all(axis=1)
    time = flight.time - flight.time[0]
    return Motion(time=time[rows], poses=poses[rows])


def _to_end(motion: Motion, time: np.ndarray) -> np.ndarray:
    """Poses (n, 3) of a model at all times; NaN after it has diverged."""
    poses = np.full((len(time), 3), np.nan)
    count = len(motion.time)
    poses[:count] = motion.poses[:, :3]
    return poses
