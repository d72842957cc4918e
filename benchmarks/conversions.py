"""A campaign rewritten as other users log flights: each form with the MAP it needs.

A form turns `Logs` into files and returns them with the columns, units and frame of its
MAP. `benchmarks.bench_conversions` imports them all.
"""

import dataclasses
import datetime
import json
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from glider.campaign.logs import Campaign, Flight
from tests.campaign.importing import foreign

NAMES = ("time", "x", "z", "pitch", "elevator", "elevator_rate_command")
PLAIN = "columns: {" + ", ".join(f"{name}: {name}" for name in NAMES) + "}\n"
BEGIN = datetime.datetime(2026, 5, 1, 23, 59, 58, tzinfo=datetime.UTC)
DEGREE = np.pi / 180.0

Written = tuple[list[Path], str]  # Files, and the text of their MAP.
Table = dict[str, Iterable]  # Columns by name.


def vehicle_text(campaign: Campaign) -> str:
    """Last lines of a MAP: what is known of the glider."""
    known = dict(campaign.vehicle) | {
        "elevator_rate_limit": campaign.elevator_rate_limit,
        "elevator_limits": list(campaign.elevator_limits or ()),
    }
    words = json.dumps(known)
    return f"vehicle: {words}\ncommand_rate: {campaign.command_rate:g}\n"


def table_of(flight: Flight) -> dict[str, np.ndarray]:
    """Columns of a flight in SI and this project's axes."""
    columns = (flight.time, *flight.pose.T, flight.elevator, flight.command)
    return dict(zip(NAMES, columns, strict=True))


def below(campaign: Campaign, step: float | None = None) -> dict[str, np.ndarray]:
    """All flights below each other; time restarts, or goes on after `step` seconds."""
    tables, begin = [], 0.0
    for flight in campaign.flights:
        tables.append(table_of(flight))
        if step is not None:
            tables[-1]["time"] = flight.time - flight.time[0] + begin
            begin = tables[-1]["time"][-1] + step
    return {name: np.concatenate([t[name] for t in tables]) for name in NAMES}


def labels_of(campaign: Campaign, words: str = "{}") -> list[str]:
    """The label of each row of `below`."""
    rows = [len(flight.time) for flight in campaign.flights]
    return [words.format(k + 1) for k, n in enumerate(rows) for _ in range(n)]


def text_of(
    table: Table, separator: str = ",", comma: bool = False, head: str | None = None
) -> str:
    """A table as text, each number to its last digit."""
    lines = [separator.join(table) if head is None else head]
    for row in zip(*(list(column) for column in table.values()), strict=True):
        cells = [c if isinstance(c, str) else repr(float(c)) for c in row]
        line = separator.join(cells)
        lines.append(line.replace(".", ",") if comma else line)
    return "\n".join([*lines, ""])


def each(
    folder: Path, campaign: Campaign, make: Callable[[Flight], str], **how: str
) -> list[Path]:
    """Writes a text for each flight."""
    files = []
    for k, flight in enumerate(campaign.flights):
        files.append(folder / f"log_{k:02d}.csv")
        files[-1].write_text(make(flight), **how)
    return files


def one(folder: Path, text: str, name: str = "session.csv") -> list[Path]:
    """Writes one file."""
    (folder / name).write_text(text)
    return [folder / name]


# ------------------------------------------------------------ other axes and units


def a_ned(folder: Path, campaign: Campaign) -> Written:
    """North, down, nose up, trailing edge down; millimeters, degrees, milliseconds."""

    def make(flight: Flight) -> str:
        t = table_of(flight)
        return text_of(
            {
                "t_ms": 1e3 * t["time"],
                "North_mm": 1e3 * t["x"],
                "Down_mm": -1e3 * t["z"],
                "Theta_deg": -t["pitch"] / DEGREE,
                "DE_deg": -t["elevator"] / DEGREE,
                "DE_cmd_degps": -t["elevator_rate_command"] / DEGREE,
            }
        )

    return each(folder, campaign, make), (
        "columns: {time: t_ms, x: North_mm, z: Down_mm, pitch: Theta_deg, "
        "elevator: DE_deg, elevator_rate_command: DE_cmd_degps}\n"
        "frame: {axes: NED, elevator: trailing_edge_down}\n"
    )


def m_turns(folder: Path, campaign: Campaign) -> Written:
    """Pitch from 0 to 360 degrees, positive nose up."""

    def make(flight: Flight) -> str:
        table = table_of(flight)
        return text_of(table | {"pitch": (-table["pitch"] / DEGREE) % 360.0})

    return each(folder, campaign, make), (
        PLAIN + "units: {pitch: deg}\nframe: {pitch: nose_up}\n"
    )


