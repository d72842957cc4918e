"""From any tracker to the bus.

What is left for a driver is twenty lines around the maker's own client. Vicon:

    from vicon_dssdk import ViconDataStream

    from diagrams.programs.station.drivers.poses import PosePublisher, Room

    room = Room(up="z", forward="x", nose="x", wire=[4.0, 1.2, 0.9])
    publisher = PosePublisher("udpm://239.255.76.67:7667?ttl=0", room)
    client = ViconDataStream.RetimingClient()
    client.Connect("192.168.10.1:801")
    while client.WaitForFrame():
        time = client.GetFrameNumber() / client.GetFrameRate()
        place, occluded = client.GetSegmentGlobalTranslation("glider", "glider")
        turn, _ = client.GetSegmentGlobalRotationQuaternion("glider", "glider")
        if not occluded:
            position = [0.001 * value for value in place]  # Vicon has mm.
            publisher.send(client.GetFrameNumber(), time, position, turn)

OptiTrack, with the client of the NatNet SDK (not yet tried against a real Motive):

    from NatNetClient import NatNetClient

    room = Room(up="y", forward="x", nose="x", wire=[4.0, 1.2, 0.0])
    publisher = PosePublisher("udpm://239.255.76.67:7667?ttl=0", room)
    bodies = {}

    def take_body(number, position, quaternion):
        bodies[number] = position, quaternion

    def take_frame(frame):
        publisher.send(frame["frame_number"], frame["timestamp"], *bodies[1])

    client = NatNetClient()
    client.rigid_body_listener = take_body
    client.new_frame_listener = take_frame
    client.run()

The time is that of the exposure, by any clock that does not jump; the quaternion is
(x, y, z, w). An occluded glider is no pose; the station refuses one that is repeated.
"""

import dataclasses
import math
import re
from collections.abc import Sequence

import numpy as np

from diagrams.programs.station.bus import POSE, POSE_FIELDS, Bus
from glider.campaign.settings import unit_vector
from glider.errors import expect


@dataclasses.dataclass(frozen=True, kw_only=True)
class Room:
    """A tracker's axes, and where the wire and the mass center are in them."""

    up: str = "y"  #: Axis of the room that points up, such as "z" or "-y".
    forward: str = "x"  #: Axis of the room along the throw.
    nose: str = "x"  #: Axis of the rigid body that points to the nose.
    #: Place of the wire, the station's origin [m].
    wire: Sequence[float] = (0.0, 0.0, 0.0)
    #: The rigid body's origin, (ahead, above) the center of mass [m].
    tracked_point: Sequence[float] = (0.0, 0.0)

    def __post_init__(self):
        """Raises InputError where an axis or a place cannot be."""
        for name in ("up", "forward", "nose"):
            axis = getattr(self, name)
            expected = "x, y, z, -x, -y or -z"
            expect(re.fullmatch("-?[xyz]", axis), f"the axis '{name}'", axis, expected)
        differ = self.up[-1] != self.forward[-1]
        expected = f"one across {self.up}"
        expect(differ, "the axis 'forward'", self.forward, expected)
        for name, count in (("wire", 3), ("tracked_point", 2)):
            place = getattr(self, name)
            good = len(place) == count and all(map(math.isfinite, place))
            expect(good, f"the place '{name}'", place, f"{count} finite numbers [m]")

    def pitch_of(self, quaternion: Sequence[float]) -> float:
        """Pitch [rad], positive with the nose down, of a quaternion (x, y, z, w)."""
        *vector, w = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
        nose = unit_vector(self.nose)
        turned = np.cross(vector, nose)
        pointing = nose + 2.0 * (w * turned + np.cross(vector, turned))
        ahead, above = (pointing @ unit_vector(a) for a in (self.forward, self.up))
        return -math.atan2(above, ahead)

    def place_of(self, position: Sequence[float], pitch: float) -> tuple[float, float]:
        """Place (x, z) of the center of mass [m], of a rigid body's position (3,)."""
        away = np.asarray(position, dtype=float) - np.asarray(self.wire)
        ahead, above = self.tracked_point
        cos = math.cos(pitch)
        sin = math.sin(pitch)
        x = away @ unit_vector(self.forward) - ahead * cos - above * sin
        z = away @ unit_vector(self.up) + ahead * sin - above * cos
        return float(x), float(z)


class PosePublisher:
    """Puts poses on the bus, in the frame of `glider.physics.state`.

    Args:
        bus: address of LCM, as in the station's scenario.
        room: axes.
    """

    def __init__(self, bus: str | Bus, room: Room) -> None:
        self._bus = Bus(bus) if isinstance(bus, str) else bus
        self._room = room

    def send(
        self,
        frame: int,
        time: float,
        position: Sequence[float],
        quaternion: Sequence[float],
        elevator: Sequence[float] | None = None,
    ) -> None:
        """Publishes one frame.

        Args:
            frame: its number.
            time: of its exposure, by the tracker's clock [s].
            position: (3,) of the rigid body [m].
            quaternion: (4,) of the rigid body, x, y, z, w.
            elevator: quaternion of a rigid body on the elevator; None: not tracked.
        """
        pitch = self._room.pitch_of(quaternion)
        x, z = self._room.place_of(position, pitch)
        angle = math.nan
        if elevator is not None:
            turned = self._room.pitch_of(elevator) - pitch
            angle = math.remainder(turned, 2.0 * math.pi)
        self._bus.say(POSE, time, (float(frame), x, z, pitch, angle), POSE_FIELDS)
