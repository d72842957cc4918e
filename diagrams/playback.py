"""Flights that are known already, side by side in Meshcat: playback and recording.

play(tracks, meshcat, rate=0.2)
write_text(path, page_of(meshcat, tracks, "Measured against modelled", rate=0.2))
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from diagrams.scene import FRAMES_PER_SECOND, NUM_POSITIONS, AddScene, Stage
from glider.errors import InputError
from glider.physics.parameters import GliderParameters
from glider.physics.state import POSITION
from glider.planning.plan import Plan
from glider.simulation.flown_flights import INSTANT, FlownFlight
from glider.simulation.refly import Motion

Color = tuple[float, float, float, float]

RED = (0.85, 0.16, 0.12, 0.4)
GREEN = (0.05, 0.6, 0.25, 0.5)
GREY = (0.45, 0.47, 0.5, 0.4)
"""Colors of ghosts: red, green, blue, opacity."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Track:
    """A flight to show.

    Attributes:
        name: shown with it; letters, digits, spaces, hyphens and underscores.
        times: (K,) increasing; all tracks share one clock [s].
        poses: (K, 4) x, z [m], pitch, elevator [rad].
        color: red, green, blue, opacity; None for the glider's own colors.
        forces: (K, 2) of wing and elevator along their normals [N], or None.
    """

    name: str
    times: np.ndarray
    poses: np.ndarray
    color: Color | None = None
    forces: np.ndarray | None = None

    def __post_init__(self):
        """Raises InputError where the arrays are no flight."""
        if not self.slug.replace("_", "").replace("-", "").isalnum():
            raise InputError(
                f"Track '{self.name}': expected a name of letters, digits, spaces, "
                "hyphens and underscores."
            )
        times = np.asarray(self.times)
        poses = np.asarray(self.poses)
        count = len(times)
        if count == 0 or not np.all(np.diff(times) > 0.0):
            raise InputError(f"Track '{self.name}': the times must increase.")
        arrays = [("poses", poses, NUM_POSITIONS)]
        if self.forces is not None:
            arrays.append(("forces", np.asarray(self.forces), 2))
        for field, array, width in arrays:
            if array.shape != (count, width) or not np.all(np.isfinite(array)):
                raise InputError(
                    f"Track '{self.name}': '{field}' has shape {array.shape}; expected "
                    f"finite numbers of shape {(count, width)}."
                )

    @property
    def slug(self) -> str:
        """The name in Meshcat and in the diagram."""
        return self.name.replace(" ", "_")


def track_of(
    name: str, flight: FlownFlight | Plan | Motion, color: Color | None = None
) -> Track:
    """Returns a flight as a track: simulated, planned (at its knots) or logged.

    The forces on wing and elevator are shown where they are known.
    """
    if isinstance(flight, Motion):
        return Track(
            name=name,
            times=flight.time,
            poses=flight.poses,
            color=color,
            forces=flight.forces,
        )
    if isinstance(flight, Plan):
        poses = flight.states[:, :NUM_POSITIONS]
        return Track(name=name, times=flight.times, poses=poses, color=color)
    kept = np.flatnonzero(np.append(np.diff(flight.times) > INSTANT, True))
    return Track(
        name=name,
        times=flight.times[kept],
        poses=flight.states[kept, :NUM_POSITIONS],
        color=color,
        forces=None if flight.forces is None else flight.forces[kept],
    )


def stage_of(track: Track, wire: tuple[float, float] | None = (0.0, 0.0)) -> Stage:
    """Returns a stage with a whole flight in view, and the wire if there is one."""
    places = [*track.poses[:, :2], *([] if wire is None else [np.array(wire)])]
    left, low = np.min(places, axis=0)
    right, high = np.max(places, axis=0)
    return Stage(
        wire=wire,
        x_limits=(float(left) - 0.4, float(right) + 0.6),
        z_limits=(float(low) - 0.6, float(high) + 0.4),
    )


