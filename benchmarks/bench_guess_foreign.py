"""Is `import --guess` right on gliders and logs that it has never seen?

    python -m benchmarks.bench_guess_foreign [--draws N] [--seed S] [--right]

Flights of `thrown_gliders` are written in drawn conventions: axes of the log (also
left-handed), ways to log rotations, names in four languages, units, several bodies,
noise. The map that is proposed is imported, and all columns are compared to the truth.
Prints what was sure, asked, refused and wrong, by each property that was drawn. With
--right flights of one kind after the other are imported with the right map.
"""

import argparse
import collections
import dataclasses
import re
import tempfile
import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.bench_guess import _MOTIVE, turns
from benchmarks.thrown_gliders import KINDS, Take, draw_glider, fly
from glider.campaign.importing.campaign_import import ImportResult, read_flights
from glider.campaign.importing.guess import guess_mapping
from glider.campaign.importing.track import Track, angles_of, turn_along
from glider.errors import InputError

WORLDS = {
    "z_up": np.eye(3),
    "ned": np.diag([1.0, -1.0, -1.0]),
    "y_up": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x_up": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "left_handed_y_up": np.array([[0.0, -1, 0], [0, 0, 1], [1, 0, 0]]),
    "left_handed_z_up": np.diag([1.0, -1.0, 1.0]),
}
"""Rows: the log's axes in forward, left and up."""
ATTITUDES = (
    *("xyzw", "wxyz", "list_wxyz", "list_xyzw", "abcd", "q0123"),
    *("euler_ZYX", "euler_XYZ", "euler_xyz", "rpy", "pitch", "motive", "motive_euler"),
)
LENGTHS = {"m": 1.0, "mm": 1000.0, "cm": 100.0, "in": 1 / 0.0254}
TIMES = {"s": 1.0, "ms": 1e3, "us": 1e6}
WORDS = {
    "en": ("time", "x,y,z", "roll", "pitch", "yaw", "elevator", "elevator_cmd"),
    "aero": ("t", "North,East,Alt", "phi", "theta", "psi", "de", "de_cmd"),
    "de": (
        "Zeit",
        "Nord,Ost,Höhe",
        "Rollwinkel",
        "Nickwinkel",
        "Gierwinkel",
        "Höhenruder",
        "Höhenruder_Soll",
    ),
    "fr": (
        "temps",
        "nord,est,hauteur",
        "roulis",
        "tangage",
        "lacet",
        "profondeur",
        "profondeur_consigne",
    ),
    "es": (
        "tiempo",
        "norte,este,altura",
        "alabeo",
        "cabeceo",
        "guiñada",
        "timon_profundidad",
        "timon_profundidad_comando",
    ),
}


@dataclasses.dataclass(frozen=True)
class Convention:
    """How flights are logged."""

    world: str
    attitude: str
    length: str
    time: str
    words: str
    named: bool  # Whether units are in the names.
    degrees: bool
    nose_up: bool
    edge_up: bool
    command: str  # "", "rate" or "angle"
    noise: float  # [m]
    bodies: bool
    rate: float
    body: np.ndarray
    stem: str


def draw(rng: np.random.Generator) -> Convention:
    """A convention."""
    attitude = str(rng.choice(ATTITUDES))
    motive = attitude.startswith("motive")
    weights = [0.4, 0.2, 0.2, 0.05, 0.08, 0.07]
    world = str(rng.choice(list(WORLDS), p=weights))
    if motive:
        world = str(rng.choice(["y_up", "z_up", "left_handed_y_up"], p=[0.8, 0.2, 0]))
    if attitude in ("rpy", "pitch"):
        world = str(rng.choice(["z_up", "ned"]))
    usual = rng.uniform() < 0.7
    return Convention(
        world=world,
        attitude=attitude,
        length="mm"
        if motive
        else str(rng.choice(list(LENGTHS), p=[0.5, 0.25, 0.15, 0.1])),
        time=str(rng.choice(list(TIMES), p=[0.7, 0.2, 0.1])),
        words=str(rng.choice(list(WORDS))),
        named=bool(rng.uniform() < 0.5),
        degrees=bool(rng.uniform() < 0.6),
        nose_up=bool(rng.uniform() < 0.6),
        edge_up=bool(rng.uniform() < 0.5),
        command=str(rng.choice(["", "rate", "angle"])),
        noise=float(np.exp(rng.uniform(np.log(3e-4), np.log(5e-3)))),
        bodies=bool(rng.uniform() < 0.5),
        rate=float(rng.choice([50, 100, 120, 240])),
        body=(np.eye(3) if not motive else WORLDS["y_up"])
        if usual
        else turns()[rng.integers(24)],
        stem=str(rng.choice(["", "pos_", "p"])),
    )


