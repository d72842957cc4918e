"""What becomes of deliberately wrong maps? Prints a table; exit code 1 for a fault.

    python -m benchmarks.bench_wrong_maps [--only SOURCE] [--case WORDS] [--quick]

Flights of five sources are written as tables, imported with maps that have one error
(or two), and what is accepted is traced. Good is a refusal, a doubt in the verdict's
sentence, and the right names. A fault is `effect_found` with another name. `--quick`
leaves out the tracing. Measured throws are those of ../shared.
"""

import argparse
import copy
import dataclasses
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from glider.campaign.importing.campaign_import import ImportResult, read_flights
from glider.campaign.logs import Campaign, Flight
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.sysid.pipeline import close_the_loop
from tests.helpers.tasks import fly, typical

MEASURED = Path(__file__).parents[2] / "shared" / "measured"
UP, DOWN = "trailing_edge_up", "trailing_edge_down"
DEGREE = np.pi / 180.0
AHEAD = 0.35  # Of the servo's clock, where it has its own [s].
SERVO = {
    "mass": 0.08,
    "wing_area": 0.0885,
    "elevator_rate_limit": 13.0,
    "elevator_limits": [-0.4463, 0.9473],
}

Map = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Case:
    """An error of a map: fields that replace the right ones, or a log that is other."""

    words: str
    change: Map = dataclasses.field(default_factory=dict)
    logged: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    """Columns that are logged as gain * (column + zero) instead."""
    rows: str = ""  # Rows that are added to each flight: a slide, a catch, a bounce.
    allowed: tuple[str, ...] = ()  # Effects that are a right name of the error.


@dataclasses.dataclass
class Source:
    """Flights with their right map, and what it then finds."""

    name: str
    campaign: Campaign
    right: Map
    cases: list[Case]
    expected: frozenset[str] = frozenset()


def tables(flight: Flight) -> dict[str, np.ndarray]:
    """The columns of a flight in SI."""
    x, z, pitch = flight.pose.T
    columns = {"time": flight.time, "x": x, "z": z, "pitch": pitch}
    if flight.attitude is not None:
        columns |= dict(zip(("y", "roll", "yaw"), flight.attitude.T, strict=True))
    if flight.elevator is not None and flight.command is not None:
        columns |= {"angle": flight.elevator, "rate": flight.command}
    return columns


def ended(columns: dict[str, np.ndarray], how: str) -> dict[str, np.ndarray]:
    """Adds what comes after a flight: rows on the floor, on the wire, in the air."""
    step = float(np.median(np.diff(columns["time"])))
    later = step * np.arange(1, round(0.3 / step))
    noise = np.random.default_rng(7).normal(size=(3, len(later))) * 0.0004
    vx = float(np.polyfit(columns["time"][-8:], columns["x"][-8:], 1)[0])
    vz = float(np.polyfit(columns["time"][-8:], columns["z"][-8:], 1)[0])
    last = {name: float(values[-1]) for name, values in columns.items()}
    added = {name: np.full(len(later), value) for name, value in last.items()}
    added["time"] = last["time"] + later
    if how == "slide":  # Gently: along the floor, slowing down by friction.
        moving = np.minimum(later, vx / 4.0)
        added["x"] = last["x"] + vx * moving - 2.0 * moving**2 + noise[0]
        added["z"] = last["z"] + 0.0 * later + noise[1]
    elif how == "catch":
        added["x"] = last["x"] + 0.01 * (1.0 - np.exp(-later / 0.02)) + noise[0]
        added["z"] = last["z"] + noise[1]
    elif how == "bounce":
        added["x"] = last["x"] + 0.6 * vx * later + noise[0]
        rise = 0.4 * abs(vz) * later - 4.905 * later**2
        added["z"] = last["z"] + rise + noise[1]
    added["pitch"] = last["pitch"] + noise[2]
    for name in {"angle", "rate"} & columns.keys():
        added[name] = np.zeros(len(later))
    return {n: np.concatenate([columns[n], added[n]]) for n in columns}


def write(folder: Path, source: Source, case: Case) -> list[Path]:
    """Writes a table for each flight; two where the servo has a clock of its own."""
    files = []
    for flight in source.campaign.flights:
        columns = tables(flight)
        if case.rows:
            columns = ended(columns, case.rows)
        for name in case.logged.keys() & columns.keys():
            gain, zero = case.logged[name]
            columns[name] = gain * (columns[name] + zero)
        parts = {"poses": columns}
        if "join" in source.right:
            servo = {n: columns.pop(n) for n in ("angle", "rate")}
            rest = np.arange(1, 121) / 120.0
            begin, end = flight.time[[0, -1]]
            when = np.concatenate([begin - rest[::-1], flight.time, end + rest])
            held = np.pad(servo["angle"], 120, mode="edge")
            rate = np.pad(servo["rate"], 120)
            parts["servo"] = {"t": when + AHEAD, "angle": held, "rate": rate}
        for part, table in parts.items():
            path = folder / f"{Path(flight.name).stem}_{part}.csv"
            values = np.column_stack(list(table.values()))
            names = ",".join(table)
            np.savetxt(path, values, "%.9g", ",", header=names, comments="")
            files.append(path)
    return files