def m_half_a_turn(folder: Path, campaign: Campaign) -> Written:
    """Pitch that is off by half a turn, wrapped at 180 degrees."""

    def make(flight: Flight) -> str:
        table = table_of(flight)
        pitch = table["pitch"] / DEGREE % 360.0 - 180.0
        return text_of(table | {"pitch": pitch})

    units = f"units: {{pitch: {{gain: {DEGREE!r}, zero: -180.0}}}}\n"
    return each(folder, campaign, make), PLAIN + units


def l_planar(folder: Path, campaign: Campaign) -> Written:
    """Throws along -y."""

    def make(flight: Flight) -> str:
        table = table_of(flight)
        return text_of(table | {"x": 0.0 * flight.time + 2.0, "y": -table["x"]})

    return each(folder, campaign, make), PLAIN.replace("x: x", "x: x, y: y")


def _quaternions(turn: Rotation) -> dict[str, np.ndarray]:
    return dict(zip(("qx", "qy", "qz", "qw"), turn.as_quat().T, strict=True))


def _spatial(flight: Flight, turned: float = 0.0) -> tuple[dict, dict]:
    """Times and places, and the servo, of a throw in a direction."""
    turn = Rotation.from_euler("z", turned)
    place = turn.apply(foreign.position(flight)).T
    poses = {"t": flight.time, **dict(zip(("px", "py", "pz"), place, strict=True))}
    servo = {"servo": flight.elevator, "rate": flight.command}
    return poses | _quaternions(turn * foreign.rotation(flight)), servo


MAP_SPATIAL = (
    "columns: {time: t, position: p, attitude: q, elevator: servo, "
    "elevator_rate_command: rate}\n"
)


def d_quaternions(folder: Path, campaign: Campaign) -> Written:
    """Quaternions, thrown along x."""
    make = lambda f: text_of({**_spatial(f)[0], **_spatial(f)[1]})  # noqa: E731
    return each(folder, campaign, make), MAP_SPATIAL


def l_spatial(folder: Path, campaign: Campaign) -> Written:
    """Quaternions, thrown along -y."""
    half = -0.5 * np.pi
    make = lambda f: text_of({**_spatial(f, half)[0], **_spatial(f)[1]})  # noqa: E731
    return each(folder, campaign, make), MAP_SPATIAL


# ------------------------------------------------------------------- other dialects

MAP_GERMAN = (
    'columns: {time: Zeit, x: "Länge", z: "Höhe", pitch: Nickwinkel, '
    'elevator: "Höhenruder", elevator_rate_command: "Höhenruder Sollrate"}\n'
)
GERMAN = (
    "Zeit [ms];Länge [mm];Höhe [mm];Nickwinkel [°];Höhenruder [°];"
    "Höhenruder Sollrate [°/s]"
)


def i_german(folder: Path, campaign: Campaign) -> Written:
    """Semicolons, decimal commas, cp1252, umlauts, units in brackets."""

    def make(flight: Flight) -> str:
        gains = (1e3, 1e3, 1e3, *3 * (1.0 / DEGREE,))
        columns = zip(NAMES, gains, strict=True)
        table = {name: table_of(flight)[name] * gain for name, gain in columns}
        return text_of(table, ";", comma=True, head=GERMAN)

    return each(folder, campaign, make, encoding="cp1252"), MAP_GERMAN


def i_bom(folder: Path, campaign: Campaign) -> Written:
    """UTF-8 with a byte order mark, CRLF, empty rows and cells at the end."""

    def make(flight: Flight) -> str:
        text = text_of(table_of(flight), ";", comma=True)
        return text.replace("\n", "\r\n") + "\r\n;;;;;\r\n;;;;;\r\n\r\n"

    return each(folder, campaign, make, encoding="utf-8-sig", newline=""), PLAIN


def j_comments(folder: Path, campaign: Campaign) -> Written:
    """Comment lines, and a row of units."""
    head = "# throws of May\n# by me, 0.08 kg\n" + ",".join(NAMES)
    head += "\ns,m,m,deg,rad,rad/s"

    def make(flight: Flight) -> str:
        table = table_of(flight)
        return text_of(table | {"pitch": table["pitch"] / DEGREE}, head=head)

    return each(folder, campaign, make), PLAIN


def stamps(time: np.ndarray, zone: datetime.tzinfo | None = None) -> list[str]:
    """Dates and times in ISO 8601."""
    at = [BEGIN + datetime.timedelta(seconds=float(t)) for t in time]
    return [(t.astimezone(zone) if zone else t).isoformat() for t in at]