def text_of(
    take: Take, way: Convention, rng: np.random.Generator, *, servo: bool
) -> str:
    """A take as a file."""
    world = WORLDS[way.world]
    throw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
    if way.attitude == "pitch" and rng.uniform() < 0.5:
        throw = Rotation.identity()
    place = throw.apply(take.position + np.array([1.0, 2.0, 0.0]))
    place = place + rng.normal(0, way.noise, place.shape)
    jitter = Rotation.from_rotvec(rng.normal(0, way.noise, place.shape))
    turn = throw * take.rotation * jitter
    mirror = np.linalg.det(world) < 0
    body = way.body @ (np.diag([1.0, -1.0, 1.0]) if mirror else np.eye(3))
    logged = Rotation.from_matrix(world @ turn.as_matrix() @ body.T)
    logged_place = place @ world.T * LENGTHS[way.length]
    time, *_ = WORDS[way.words]
    t0 = 0.0
    times = (take.time + t0) * TIMES[way.time]
    xyz, roll, pitch, yaw, elevator, command = WORDS[way.words][1:]
    ul = f"_{way.length}" if way.named else ""
    ua = ("_deg" if way.degrees else "_rad") if way.named else ""
    unit = 180.0 / np.pi if way.degrees else 1.0
    names, values = [time + (f"_{way.time}" if way.named else "")], [times]
    kind = way.attitude
    if kind.startswith("motive"):
        return _motive(take, logged_place, logged, kind, bodies=way.bodies)
    if kind in ("rpy", "pitch"):
        axes = xyz.split(",")
        if way.world == "ned" and way.words == "aero":
            axes[2] = "Down"
        if way.words != "en" and way.world == "z_up":
            logged_place = logged_place * [1, -1, 1]  # x, east, up: left-handed.
        flu = Rotation.from_matrix(
            throw.as_matrix() @ (take.rotation * jitter).as_matrix()
        )
        ypr = flu.as_euler("ZYX")
        sign = -1.0 if way.nose_up else 1.0
        if kind == "rpy":
            if way.world == "ned" or way.words != "en":
                ypr = ypr * [-1, 1, 1]  # As a compass.
            names += [a + ul for a in axes] + [a + ua for a in (roll, pitch, yaw)]
            values += [
                *logged_place.T,
                unit * ypr[:, 2],
                sign * unit * ypr[:, 1],
                unit * ypr[:, 0],
            ]
        else:
            flat = Track(
                path=Path(),
                time=take.time,
                position=take.position,
                rotation=take.rotation.as_matrix(),
                along_throw=True,
            )
            angle, _ = angles_of(turn_along(flat))
            names += [a + ul for a in axes] + [pitch + ua]
            values += [
                *logged_place.T,
                sign * unit * angle + rng.normal(0, way.noise * unit, len(angle)),
            ]
    else:
        names += [f"{way.stem}{a}{ul}" for a in "xyz"]
        values += list(logged_place.T)
        x, y, z, w = logged.as_quat().T
        if rng.uniform() < 0.5:
            x, y, z, w = (c * np.sign(w[0]) for c in (x, y, z, w))
        if kind == "xyzw":
            names += ["qx", "qy", "qz", "qw"]
            values += [x, y, z, w]
        elif kind == "wxyz":
            names += [f"quat_{a}" for a in "wxyz"]
            values += [w, x, y, z]
        elif kind in ("list_wxyz", "list_xyzw"):
            names += [f"q[{i}]" for i in range(4)]
            values += [w, x, y, z] if kind == "list_wxyz" else [x, y, z, w]
        elif kind == "q0123":
            names += [f"q{i}" for i in range(4)]
            values += [w, x, y, z]
        elif kind == "abcd":
            names += list("abcd")
            values += [w, x, y, z]
        else:
            order = kind.partition("_")[2]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                angles = logged.as_euler(order, degrees=way.degrees)
            by = [order.upper().index(a) for a in "XYZ"]
            names += [f"rot_{a}{ua}" for a in "xyz"]
            values += list(angles[:, by].T)
    if servo:
        sign = 1.0 if way.edge_up else -1.0
        names.append(elevator + ua)
        values.append(
            sign * unit * (take.elevator + rng.normal(0, 2e-3, len(take.time)))
        )
        if way.command:
            suffix = (
                ua
                if way.command == "angle"
                else {"_deg": "_deg_s", "_rad": "_rad_s", "": ""}[ua]
            )
            names.append(command + ("_rate" if way.command == "rate" else "") + suffix)
            values.append(
                sign
                * unit
                * (take.elevator if way.command == "angle" else take.command)
            )
    rows = (",".join(f"{v:.9g}" for v in row) for row in np.column_stack(values))
    return ",".join(names) + "\n" + "\n".join(rows) + "\n"


