"""Flights of a campaign written as other software would, each with its MAP.

Every writer turns the flights into the axes, units and names of its format, the way
back from what an import does; a test then asks for the flights that they were.
"""

import dataclasses
import json
import struct
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from glider.campaign.logs import Campaign, Flight
from glider.campaign.reader import load_campaign
from tests.helpers.campaigns import campaign_path

FLIGHTS = 3
AHEAD = 40.0  # How far the servo's clock is ahead, where it has one of its own [s].


def flights(name: str = "still_air", count: int = FLIGHTS) -> Campaign:
    """Returns the first flights of a recorded campaign."""
    campaign = load_campaign(campaign_path(name))
    return dataclasses.replace(campaign, flights=campaign.flights[:count])


def write_table(
    path: Path, names: str, *columns: np.ndarray, digits: str = "%.9g"
) -> Path:
    """Writes a CSV file of columns below their names, as any program would."""
    table = np.column_stack(columns)
    np.savetxt(path, table, digits, ",", header=names, comments="")
    return path


def position(flight: Flight) -> np.ndarray:
    """Positions (n, 3), x forward, y left, z up."""
    x, z, _ = flight.pose.T
    return np.column_stack([x, np.zeros(len(x)), z])


def planar_rotation(pitch: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) by pitches (n,) alone, positive nose down."""
    return Rotation.from_euler("y", pitch[:, None]).as_matrix()


def rotation(flight: Flight) -> Rotation:
    """Turns nose, left and top to forward, left and up."""
    return Rotation.from_euler("y", flight.pose[:, 2:])


def in_axes(flight: Flight, world: np.ndarray, body: np.ndarray):
    """Returns positions and rotations in other axes, given as rows in ours."""
    turned = world @ rotation(flight).as_matrix() @ body.T
    return position(flight) @ world.T, Rotation.from_matrix(turned)


# Rows: the log's x, y and z in forward, left and up.
NED = np.diag([1.0, -1.0, -1.0])
Y_UP = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])  # x backward, z left

VEHICLE = """\
vehicle: {mass: 0.08, wing_area: 0.0885, gravity: 9.81, elevator_rate_limit: 13.0,
          elevator_limits: [-0.4463, 0.9473]}
command_rate: 50
"""

MAP_CSV = """\
columns: {time: Zeit, x: north, z: down, pitch: Nick, elevator: de,
          elevator_rate_command: de_cmd}
units: {time: ms, angle: deg, rate: deg/s}
frame: {axes: NED, elevator: trailing_edge_down}
"""


def write_csv(folder: Path, campaign: Campaign) -> list[Path]:
    """Semicolons, decimal commas, degrees, milliseconds; north, down, nose up."""
    files = []
    for flight in campaign.flights:
        x, z, pitch = flight.pose.T
        columns = [
            1000.0 * flight.time,
            x,
            -z,
            -np.degrees(pitch),
            -np.degrees(flight.elevator),
            -np.degrees(flight.command),
        ]
        rows = ["Versuch 7;;;;;", "Zeit;north;down;Nick;de;de_cmd", "ms;m;m;deg;;"]
        for values in np.column_stack(columns):
            rows.append(";".join(f"{v:.9f}".replace(".", ",") for v in values))
        path = folder / flight.name.replace("flight", "log")
        path.write_bytes("\r\n".join([*rows, ""]).encode("cp1252"))
        files.append(path)
    return files


MAP_MOTIVE = """\
join: ["*_poses.csv", "*_servo.csv"]
columns: {position: Glider.Position, attitude: Glider.Rotation, time: t,
          elevator: angle, elevator_rate_command: rate}
