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
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from diagrams.scene import FRAMES_PER_SECOND, NUM_POSITIONS, AddScene, Stage
from glider.errors import InputError, expect
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
        count = len(self.times)
        if count == 0 or not np.all(np.diff(self.times) > 0.0):
            raise InputError(f"Track '{self.name}': the times must increase.")
        shapes = {"poses": (count, NUM_POSITIONS), "forces": (count, 2)}
        for field, shape in shapes.items():
            values = getattr(self, field)
            if values is not None:
                good = np.shape(values) == shape and np.all(np.isfinite(values))
                what = f"Track '{self.name}': the shape of '{field}'"
                expected = f"finite numbers of the shape {shape}"
                expect(good, what, np.shape(values), expected)

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
    forces = getattr(flight, "forces", None)
    if isinstance(flight, Motion):
        times = flight.time
        poses = flight.poses
    else:
        times = flight.times
        poses = flight.states[:, :NUM_POSITIONS]
    kept = np.append(np.diff(times) > INSTANT, True)
    return Track(
        name=name,
        times=times[kept],
        poses=poses[kept],
        color=color,
        forces=None if forces is None else forces[kept],
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


def play(
    tracks: Sequence[Track],
    meshcat: Meshcat,
    *,
    rate: float = 1.0,
    parameters: GliderParameters | None = None,
    stage: Stage | None = None,
) -> None:
    """Plays tracks together, and leaves them in Meshcat as a recording.

    The recording's time is that of the flights, from the earliest start on. A page of
    `diagrams.programs.page` plays it once, at `rate`, and can stop, repeat and slow it.

    Args:
        tracks: of different names; each keeps its last pose after its end.
        meshcat: where to draw.
        rate: seconds of flight in one second of viewing; 0.2 is five times
            slower than real, and gets five times the frames.
        parameters: of the vehicle, which give the sizes.
        stage: what to set round them; from the first track if None.
    """
    expect(0.0 < rate < math.inf, "the playback rate", rate, "a positive number")
    slugs = [track.slug for track in tracks]
    good = len(set(slugs)) == len(slugs) > 0
    expect(good, "the names of the tracks", slugs, "one or more, all different")
    stage = stage if stage is not None else stage_of(tracks[0])
    start = min(track.times[0] for track in tracks)
    end = max(track.times[-1] for track in tracks)
    per_second = FRAMES_PER_SECOND / rate
    builder = DiagramBuilder()
    for track in tracks:
        times = np.asarray(track.times, dtype=float) - start
        poses = np.asarray(track.poses, dtype=float)
        velocities = np.zeros((1, 2))
        if len(times) > 1:
            velocities = np.gradient(poses[:, POSITION], times, axis=0)
        state = _add_source(builder, times, np.hstack([poses, velocities]))
        forces = None
        if track.forces is not None:
            forces = _add_source(builder, times, track.forces)
        AddScene(
            builder,
            state,
            meshcat,
            name=track.slug,
            color=None if track.color is None else Rgba(*track.color),
            forces=forces,
            parameters=parameters,
            stage=stage,
            frames_per_second=per_second,
        )
    # To a whole frame, so that the very end is drawn.
    frames = math.ceil(float(end - start) * per_second - 1e-9)
    meshcat.DeleteRecording()
    meshcat.StartRecording(per_second)
    Simulator(builder.Build()).AdvanceTo(frames / per_second)
    meshcat.StopRecording()
    meshcat.PublishRecording()


def _add_source(
    builder: DiagramBuilder, times: np.ndarray, values: np.ndarray
) -> OutputPort:
    """Adds a source of values over time, constant if there is but one."""
    source: System = ConstantVectorSource(values[0])
    if len(values) > 1:
        source = TrajectorySource(PiecewisePolynomial.FirstOrderHold(times, values.T))
    return builder.AddSystem(source).get_output_port()