def _motive(
    take: Take, place: np.ndarray, turn: Rotation, kind: str, *, bodies: bool
) -> str:
    euler = kind == "motive_euler"
    angles = turn.as_euler("XYZ", degrees=True) if euler else turn.as_quat()
    count = angles.shape[1] + 3
    still = np.zeros((len(place), count)) + 0.3
    if not euler:
        still[:, :4] = [0, 0, 0, 1.0]
    parts = ["Rotation"] * (count - 3) + ["Position"] * 3
    axes = ["X", "Y", "Z", *("W" * (count - 6)), "X", "Y", "Z"]
    names = ["Wand", "Glider"] if bodies else ["Glider"]
    head = _MOTIVE.format(
        rotation="XYZ" if euler else "Quaternion",
        bodies=",Rigid Body" * count * len(names),
        names="".join(f",{n}" * count for n in names),
        ids="".join(f",{i}" * count for i in range(len(names))),
        parts=",".join(parts * len(names)),
        axes=",".join(axes * len(names)),
    )
    own = [angles, place]
    values = np.column_stack(
        [np.arange(len(place)), take.time, *([still] if bodies else []), *own]
    )
    return head + "\n".join(",".join(f"{v:.9g}" for v in row) for row in values) + "\n"


def compare(
    imported: ImportResult, takes: dict[str, Take], way: Convention, *, servo: bool
) -> str:
    """What is wrong in imported flights; "" where nothing is."""
    report = imported.report()["flights"]
    for flight, source in zip(imported.campaign.flights, report, strict=True):
        take = takes[Path(source["recording"]).name]
        time = source["begin"] + flight.time
        rows = np.searchsorted(take.time, time - 1e-4)
        if rows[-1] >= len(take.time) or np.abs(take.time[rows] - time).max() > 2e-3:
            return f"time: {source['begin']:.3f}..{time[-1]:.3f} s"
        true = turn_along(
            Track(
                path=Path(),
                time=take.time[rows],
                position=take.position[rows],
                rotation=take.rotation[rows].as_matrix(),
                along_throw=True,
            )
        )
        pitch, _ = angles_of(true)
        near = 3 * way.noise + 0.01
        if time[0] < take.free[0] - 0.15 or time[-1] > take.free[1] + 0.1:
            pass
        z = flight.pose[:, 1]
        if (
            np.abs(z - z[0] - true.position[:, 2] + true.position[0, 2]).max()
            > near + 2 * way.noise
        ):
            return "z"
        x = flight.pose[:, 0]
        if (
            np.abs(x - x[0] - true.position[:, 0] + true.position[0, 0]).max()
            > near + 0.1
        ):
            return "x"
        if flight.attitude is None:
            off = np.median(flight.pose[:, 2] - pitch)
            off -= 2 * np.pi * np.round(off / (2 * np.pi))
            steps = np.diff(flight.pose[:, 2] - pitch)
            if abs(off) > 0.05 or np.median(np.abs(steps)) > 0.1:
                return f"pitch by {np.degrees(off):.1f}"
        else:  # Past the vertical two triples of angles are one attitude.
            _, roll, yaw = flight.attitude.T
            angles = np.column_stack([yaw, flight.pose[:, 2], roll])
            mirrored = "left" in way.world or way.attitude == "rpy"
            ways = [[1, 1, 1], [-1, 1, -1]] if mirrored else [[1, 1, 1]]
            turns = [Rotation.from_euler("ZYX", angles * w) for w in ways]
            right = Rotation.from_matrix(true.rotation)
            off = min(np.median((t.inv() * right).magnitude()) for t in turns)
            if off > 0.07:
                return f"attitude by {np.degrees(off):.1f}"
        if servo and not way.attitude.startswith("motive"):
            if imported.campaign.elevator != "servo":
                return "the elevator is not found"
            if np.median(np.abs(flight.elevator - take.elevator[rows])) > 0.01:
                return "elevator"
            if (
                way.command
                and np.corrcoef(flight.command, take.command[rows])[0, 1] < 0.5
                and np.std(take.command[rows]) > 0.3
            ):
                return "command"
    return ""


