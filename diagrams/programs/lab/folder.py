"""The folder of a session: its files, and the campaign that they are."""

import dataclasses
import datetime
import functools
import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from diagrams.programs.lab.state import CORRECTED, NOMINAL, PROPOSED, Throw
from diagrams.programs.station.throw import ThrowResult
from diagrams.programs.station.throw_log import read_throw, scenario_of
from glider.campaign.importing.campaign_import import ImportResult, read_flights
from glider.campaign.settings import read_settings
from glider.campaign.writer import save_campaign
from glider.errors import InputError, expect
from glider.experiments.throw_limits import ThrowLimits
from glider.files import schema

Read = TypeVar("Read")

MAP = "MAP.yaml"
"""A folder with it holds takes of other software; one without it is a campaign."""

SETTINGS = "campaign.yaml"

_KEPT = "lab"
"""What the session writes is in this folder of its folder."""


class Watched:
    """The files of a folder, and the campaign of those that no longer change.

    Args:
        path: with campaign.yaml, as the station writes it, or with MAP.yaml; one
            with neither waits for either.

    Raises:
        InputError: it is no folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.kept = path / _KEPT
        self._sizes: dict[Path, tuple[int, int]] = {}
        self._imported: dict[Path, tuple[int, int]] = {}
        self._sources: dict[str, str] = {}  # Names of flights, and of their takes.
        self.skipped: dict[str, str] = {}  #: Takes that cannot be read, and why.
        expect(path.is_dir(), "the session's folder", str(path), "a folder that exists")

    @property
    def has_takes(self) -> bool:
        """Whether flights are cut out of takes."""
        return (self.path / MAP).is_file()

    @property
    def campaign(self) -> Path:
        """The folder of the campaign."""
        return self.kept / "campaign" if self.has_takes else self.path

    @property
    def settings(self) -> Path:
        """The file of what all throws have in common."""
        return self.campaign / SETTINGS

    @property
    def is_open(self) -> bool:
        """Whether it is not decided yet what the throws of this folder are."""
        return not (self.has_takes or (self.path / SETTINGS).is_file())

    @property
    def takes(self) -> list[Path]:
        """Files that are takes, or may be."""
        if not (self.has_takes or self.is_open):
            return []
        return sorted(
            file
            for file in self.path.iterdir()
            if file.is_file() and not file.name.startswith(".")
            if file.suffix not in (".md", ".png", ".yaml")
        )

    def rests(self) -> bool:
        """Whether all files are as they were the last time that this was asked."""
        before = self._sizes
        now = _sizes(self._files())
        self._sizes = now
        return now == before

    @property
    def is_new(self) -> bool:
        """Whether the files are not those that were read."""
        return not self.is_open and self._sizes != self._imported

    def forget(self) -> None:
        """Makes everything a change: what was read was lost in a fault."""
        self._imported = {}

    def read(self) -> tuple[str, ...]:
        """Imports the takes, if these are some; returns warnings.

        All takes are imported together each time: clocks and signs are found from all.
        Those that cannot be read are skipped. A flight has the name of its take, so
        that it keeps its name whatever other takes come and go.

        Raises:
            InputError: they cannot be imported, or campaign.yaml not be read.
        """
        self._imported = self._sizes = _sizes(self._files())
        takes = self.takes
        if not self.has_takes:
            read_settings(self.settings)
        if not (self.has_takes and takes):
            return ()
        mapping = self.path / MAP
        imported, self.skipped = read_some(
            takes, functools.partial(read_flights, mapping=mapping)
        )
        named = _flight_names(imported, takes)
        self._sources = {name: take.name for name, take in named.items()}
        flights = []
        for flight, name in zip(imported.campaign.flights, named, strict=True):
            flights.append(dataclasses.replace(flight, name=name))
        campaign = dataclasses.replace(imported.campaign, flights=tuple(flights))
        for file in self.campaign.glob("flight_*.csv"):
            # Of a take that is gone, or cut differently.
            if file.name not in named:
                file.unlink()
        save_campaign(self.campaign, campaign)
        return tuple(imported.warnings)

    def throws(self, known: Sequence[Throw]) -> list[Throw]:
        """The flights of the campaign; known ones whose files are the same stay."""
        files = sorted(self.campaign.glob("flight_*.csv"))
        digests = throw_digests(self.campaign, [file.name for file in files])
        found = [self._new_throw(name, own) for name, own in digests.items()]
        nominal = ""
        for throw in found:
            first = _record(self.path, throw)
            if first is not None:
                facts, _ = read_throw(first)
                nominal = facts.get("model", "")
                break
        same = {(throw.name, throw.sha256): throw for throw in known}
        throws = []
        for throw in found:
            before = same.get((throw.name, throw.sha256))
            throws.append(before or _with_record(throw, self.path, nominal))
        return throws

    def _new_throw(self, name: str, sha256: str) -> Throw:
        take = self._sources.get(name, "")
        file = self.path / take if take else self.campaign / name
        written = _time_of_day(file.stat().st_mtime)
        return Throw(name=name, sha256=sha256, take=take, written=written)

    def _files(self) -> list[Path]:
        if self.has_takes or self.is_open:
            return [*self.takes, *self.path.glob(MAP)]
        return sorted([*self.path.glob("flight_*.csv"), *self.path.glob(SETTINGS)])


def read_some(
    files: Sequence[Path], read: Callable[[list[Path]], Read]
) -> tuple[Read, dict[str, str]]:
    """Reads files together, without those that cannot be; returns why, by their names.

    Args:
        files: to be read.
        read: reads files together; where it refuses one, its message begins with it.

    Raises:
        InputError: nothing is left, or `read` refuses them all together.
    """
    good = list(files)
    reasons = dict[str, str]()
    while True:
        try:
            return read(good), reasons
        except InputError as error:
            named = next((f for f in good if str(error).startswith(f"{f}:")), None)
            if named is None or len(good) == 1:
                raise
            reasons[named.name] = str(error).removeprefix(f"{named.parent}/")
            good.remove(named)


def _flight_names(imported: ImportResult, takes: Sequence[Path]) -> dict[str, Path]:
    """A name for each flight, in their order, and the take that it is of."""
    named: dict[str, Path] = {}
    for flight in imported.report()["flights"]:
        recording = Path(flight["recording"])
        take = next(p for p in (recording, *recording.parents) if p in takes)
        name = f"flight_{take.stem}.csv"
        number = 1
        while name in named:
            number += 1
            name = f"flight_{take.stem}+{number}.csv"
        named[name] = take
    return named


def throw_digests(campaign: Path, names: Sequence[str]) -> dict[str, str]:
    """Digests of flights of a campaign, each with campaign.yaml, by name."""
    settings = (campaign / SETTINGS).read_bytes() if names else b""
    common = hashlib.sha256(settings).digest()
    return {
        name: hashlib.sha256(common + (campaign / name).read_bytes()).hexdigest()
        for name in names
    }


def limits_of(folder: Path) -> ThrowLimits | None:
    """The room, as the station's last record has it, in which throws are proposed.

    None without a record: as flown.
    """
    records = sorted(folder.glob("throw_*.mcap"))
    if not records:
        return None
    facts, _ = read_throw(records[-1])
    room = scenario_of(facts, records[-1]).limits
    return ThrowLimits(x=room.x, z=room.z)


def joint_digest(digests: Iterable[str]) -> str:
    """Digest of the contents of flights, in their order."""
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def _time_of_day(time: float) -> str:
    """A time [s since 1970] on a calendar, in the time zone of this computer."""
    return datetime.datetime.fromtimestamp(time).astimezone().isoformat("T", "seconds")


def _sizes(files: list[Path]) -> dict[Path, tuple[int, int]]:
    found = {}
    for file in files:
        try:
            stat = file.stat()
        except FileNotFoundError:  # It was moved away since.
            continue
        found[file] = stat.st_size, stat.st_mtime_ns
    return found


def _record(folder: Path, throw: Throw) -> Path | None:
    """The station's record of a flight, if it has one."""
    name = throw.name.replace("flight", "throw").replace(".csv", ".mcap")
    return folder / name if (folder / name).is_file() else None


def _with_record(throw: Throw, folder: Path, nominal: str) -> Throw:
    """Adds what the station recorded: the plan's model, and how the throw ended."""
    record = _record(folder, throw)
    if record is None:
        return throw
    facts, topics = read_throw(record)
    planned = NOMINAL if facts.get("model") == nominal else CORRECTED
    try:
        if scenario_of(facts, record).commands:
            planned = PROPOSED
        results = [e for e in topics["/event"] if e.get("state") == "result"]
        if not results:  # The station died before the throw was over.
            raise InputError("its record ends early")
        result = schema.convert(results[-1], ThrowResult, str(record))
    except InputError as error:
        return dataclasses.replace(throw, planned=planned, fault=str(error))
    return dataclasses.replace(
        throw,
        planned=planned,
        perched=result.perched,
        miss=result.miss_m if math.isfinite(result.miss_m) else None,
        fault=result.reason,
        flown=result.flown,
    )