def k_iso(folder: Path, campaign: Campaign) -> Written:
    """ISO times over midnight, in another zone."""
    zone = datetime.timezone(datetime.timedelta(hours=2))

    def make(flight: Flight) -> str:
        return text_of(table_of(flight) | {"time": stamps(flight.time, zone)})

    return each(folder, campaign, make), PLAIN


def k_milliseconds(folder: Path, campaign: Campaign) -> Written:
    """Times as whole milliseconds."""

    def make(flight: Flight) -> str:
        return text_of(table_of(flight) | {"time": np.floor(1e3 * flight.time)})

    return each(folder, campaign, make), PLAIN + "units: {time: ms}\n"


# ------------------------------------------------------- many flights in one table


def many_flight_column(folder: Path, campaign: Campaign) -> Written:
    """A column of flights; time goes on without a gap."""
    labels = {"flight": labels_of(campaign, "throw {}")}
    return one(folder, text_of(below(campaign, 0.01) | labels)), PLAIN


def many_restarts(folder: Path, campaign: Campaign) -> Written:
    """Time that starts again."""
    return one(folder, text_of(below(campaign))), PLAIN


def many_blank_rows(folder: Path, campaign: Campaign) -> Written:
    """Flights parted by blank rows, and the names again above each."""
    texts = [text_of(table_of(flight)) for flight in campaign.flights]
    return one(folder, "\n\n".join(texts)), PLAIN


def many_columns(folder: Path, campaign: Campaign) -> Written:
    """Flights beside each other: of the shorter the last cells are empty."""
    longest = max(len(flight.time) for flight in campaign.flights)
    files = []
    for k, flight in enumerate(campaign.flights):
        short = {
            name: [repr(float(v)) for v in c] + [""] * (longest + k - len(c))
            for name, c in table_of(flight).items()
        }
        files.append(folder / f"log_{k:02d}.csv")
        files[-1].write_text(text_of(short))
    return files, PLAIN


def recorded(campaign: Campaign) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """One recording of all throws, carried between and caught, and each one's rows."""
    step = float(np.median(np.diff(campaign.flights[0].time)))
    parts: list[np.ndarray] = []
    rows, count, at = [], 0, np.array([-3.5, 1.2])
    for flight in campaign.flights:
        pose, speed = flight.pose, np.diff(flight.pose[:3], axis=0).mean(axis=0) / step
        throw = np.arange(-0.3, -0.5 * step, step)  # A hand accelerates it from rest.
        shape = (throw + 0.3) ** 2 / 0.6 - 0.15
        before = pose[0] + shape[:, None] * speed * 1.0
        before[:, 2] = pose[0, 2]
        goal, way = before[0, :2], np.linalg.norm(before[0, :2] - at)
        carry = np.linspace(0.0, 1.0, max(round(way / 1.0 / step), 60))
        smooth = (3.0 * carry**2 - 2.0 * carry**3)[:, None]
        carried = np.column_stack([at + smooth * (goal - at), 0 * carry + pose[0, 2]])
        rest = np.repeat(carried[-1:], 60, axis=0)
        caught = np.repeat(pose[-1:], 120, axis=0)
        whole = [carried, rest, before, pose, caught]
        first = count + len(carried) + len(rest) + len(before)
        rows.append(np.arange(first, first + len(pose)))
        count += sum(map(len, whole))
        idle = np.zeros(first - (count - sum(map(len, whole))))
        servo = np.column_stack(
            [
                np.r_[idle + flight.elevator[0], flight.elevator, np.zeros(120)],
                np.r_[idle, flight.command, np.zeros(120)],
            ]
        )
        parts.append(np.column_stack([np.concatenate(whole), servo]))
        at = pose[-1, :2]
    table = np.concatenate(parts)
    rng = np.random.default_rng(0)
    table[:, :3] += np.where(
        np.isin(np.arange(count), np.concatenate(rows))[:, None],
        0.0,
        rng.normal(size=(count, 3)) * [4e-4, 4e-4, 2.5e-3],
    )
    return dict(zip(NAMES, [np.arange(count) * step, *table.T], strict=True)), rows


def f_recording(folder: Path, campaign: Campaign) -> Written:
    """All throws in one recording, carried in between and caught."""
    return one(folder, text_of(recorded(campaign)[0])), PLAIN


# ------------------------------------------------------------------------- libraries