def merged(right: Map, change: Map) -> Map:
    """A map with fields replaced; None takes one out."""
    result = copy.deepcopy(right)
    for part, value in change.items():
        if isinstance(value, dict):
            fields = {**(result.get(part) or {}), **value}
            result[part] = {n: v for n, v in fields.items() if v is not None}
        else:
            result[part] = value
    return result


def read(files: list[Path], path: Path, content: Map) -> ImportResult:
    """Imports files with a map."""
    path.write_text(yaml.safe_dump(content))
    return read_flights(files, path)


def judge(source: Source, case: Case, folder: Path, *, trace: bool) -> tuple[str, str]:
    """Good or a fault, and what a user sees."""
    files = write(folder, source, case)
    wrong = merged(source.right, case.change)
    try:
        imported = read(files, folder / "MAP.yaml", wrong)
    except InputError as error:
        return "refused", str(error).replace(f"{folder}/", "")
    warned = "; ".join(imported.campaign.notes)
    if not trace:
        return "accepted", warned
    try:
        result = close_the_loop(imported.campaign)
    except InputError as error:
        return "refused late", str(error)
    kinds = [effect.kind for effect in result.effects]
    other = set(kinds) - source.expected - set(case.allowed) - {"unexplained"}
    seen = f"{result.verdict} {','.join(kinds)} | {result.reason} | {warned}"
    if result.verdict in ("not_trusted", "no_effect"):
        return result.verdict, seen
    return ("FAULT: " + ",".join(sorted(other)) if other else "right"), seen


def scales(names: dict[str, tuple[float, ...]]) -> Iterator[Case]:
    """Errors of units: columns, and the gains that a map has too much."""
    for name, gains in names.items():
        allowed = {"length": ("position_scale",)}.get(name, ())
        for gain in gains:
            units = {"units": {name: {"gain": gain}}}
            yield Case(f"{name} x {gain:.3g}", units, allowed=allowed)


def cases_of_poses() -> Iterator[Case]:
    """Errors of times, lengths, attitudes, and of what comes after a flight."""
    yield from scales(
        {"length": (0.3048, 0.6, 0.9, 1.12, 1.5), "time": (0.8, 0.93, 1.1, 1.3)}
    )
    yield from (Case(f"pitch x {g}", {"units": {"pitch": {"gain": g}}}) for g in (0.8,))
    yield Case("pitch x -1", {"units": {"pitch": {"gain": -1.0}}})
    yield Case("pitch logged in deg", logged={"pitch": (1.0 / DEGREE, 0.0)})
    yield Case("pitch said to be deg", {"units": {"pitch": "deg"}})
    yield Case("lengths logged in mm", logged={n: (1e3, 0.0) for n in ("x", "z", "y")})
    yield Case("time logged in ms", logged={"time": (1e3, 0.0)})
    zero = ("pitch_offset", "camber", "wing_incidence", "frame_tilt")
    for off in (0.06, 0.5):
        unit = {"units": {"pitch": {"gain": 1.0, "zero": off}}}
        yield Case(f"pitch zero {off}", unit, allowed=zero)
    yield Case("up -z", {"frame": {"up": "-z"}})
    yield Case("x for z", {"columns": {"x": "z", "z": "x"}})
    yield Case("gravity -9.81", {"vehicle": {"gravity": -9.81}})
    yield Case("gravity 3.7", {"vehicle": {"gravity": 3.7}})
    for rows in ("slide", "catch", "bounce"):
        yield Case(f"then a {rows}", rows=rows)
    units = {"units": {"pitch": {"gain": -1.0}}, "frame": {"up": "-z"}}
    yield Case("TWO: pitch x -1, up -z", units)
    units = {"units": {"length": {"gain": 1.5}, "pitch": {"gain": -1.0}}}
    yield Case("TWO: length x 1.5, pitch x -1", units)