def run_one(seed: int, k: int, verbose: bool = False) -> dict:
    """One draw: its properties, and how it ended."""
    rng = np.random.default_rng([seed, k])
    way = draw(rng)
    kind = str(rng.choice(KINDS))
    servo = bool(rng.uniform() < 0.5)
    count = int(rng.integers(1, 7))
    glider = draw_glider(rng, heavy=kind == "heavy")
    properties = {"kind": kind, "count": min(count, 3), "servo": servo} | {
        f.name: getattr(way, f.name)
        for f in dataclasses.fields(way)
        if f.name not in ("noise", "body", "stem")
    }
    with tempfile.TemporaryDirectory() as name:
        folder, takes = Path(name), {}
        for i in range(count):
            one = kind if rng.uniform() < 0.7 else str(rng.choice(["level", kind]))
            take = fly(rng, glider, one, servo=servo, rate=way.rate)
            path = folder / f"take_{i}.csv"
            path.write_text(text_of(take, way, rng, servo=servo))
            takes[path.name] = take
        files = sorted(folder.glob("*.csv"))
        head = files[0].read_text().splitlines()[0][:150]
        try:
            guess = guess_mapping(files)
        except InputError as error:
            return properties | {
                "end": "refused",
                "why": str(error).replace(name, ""),
                "head": head,
            }
        asks = re.search(
            r"\?(?! the flights do not show it| gain| missing)",
            guess.text.partition("vehicle:")[0],
        )
        text = guess.text
        if "elevator: servo" in text:
            text += "  elevator_rate_limit: 20.0\n"
        path = folder / "MAP.yaml"
        path.write_text(text)
        try:
            wrong = compare(read_flights(files, path), takes, way, servo=servo)
        except InputError as error:
            wrong = "import: " + str(error).replace(name, "")
        if wrong == "elevator" and "? the flights do not show it" in text:
            asks = True  # Of its sign.
        end = ("asked" if asks else "sure") + ("" if not wrong else ", wrong")
        return properties | {
            "end": end,
            "why": wrong,
            "text": guess.text,
            "head": head,
            "p": guess.probability,
            "glider": glider,
            "body": way.body,
            "noise": way.noise,
        }


RIGHT = """
columns: {time: time, position: [x, y, z], attitude: [qx, qy, qz, qw], %s}
vehicle: {%s}
"""
SERVO = "elevator: elevator, elevator_rate_command: elevator_cmd_rate"


def run_right(seed: int, k: int, kind: str) -> tuple[str, float]:
    """What is wrong with flights that the right map makes, and time after them [s]."""
    rng = np.random.default_rng([seed, k, KINDS.index(kind)])
    way = dataclasses.replace(
        draw(rng),
        **{"world": "z_up", "attitude": "xyzw", "length": "m", "time": "s"},
        **{"words": "en", "named": False, "degrees": False, "edge_up": True},
        **{"body": np.eye(3), "stem": "", "command": "rate"},
    )
    servo = bool(rng.uniform() < 0.5)
    glider = draw_glider(rng, heavy=kind == "heavy")
    limit = "elevator_rate_limit: 20.0" if servo else "elevator: fixed_per_flight"
    with tempfile.TemporaryDirectory() as name:
        folder, takes = Path(name), {}
        for i in range(4):
            take = fly(rng, glider, kind, servo=servo, rate=way.rate)
            path = folder / f"take_{i}.csv"
            path.write_text(text_of(take, way, rng, servo=servo))
            takes[path.name] = take
        path = folder / "MAP.yaml"
        path.write_text(RIGHT % (SERVO if servo else "", limit))
        try:
            imported = read_flights(sorted(folder.glob("*.csv")), path)
        except InputError as error:
            return "import: " + str(error).replace(name, ""), 0.0
        flights = imported.report()["flights"]
        after = [f["end"] - takes[Path(f["recording"]).name].free[1] for f in flights]
        return compare(imported, takes, way, servo=servo), max(after)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--right", action="store_true")
    args = parser.parse_args()
    if args.right:
        for kind in KINDS:
            found = [run_right(args.seed, k, kind) for k in range(args.draws)]
            wrong = collections.Counter(why for why, _ in found if why)
            slides = sum(after > 0.02 for _, after in found)
            print(f"{kind}: {wrong.total()} wrong or refused, {slides} slides", *wrong)
        return
    rows = []
    for k in range(args.draws):
        row = run_one(args.seed, k)
        rows.append(row)
        if row["end"] != "sure":
            print(
                k,
                row["end"],
                row["kind"],
                row["count"],
                row["world"],
                row["attitude"],
                row["words"],
                row["length"],
                row["time"],
                "|",
                row["why"],
                "|",
                row["head"],
            )
            if args.verbose and "text" in row:
                print(row["text"])
    for key in ("kind", "count", "attitude", "world", "words", "length", "time"):
        table = collections.Counter((str(r[key]), r["end"]) for r in rows)
        for value in sorted({str(r[key]) for r in rows}):
            print(
                key, value, {e: n for (v, e), n in sorted(table.items()) if v == value}
            )
    print(collections.Counter(r["end"] for r in rows))


if __name__ == "__main__":
    main()