def b_mat_v5(folder: Path, campaign: Campaign) -> Written:
    """A struct in a .mat file of version 5 for each flight."""
    files = []
    for k, flight in enumerate(campaign.flights):
        files.append(folder / f"log_{k:02d}.mat")
        savemat(files[-1], {"log": foreign.mat_content(flight)})
    return files, foreign.MAP_MAT


def b_mat_v73(folder: Path, campaign: Campaign) -> Written:
    """The same in version 7.3."""
    import h5py

    files = []
    for k, flight in enumerate(campaign.flights):
        files.append(folder / f"log_{k:02d}.mat")
        with h5py.File(files[-1], "w", userblock_size=512) as file:
            for name, value in foreign.mat_content(flight).items():
                file[f"log/{name}"] = value.T
        with files[-1].open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return files, foreign.MAP_MAT


def b_mat_structs(folder: Path, campaign: Campaign) -> Written:
    """One array of structs."""
    contents = [foreign.mat_content(flight) for flight in campaign.flights]
    kind = [(name, object) for name in contents[0]]
    structs = np.array([tuple(content.values()) for content in contents], dtype=kind)
    savemat(folder / "throws.mat", {"log": structs, "mass": 0.08})
    return [folder / "throws.mat"], foreign.MAP_MAT


def _padded(values: np.ndarray, rows: int) -> np.ndarray:
    return np.pad(values, (0, rows - len(values)), constant_values=np.nan)


def b_mat_matrix(folder: Path, campaign: Campaign) -> Written:
    """One struct of matrices, a column a flight, padded with NaN at the end."""
    tables = [table_of(flight) for flight in campaign.flights]
    longest = max(len(flight.time) for flight in campaign.flights)
    padded = {
        name: np.stack([_padded(table[name], longest) for table in tables], axis=1)
        for name in NAMES
    }
    savemat(folder / "throws.mat", padded)
    return [folder / "throws.mat"], PLAIN


def c_mcap(folder: Path, campaign: Campaign) -> Written:
    """MCAP: poses in CDR, servo in JSON."""
    return foreign.write_mcap(folder, campaign), foreign.MAP_MCAP


def c_mcap_json(folder: Path, campaign: Campaign) -> Written:
    """MCAP in JSON, all flights of a day in one file, the topics by themselves."""
    from mcap.writer import Writer

    path = folder / "session.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "test")
        schema_id = writer.register_schema("log", "jsonschema", b"{}")
        topics = [writer.register_channel(t, "json", schema_id) for t in ("/p", "/s")]
        begin = 1.7e9
        for flight in campaign.flights:
            for row in range(len(flight.time)):
                stamp = round(1e9 * flight.time[row]) + int(begin) * 10**9
                x, z, pitch = map(float, flight.pose[row])
                pose = {"position": {"x": x, "y": 0.0, "z": z}, "pitch": pitch}
                servo = {"angle": float(flight.elevator[row])}
                servo["rate"] = float(flight.command[row])
                head = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}
                for topic, message in zip(topics, (pose, servo), strict=True):
                    data = json.dumps({"header": head} | message).encode()
                    writer.add_message(topic, stamp + 10**6, data, stamp)
            begin += 30.0
        writer.finish()
    return [path], (
        "columns: {x: /p.position.x, z: /p.position.z, pitch: /p.pitch, "
        "elevator: /s.angle, elevator_rate_command: /s.rate}\n"
    )