def _duration_of(tracks: Sequence[Track]) -> float:
    """Returns the time from the first start to the last end [s]."""
    start = min(track.times[0] for track in tracks)
    return float(max(track.times[-1] for track in tracks) - start)


def _velocities_of(track: Track) -> np.ndarray:
    """Returns the velocity of a track's positions (K, 2), zero for a single one."""
    positions = np.asarray(track.poses, dtype=float)[:, POSITION]
    if len(positions) == 1:
        return np.zeros((1, 2))
    return np.gradient(positions, np.asarray(track.times, dtype=float), axis=0)


def MakePlayback(
    tracks: Sequence[Track],
    meshcat: Meshcat,
    *,
    rate: float = 1.0,
    parameters: GliderParameters | None = None,
    stage: Stage | None = None,
) -> Diagram:
    """Wires each track's motion and forces to a glider with its overlays.

    The diagram's time is that of the flights, from the earliest start on.

    Args:
        tracks: of different names; each keeps its last pose after its end.
        meshcat: where to draw.
        rate: seconds of flight in one second of viewing; 0.2 is five times
            slower than real, and gets five times the frames.
        parameters: of the vehicle, which give the sizes.
        stage: what to set round them; from the first track if None.

    Returns:
        A Diagram with the systems "NAME_track", "NAME_forces" and those of AddScene.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise InputError(f"The playback rate is {rate:g}; it must be positive.")
    if not tracks:
        raise InputError("There is no track to play.")
    slugs = [track.slug for track in tracks]
    if len(set(slugs)) < len(slugs):
        raise InputError(f"Two tracks have one name: {', '.join(slugs)}.")
    stage = stage if stage is not None else stage_of(tracks[0])
    start = min(track.times[0] for track in tracks)
    builder = DiagramBuilder()
    for track in tracks:
        name = track.slug
        times = np.asarray(track.times, dtype=float) - start
        color = None if track.color is None else Rgba(*track.color)
        motion = np.hstack([track.poses, _velocities_of(track)])
        state = _add_source(builder, f"{name}_track", times, motion)
        forces = None
        if track.forces is not None:
            forces = _add_source(builder, f"{name}_forces", times, track.forces)
        AddScene(
            builder,
            state,
            meshcat,
            name=name,
            color=color,
            forces=forces,
            parameters=parameters,
            stage=stage,
            frames_per_second=FRAMES_PER_SECOND / rate,
        )
    return builder.Build()


def _add_source(builder, name, times, values):
    """Adds a source of values over time, constant if there is but one."""
    rows = np.asarray(values, dtype=float)
    if len(rows) == 1:
        source = ConstantVectorSource(rows[0])
    else:
        source = TrajectorySource(PiecewisePolynomial.FirstOrderHold(times, rows.T))
    return builder.AddNamedSystem(name, source).get_output_port()


def play(
    tracks: Sequence[Track],
    meshcat: Meshcat,
    *,
    rate: float = 1.0,
    parameters: GliderParameters | None = None,
    stage: Stage | None = None,
) -> None:
    """Plays tracks together, and leaves them in Meshcat as a recording.

    The recording's time is that of the flights. A page of `diagrams.programs.page`
    plays it once, at `rate`, and can stop, repeat and slow it.

    Args:
        tracks: as in MakePlayback.
        meshcat: as in MakePlayback.
        rate: as in MakePlayback.
        parameters: as in MakePlayback.
        stage: as in MakePlayback.
    """
    diagram = MakePlayback(
        tracks, meshcat, rate=rate, parameters=parameters, stage=stage
    )
    # To a whole frame, so that the very end is drawn.
    per_second = FRAMES_PER_SECOND / rate
    frames = math.ceil(_duration_of(tracks) * per_second - 1e-9)
    meshcat.DeleteRecording()
    meshcat.StartRecording(per_second)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(frames / per_second)
    meshcat.StopRecording()
    meshcat.PublishRecording()