frame: {up: y, nose: x, top: y}
"""


def write_motive(folder: Path, campaign: Campaign) -> list[Path]:
    """Motive's quaternions, millimeters, y up, another body; servo on its own clock."""
    files = []
    body = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    for k, flight in enumerate(campaign.flights):
        place, turn = in_axes(flight, Y_UP, body)
        x, y, z, w = turn.as_quat().T
        lines = [
            "Format Version,1.24,Take Name,Take,Rotation Type,Quaternion,"
            "Length Units,Millimeters,Coordinate Space,Global",
            "",
            ",Type" + ",Rigid Body" * 7 + ",Rigid Body Marker" * 3 + ",Rigid Body" * 7,
            ",Name" + ",Glider" * 7 + ",Glider:Marker1" * 3 + ",Wand" * 7,
            ",ID" + ",1" * 17,
            ",,"
            + ("Rotation," * 4 + "Position," * 3)
            + "Position," * 3
            + "Rotation," * 4
            + "Position," * 2
            + "Position",
            "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z,X,Y,Z,W,X,Y,Z",
        ]
        for i, time in enumerate(flight.time):
            here = [x[i], y[i], z[i], w[i], *(1000.0 * place[i])]
            if i in (30, 31):  # Not seen for two rows.
                here = [0.0] * 7
            cells = [f"{v:.8f}" for v in here] + ["", "", ""] + ["0.5"] * 7
            lines.append(f"{i},{time:.6f}," + ",".join(cells))
        path = folder / f"take{k}_poses.csv"
        path.write_text("\n".join(lines) + "\n")
        servo = folder / f"take{k}_servo.csv"
        rest = np.arange(1, 121) / 120.0  # The servo is logged before and after, too.
        time = flight.time
        times = np.concatenate([time[0] - rest[::-1], time, time[-1] + rest])
        angle = np.pad(flight.elevator, 120, mode="edge")
        rate = np.pad(flight.command, 120)
        write_table(servo, "t,angle,rate", times + AHEAD, angle, rate)
        files += [path, servo]
    return files


MAP_ULOG = """\
columns: {position: vehicle_local_position, attitude: vehicle_attitude.q,
          elevator_angle_command: "actuator_controls_0.control[1]"}
units: {elevator_angle_command: {gain: -1.0}}
frame: NED
"""


def write_ulog(folder: Path, campaign: Campaign) -> list[Path]:
    """PX4's topics in NED; of the servo only the commanded angle is logged."""
    files = []
    for k, flight in enumerate(campaign.flights):
        place, turn = in_axes(flight, NED, NED)
        x, y, z, w = turn.as_quat().T
        stamp = np.round(1e6 * (flight.time + 12.0)).astype(np.uint64)
        control = np.zeros((len(stamp), 4))
        control[:, 1] = -flight.elevator
        topics = {
            ("vehicle_local_position", "float x;float y;float z;"): place,
            ("vehicle_attitude", "float[4] q;"): np.column_stack([w, x, y, z]),
            ("actuator_controls_0", "float[4] control;"): control,
        }
        path = folder / f"log_{k}.ulg"
        path.write_bytes(ulog_bytes(topics, stamp))
        files.append(path)
    return files


def ulog_bytes(
    topics: dict[tuple[str, str], np.ndarray],
    stamp: np.ndarray,
    parameters: dict[str, int] | None = None,
) -> bytes:
    """Returns a ULog file as PX4's logger writes it (dev guide, "ULog File Format")."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", int(stamp[0]))]
    for name, fields in topics:
        parts.append(message(b"F", f"{name}:uint64_t timestamp;{fields}".encode()))
    for name, value in (parameters or {}).items():
        key = f"int32_t {name}".encode()
        parts.append(message(b"P", bytes([len(key)]) + key + struct.pack("<i", value)))
    for i, (name, _) in enumerate(topics):
        parts.append(message(b"A", struct.pack("<BH", 0, i) + name.encode()))
    for row, time in enumerate(stamp):
        for i, values in enumerate(topics.values()):
            body = (
                struct.pack("<HQ", i, int(time)) + values[row].astype("<f4").tobytes()
            )
            parts.append(message(b"D", body))
    return b"".join(parts)


MAP_MAT = """\
columns: {time: log.t, position: log.p, attitude: log.eul, elevator: log.de,
          elevator_rate_command: log.de_dot}