def c_ros2(folder: Path, campaign: Campaign) -> Written:
    """ROS 2 bags of PoseStamped and JointState."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    joint, kind = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped"
    files = []
    for k, flight in enumerate(campaign.flights):
        path = folder / f"bag_{k:02d}"
        with Writer(path, version=8) as writer:
            poses = writer.add_connection("/glider/pose", kind, typestore=store)
            servo = writer.add_connection("/joint_states", joint, typestore=store)
            for row, time in enumerate(flight.time):
                stamp = round(1e9 * (time + 1.7e9))
                message = foreign.pose_message(store, flight, row, stamp)
                data = store.serialize_cdr(message, kind)
                writer.write(poses, stamp + 3_000_000, data)
                state = store.types[joint](
                    message.header,
                    ["elevator"],
                    np.array([flight.elevator[row]]),
                    np.array([flight.command[row]]),
                    np.array([]),
                )
                data = store.serialize_cdr(state, joint)
                writer.write(servo, stamp + 1_000_000, data)
        files.append(path)
    return files, (
        "columns: {position: /glider/pose.pose.position, "
        "attitude: /glider/pose.pose.orientation, "
        'elevator: "/joint_states.position[0]", '
        'elevator_rate_command: "/joint_states.velocity[0]"}\nframe: ENU\n'
    )


# --------------------------------------------------------------------------- cameras


def e_motive(folder: Path, campaign: Campaign) -> Written:
    """Motive, two rows of each take unseen, and a servo log on another clock."""
    return foreign.write_motive(folder, campaign), foreign.MAP_MOTIVE


def vicon(folder: Path, campaign: Campaign) -> Written:
    """Vicon Tracker: rotation vectors, millimeters; the servo in its devices' rows."""
    files = []
    rate = round(1.0 / np.median(np.diff(campaign.flights[0].time)))
    for k, flight in enumerate(campaign.flights):
        place, turn = foreign.in_axes(flight, np.eye(3), np.eye(3))
        angles = turn.as_rotvec()
        lines = [
            "Objects",
            f"{rate}",
            ",,Global Angle Glider:Glider,,,,,",
            "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ",
            ",,rad,rad,rad,mm,mm,mm",
        ]
        for row in range(len(flight.time)):
            cells = [*angles[row], *(1e3 * place[row])]
            lines.append(f"{row + 1},0," + ",".join(repr(float(c)) for c in cells))
        files.append(folder / f"t{k:02d}_poses.csv")
        files[-1].write_text("\n".join(lines) + "\n")
        table = {"t": flight.time, "angle": flight.elevator, "rate": flight.command}
        files.append(folder / f"t{k:02d}_servo.csv")
        files[-1].write_text(text_of(table))
    return files, (
        'join: ["*_poses.csv", "*_servo.csv"]\nclock: same\n'
        'columns: {time: [Time, t], position: "Glider:Glider.Position", '
        'attitude: "Glider:Glider.Rotation", elevator: angle, '
        "elevator_rate_command: rate}\nframe: {up: z, rotation: rotation_vector}\n"
    )


def ulog(folder: Path, campaign: Campaign) -> Written:
    """PX4's topics in NED; only commanded angles."""
    return foreign.write_ulog(folder, campaign), foreign.MAP_ULOG


def ulog_session(folder: Path, campaign: Campaign) -> Written:
    """One ULog of all throws, parted by rest."""
    table, _ = recorded(campaign)
    flight = Flight(
        name="flight_000.csv",
        time=table["time"],
        pose=np.column_stack([table[n] for n in ("x", "z", "pitch")]),
        elevator=table["elevator"],
        command=table["elevator_rate_command"],
    )
    whole = dataclasses.replace(campaign, flights=(flight,))
    return foreign.write_ulog(folder, whole), foreign.MAP_ULOG


def c3d_markers(folder: Path, campaign: Campaign) -> Written:
    """C3D with markers, one row unseen; the servo on analog channels."""
    return foreign.write_c3d(folder, campaign), foreign.MAP_C3D


FORMS: dict[str, tuple[Callable[[Path, Campaign], Written], int | None]] = {
    "a: NED, mm, deg, ms, nose up, TE down": (a_ned, None),
    "b: .mat v5": (b_mat_v5, None),
    "b: .mat v7.3": (b_mat_v73, None),
    "b': .mat, one array of structs": (b_mat_structs, None),
    "b'': .mat, matrices with a column a flight": (b_mat_matrix, None),
    "c: MCAP, CDR and JSON": (c_mcap, None),
    "c: MCAP JSON, one file": (c_mcap_json, None),
    "c: ROS 2 bags, JointState": (c_ros2, None),
    "d: quaternions": (d_quaternions, None),
    "e: Motive, servo on another clock": (e_motive, None),
    "f: ten throws in one recording": (f_recording, 10),
    "i: German CSV in cp1252": (i_german, None),
    "i: BOM, CRLF, empty rows": (i_bom, None),
    "j: comments, units row": (j_comments, None),
    "k: ISO 8601": (k_iso, None),
    "k: whole milliseconds": (k_milliseconds, None),
    "l: along -y, pitch": (l_planar, None),
    "l: along -y, quaternions": (l_spatial, None),
    "m: pitch 0 to 360, nose up": (m_turns, None),
    "m': pitch off by half a turn": (m_half_a_turn, None),
    "Vicon CSV and servo CSV": (vicon, None),
    "ULog files": (ulog, None),
    "ULog of a session": (ulog_session, 10),
    "one CSV, column of flights": (many_flight_column, None),
    "one CSV, time restarts": (many_restarts, None),
    "one CSV, blank rows and names again": (many_blank_rows, None),
    "CSV padded with empty cells": (many_columns, None),
}
"""What writes a form, and how many of the flights."""