def cases_of_servos() -> Iterator[Case]:
    """Errors of an elevator and its commands."""
    rate, angle = "elevator_rate_command", "elevator"
    yield Case("elevator and command turned", {"frame": {"elevator": DOWN}})
    yield Case("elevator turned", {"frame": {"elevator": DOWN, "command": UP}})
    yield Case("command turned", {"frame": {"command": DOWN}})
    for gain in (0.5, 0.85, 0.93, 1.3, 2.0):
        yield Case(f"elevator x {gain}", {"units": {angle: {"gain": gain}}})
    for gain in (0.6, 0.75, 0.85, 0.95, 1.12, 1.4):
        units = {angle: {"gain": gain}, rate: {"gain": gain}}
        allowed = ("elevator_scale",)
        yield Case(f"elevator, command x {gain}", {"units": units}, allowed=allowed)
    units = {angle: {"gain": 1.0, "zero": 0.1}}
    yield Case("elevator zero 0.1", {"units": units}, allowed=("elevator_trim",))
    yield Case("elevator, command said deg", {"units": {angle: "deg", rate: "deg/s"}})
    yield Case("all said deg", {"units": {"angle": "deg", "rate": "deg/s"}})
    both = {"angle": (1.0 / DEGREE, 0.0), "rate": (1.0 / DEGREE, 0.0)}
    yield Case("elevator, command logged in deg", logged=both)
    yield Case("command logged in deg/s", logged={"rate": (1.0 / DEGREE, 0.0)})
    yield Case("elevator logged in deg", logged={"angle": (1.0 / DEGREE, 0.0)})
    yield Case("angle for rate", {"columns": {angle: "rate", rate: "angle"}})
    columns = {rate: None, "elevator_angle_command": "rate"}
    yield Case("rate as angle command", {"columns": columns})
    columns = {"units": {"elevator_angle_command": {"gain": 0.15}}, "columns": columns}
    yield Case("rate as angle command, within limits", columns)
    columns = {rate: None, angle: None, "elevator_angle_command": "rate"}
    units = {"elevator_angle_command": {"gain": 0.15}}
    yield Case(
        "rate as the only angle, within limits", {"columns": columns, "units": units}
    )
    yield Case("angle as rate", {"columns": {rate: "angle"}})
    yield Case("rate as elevator", {"columns": {angle: "rate"}})
    yield Case("pitch for elevator", {"columns": {"pitch": "angle", angle: "pitch"}})
    for clock in (0.01, -0.02, 0.06, -0.1, 0.3):
        late = ("command_delay",) if clock < 0 else ()
        yield Case(f"clock {clock:+}", {"clock": clock}, allowed=late)
    columns = {angle: None, rate: None}
    fixed = {"columns": columns, "vehicle": {"elevator": "fixed"}}
    yield Case("elevator: fixed", fixed)
    fixed = {"columns": columns, "vehicle": {"elevator": "fixed_per_flight"}}
    yield Case("elevator: fixed_per_flight", fixed)
    frame = {"elevator": DOWN, "up": "-z"}
    yield Case("TWO: elevator turned, up -z", {"frame": frame})
    change = {"units": {"pitch": {"gain": -1.0}}, "frame": {"elevator": DOWN}}
    yield Case("TWO: pitch x -1, elevator turned", change)
    change = {"units": {"length": "cm"}, "frame": {"elevator": DOWN, "command": UP}}
    yield Case("TWO: length cm, elevator turned", change)


def cases_of_vehicles() -> Iterator[Case]:
    """Errors of mass and area."""
    for name, gain, allowed in (
        ("mass", 2.0, ("mass", "inertia", "added_mass")),
        ("mass", 0.5, ("mass", "inertia")),
        ("wing_area", 2.0, ("mass",)),
        ("wing_area", 0.5, ("mass",)),
    ):
        vehicle = {"vehicle": {name: gain * SERVO[name]}}
        yield Case(f"{name} x {gain}", vehicle, allowed=allowed)