units: {angle: deg, length: mm}
frame: {up: z, forward: throw, rotation: ZYX}
"""


def mat_content(flight: Flight) -> dict:
    """A struct of column vectors and matrices; Euler angles in the order z, y, x."""
    pitch = np.degrees(flight.pose[:, 2])
    x, _, z = position(flight).T
    place = np.column_stack([0.8 * x, 0.6 * x, z])  # Thrown at 36.87° from x.
    yaw = np.full(len(x), np.degrees(np.arctan2(0.6, 0.8)))
    return {
        "t": flight.time[:, None],
        "p": 1000.0 * place,
        "eul": np.column_stack([np.zeros(len(x)), pitch, yaw]),  # About x, y and z.
        "de": np.degrees(flight.elevator)[:, None],
        "de_dot": flight.command[:, None],
    }


def write_mat(folder: Path, campaign: Campaign) -> list[Path]:
    """Structs in .mat files; every second one in the HDF5 of version 7.3."""
    import h5py

    files = []
    for k, flight in enumerate(campaign.flights):
        path = folder / f"log_{k}.mat"
        if k % 2:
            with h5py.File(path, "w", userblock_size=512) as file:
                for name, value in mat_content(flight).items():
                    file[f"log/{name}"] = value.T
            with path.open("r+b") as raw:
                raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
        else:
            savemat(path, {"log": mat_content(flight)})
        files.append(path)
    return files


MAP_MCAP = """\
columns: {position: /glider/pose.pose.position,
          attitude: /glider/pose.pose.orientation,
          elevator: /servo.angle, elevator_rate_command: /servo.rate}
frame: ENU
"""


def write_mcap(folder: Path, campaign: Campaign) -> list[Path]:
    """Poses as ROS 2 messages in CDR, the servo as JSON."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/PoseStamped"
    text, _ = store.generate_msgdef(kind)
    files = []
    for k, flight in enumerate(campaign.flights):
        path = folder / f"flight_{k}.mcap"
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start("ros2", "test")
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            poses = writer.register_channel("/glider/pose", "cdr", schema)
            other = writer.register_schema("servo", "jsonschema", b"{}")
            servo = writer.register_channel("/servo", "json", other)
            for i, time in enumerate(flight.time):
                stamp = round(1e9 * (time + 1.7e9))
                message = pose_message(store, flight, i, stamp)
                data = bytes(store.serialize_cdr(message, kind))
                writer.add_message(poses, stamp + 5_000_000, data, stamp)
                angles = {
                    "timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9},
                    "angle": float(flight.elevator[i]),
                    "rate": float(flight.command[i]),
                }
                writer.add_message(servo, stamp, json.dumps(angles).encode(), stamp)
            writer.finish()
        files.append(path)
    return files


def pose_message(store, flight: Flight, row: int, stamp: int, seq: int | None = None):
    """Returns a PoseStamped; seq for ROS 1."""
    types = store.types
    x, y, z = position(flight)[row]
    quaternion = rotation(flight)[row].as_quat()
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    head = (time, "map") if seq is None else (seq, time, "map")
    return types["geometry_msgs/msg/PoseStamped"](
        types["std_msgs/msg/Header"](*head),
        types["geometry_msgs/msg/Pose"](
            types["geometry_msgs/msg/Point"](x, y, z),
            types["geometry_msgs/msg/Quaternion"](*quaternion),
        ),
    )


MAP_C3D = """\
columns: {position: "Glider:center.Position",
          attitude: {nose: "Glider:nose.Position", tail: "Glider:tail.Position",
                     left: "Glider:left.Position", right: "Glider:right.Position"},
          elevator: ANALOG.servo, elevator_rate_command: ANALOG.rate}
units: {elevator: deg}
frame: {up: y}
"""
MARKERS = {
    "Glider:nose": [0.2, 0.0, 0.0],
    "Glider:tail": [-0.3, 0.0, 0.0],
    "Glider:left": [0.0, 0.4, 0.1],
    "Glider:right": [0.0, -0.4, 0.1],
    "Glider:center": [0.0, 0.0, 0.0],
}
"""Points of the body, to the nose, left and up [m]."""