def sources() -> dict[str, Any]:
    """Makers of sources by name."""

    def servo(name: str, campaign: Campaign, cases: Iterator[Case]) -> Source:
        columns = {n: n for n in ("time", "x", "z", "pitch")}
        columns |= {"elevator": "angle", "elevator_rate_command": "rate"}
        right = {"columns": columns, "frame": {}, "units": {}, "vehicle": SERVO}
        rate = {"command_rate": campaign.command_rate}
        return Source(name, campaign, right | rate, list(cases))

    def own() -> Source:
        plan = {"flights": 15, "command_rate": 40.0}
        plan["capture"] = MotionCapture(rate=160.0)
        effects = typical("camber"), typical("servo_lag")
        cases = [*cases_of_poses(), *cases_of_servos(), *cases_of_vehicles()]
        return servo("own", fly(*effects, seed=11, **plan), iter(cases))

    def sample() -> Source:
        campaign = load_campaign("attached_lift")
        flights = campaign.flights[20:35]
        cases = [*cases_of_servos(), *cases_of_poses()]
        campaign = dataclasses.replace(campaign, flights=flights)
        return servo("attached_lift", campaign, iter(cases))

    def clocks() -> Source:
        off = (-0.3, -0.12, -0.06, -0.03, -0.02, -0.01, 0.01, 0.02, 0.04, 0.08, 0.2)
        cases = [Case(f"clock {d:+}", {"clock": round(AHEAD + d, 3)}) for d in off]
        columns = {"columns": {"time": ["time", "t"]}}
        source = sample()
        source.right = merged(source.right, columns)
        source.right |= {"join": ["*_poses.csv", "*_servo.csv"], "clock": AHEAD}
        source.name, source.cases = "two clocks", cases
        return source

    def commanded() -> Source:
        plan = {"flights": 15, "capture": MotionCapture(rate=100.0)}
        campaign = fly(typical("profile_drag"), seed=5, **plan)
        name = "elevator_angle_command"
        cases = [
            *scales({name: (0.5, 0.8, 1.25, 2.0)}),
            Case("command turned", {"frame": {"elevator": DOWN}}),
            Case("command said deg", {"units": {name: "deg"}}),
            Case("command logged in deg", logged={"angle": (1.0 / DEGREE, 0.0)}),
            Case("rate as command", {"columns": {name: "rate"}}),
            Case(
                "rate within limits as command",
                {"columns": {name: "rate"}, "units": {name: {"gain": 0.1}}},
            ),
            Case("zero 0.15", {"units": {name: {"gain": 1.0, "zero": 0.15}}}),
            *(Case(f"clock {c:+}", {"clock": c}) for c in (-0.1, -0.03, 0.02, 0.05)),
            Case("rate limit / 4", {"vehicle": {"elevator_rate_limit": 3.0}}),
            *scales({"length": (0.75, 1.25), "time": (0.9, 1.15)}),
            Case("pitch x -1", {"units": {"pitch": {"gain": -1.0}}}),
            Case("pitch for command", {"columns": {"pitch": "angle", name: "pitch"}}),
        ]
        columns = {n: n for n in ("time", "x", "z", "pitch")} | {name: "angle"}
        right = {"columns": columns, "frame": {}, "units": {}, "vehicle": SERVO}
        return Source("commanded", campaign, right, cases)

    def throws() -> Source:
        columns = {n: n for n in ("time", "x", "y", "z", "roll", "pitch", "yaw")}
        vehicle = {"hinge_offset": 0.18, "air_density": 1.2}
        vehicle["elevator"] = "fixed_per_flight"
        right = {"columns": columns, "frame": {}, "units": {}, "vehicle": vehicle}
        cases = [
            *cases_of_poses(),
            Case("nose -x", {"frame": {"nose": "-x"}}),
            Case("nose up", {"frame": {"pitch": "nose_up"}}),
            Case("roll for pitch", {"columns": {"roll": "pitch", "pitch": "roll"}}),
            Case("yaw for pitch", {"columns": {"yaw": "pitch", "pitch": "yaw"}}),
            Case("y for z", {"columns": {"y": "z", "z": "y"}}),
            Case("rotation XYZ", {"frame": {"rotation": "XYZ"}}),
            Case("angles said deg", {"units": {"angle": "deg"}}),
            Case(
                "angles logged in deg",
                logged={n: (1.0 / DEGREE, 0.0) for n in ("roll", "pitch", "yaw")},
            ),
        ]
        folder = MEASURED / "motion_studio_v3"
        return Source("throws", load_campaign(folder), right, cases)

    made = {"own": own, "attached_lift": sample, "two clocks": clocks}
    made["commanded"] = commanded
    return made | ({"throws": throws} if MEASURED.is_dir() else {})


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append")
    parser.add_argument("--case", default="")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    faults = 0
    for name, make in sources().items():
        if options.only and name not in options.only:
            continue
        source, counts = make(), {}
        with tempfile.TemporaryDirectory() as folder:
            if not options.quick:
                files = write(Path(folder), source, Case("right"))
                right = read(files, Path(folder) / "MAP.yaml", source.right)
                result = close_the_loop(right.campaign)
                source.expected = frozenset(e.kind for e in result.effects)
                found = ", ".join(sorted(source.expected))
                print(f"## {name}: right map: {result.verdict} {found}", flush=True)
            for case in source.cases:
                if options.case not in case.words:
                    continue
                begin = time.monotonic()
                label, seen = judge(source, case, Path(folder), trace=not options.quick)
                kind = label.partition(":")[0]
                counts[kind] = counts.get(kind, 0) + 1
                took = time.monotonic() - begin
                print(f"{name} | {case.words} | {label} | {seen} [{took:.0f} s]")
                sys.stdout.flush()
        faults += counts.get("FAULT", 0)
        print(f"## {name}: {counts}", flush=True)
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