def write_c3d(folder: Path, campaign: Campaign) -> list[Path]:
    """Markers in millimeters, y up; the servo on analog channels."""
    import ezc3d

    files = []
    for k, flight in enumerate(campaign.flights):
        place, turn = in_axes(flight, Y_UP, np.eye(3))
        file = ezc3d.c3d()
        points, analog = file["parameters"]["POINT"], file["parameters"]["ANALOG"]
        rate = 1.0 / np.median(np.diff(flight.time))
        points["RATE"]["value"] = analog["RATE"]["value"] = [round(rate)]
        points["UNITS"]["value"] = ["mm"]
        points["LABELS"]["value"] = list(MARKERS)
        data = np.ones((4, len(MARKERS), len(place)))
        for i, point in enumerate(MARKERS.values()):
            data[:3, i] = 1000.0 * (place + turn.apply(point)).T
        residuals = np.zeros((1, len(MARKERS), len(place)))
        residuals[:, :, 30] = -1.0  # Not seen in one row.
        file["data"]["points"] = data
        file["data"]["meta_points"]["residuals"] = residuals
        analog["LABELS"]["value"] = ["servo", "rate"]
        servo = np.stack([np.degrees(flight.elevator), flight.command])
        file["data"]["analogs"] = servo[None]
        path = folder / f"take_{k}.c3d"
        file.write(str(path))
        files.append(path)
    return files


MAP_QTM = """\
join: ["*_6d.tsv", "*_servo.csv"]
clock: same
columns: {position: glider.Position, attitude: glider.Rotation, time: t,
          elevator: angle, elevator_rate_command: rate}
frame: {up: z}
"""


def qtm_text(flight: Flight) -> str:
    """A 6D export of QTM, whose two rows 30 and 31 do not show the body.

    The rotation matrix goes column by column; each row ends with a tab.
    """
    matrices = rotation(flight).as_matrix()
    angles = np.degrees(rotation(flight).as_euler("XYZ"))
    head = ["NO_OF_FRAMES\t103", "NO_OF_CAMERAS\t12", "NO_OF_BODIES\t1"]
    head += ["FREQUENCY\t120", "DESCRIPTION\t--", "DATA_INCLUDED\t6D"]
    head += ["TIME_STAMP\t2024-03-05, 14:02:00.123\t8412.00", "BODY_NAMES\tglider"]
    entries = "\t".join(f"Rot[{k}]" for k in range(9))
    own = f"glider X\tY\tZ\tRoll\tPitch\tYaw\tResidual\t{entries}\t"
    rows = [*head, f"Frame\tTime\t{own}"]
    for i, time in enumerate(flight.time - flight.time[0]):
        place, turn = 1000.0 * position(flight)[i], matrices[i].T.ravel()
        here = [*place, *angles[i], 0.4, *turn]
        if i in (30, 31):
            here = [0.0] * 6 + [-1.0] + [0.0] * 9
        rows.append(f"{i + 1}\t{time:.6f}\t" + "".join(f"{v:.8f}\t" for v in here))
    return "\r\n".join([*rows, ""])


def write_qtm(folder: Path, campaign: Campaign) -> list[Path]:
    """A TSV of QTM; the servo in a file of its own, on the same clock."""
    files = []
    for k, flight in enumerate(campaign.flights):
        path, servo = folder / f"take{k}_6d.tsv", folder / f"take{k}_servo.csv"
        path.write_text(qtm_text(flight), newline="")
        time = flight.time - flight.time[0]
        write_table(servo, "t,angle,rate", time, flight.elevator, flight.command)
        files += [path, servo]
    return files


MAP_TRC = """\
join: ["*.trc", "*_servo.txt"]
clock: same
columns: {time: [Time, time], position: [X5, Y5, Z5], elevator: angle,
          elevator_rate_command: rate, attitude: {nose: [X1, Y1, Z1],
            tail: [X2, Y2, Z2], left: [X3, Y3, Z3], right: [X4, Y4, Z4]}}
units: {length: mm}
frame: {up: y}
"""


def write_trc(folder: Path, campaign: Campaign) -> list[Path]:
    """OpenSim's markers in mm, any text; the servo by numpy.savetxt, on one clock."""
    files = []
    points = {name.removeprefix("Glider:"): point for name, point in MARKERS.items()}
    for k, flight in enumerate(campaign.flights):
        place, turn = in_axes(flight, Y_UP, np.eye(3))
        count, time = len(place), flight.time - flight.time[0]
        rows = [
            f"PathFileType\t4\t(X/Y/Z)\ttake{k}.trc",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate",
            f"120.00\t120.00\t{count}\t{len(points)}\tmm\t120.00",
            "Frame#\tTime\t" + "\t\t\t".join(points) + "\t\t",
            "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(points) + 1)),
            "",
        ]
        for i in range(count):
            here = [1000.0 * (place[i] + turn[i].apply(p)) for p in points.values()]
            if i in (30, 31):
                here = [np.zeros(3)] * len(points)
            cells = "\t".join(f"{v:.6f}" for v in np.ravel(here))
            rows.append(f"{i + 1}\t{time[i]:.6f}\t{cells}")
        path, servo = folder / f"take{k}.trc", folder / f"take{k}_servo.txt"
        path.write_text("\n".join([*rows, ""]))
        table = np.column_stack([time, flight.elevator, flight.command])
        np.savetxt(servo, table, header="time angle rate")
        files += [path, servo]
    return files


MAP_DATAFLASH = """\
columns: {x: XKF1.PN, z: XKF1.PD, pitch: XKF1.Pitch, elevator_angle_command: RCOU.C2}
units: {angle: deg, elevator_angle_command: {gain: 0.001, zero: 1500}}
frame: {axes: NED}
"""


def write_dataflash(folder: Path, campaign: Campaign) -> list[Path]:
    """ArduPilot's log, every second one as text; of the servo only the commands."""
    files = []
    for k, flight in enumerate(campaign.flights):
        path = folder / f"{k:08d}.{'log' if k % 2 else 'bin'}"
        x, z, pitch = flight.pose.T
        stamp = np.round(1e6 * (flight.time + 60.0)).astype(int)
        pulses = 1500 + 1000.0 * flight.elevator
        messages = [
            (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", []),
            (
                35,
                "XKF1",
                "Qffff",
                "TimeUS,Pitch,PN,PE,PD",
                [stamp, -np.degrees(pitch), x, 0 * x, -z],
            ),
            (36, "RCOU", "Qff", "TimeUS,C1,C2", [stamp, 0 * x, pulses]),
        ]
        path.write_bytes(dataflash_bytes(messages, is_text=bool(k % 2)))
        files.append(path)
    return files


def dataflash_bytes(messages: list[tuple], *, is_text: bool) -> bytes:
    """A log as ArduPilot's AP_Logger writes it: formats, then messages in turn."""
    parts, letters = (
        [],
        {"Q": "Q", "f": "f", "B": "B", "n": "4s", "N": "16s", "Z": "64s"},
    )
    for number, name, form, names, _ in messages:
        packed = "<BBB" + "".join(letters[letter] for letter in form)
        size = struct.calcsize(packed)
        values = number, size, name.encode(), form.encode(), names.encode()
        line = f"FMT, {number}, {size}, {name}, {form}, {names}\n".encode()
        head = struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, *values)
        parts.append(line if is_text else head)
    for row in range(len(messages[1][4][0])):
        for number, name, form, _, columns in messages[1:]:
            values = [column[row] for column in columns]
            line = ", ".join([name, str(values[0]), *(f"{v:.9f}" for v in values[1:])])
            packed = struct.pack(f"<BBB{form}", 0xA3, 0x95, number, *values)
            parts.append(f"{line}\n".encode() if is_text else packed)
    return b"".join(parts)


FORMATS = {
    "c3d": (write_c3d, MAP_C3D),
    "motive": (write_motive, MAP_MOTIVE),
    "ulog": (write_ulog, MAP_ULOG),
    "mat": (write_mat, MAP_MAT),
    "mcap": (write_mcap, MAP_MCAP),
    "csv": (write_csv, MAP_CSV),
    "qtm": (write_qtm, MAP_QTM),
    "trc": (write_trc, MAP_TRC),
    "dataflash": (write_dataflash, MAP_DATAFLASH),
}
"""Writer and MAP of each format."""
