"""The record of the throw that runs, written behind its commands."""

import contextlib

from diagrams.programs.station.session import Session
from diagrams.programs.station.throw import Throw
from diagrams.programs.station.throw_log import ThrowLog
from glider.errors import InputError


class Recorder:
    """Takes messages at any time, and writes them when nothing is more urgent.

    Args:
        session: folder of the records.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._log: ThrowLog | None = None
        self._waiting: list[tuple[str, float, dict[str, object]]] = []
        self.fault = ""  #: Why nothing can be recorded.

    def open(self) -> bool:
        """Begins a record, unless one has begun; returns whether there is one."""
        try:
            self._log = self._log or self._session.new_log()
        except OSError as error:
            self.fault = f"no record can be written: {error.strerror}"
            return False
        self.fault = ""
        return True

    def add(self, topic: str, when: float, **values: object) -> None:
        """Takes a message of a time by our clock [s]."""
        if self._log is not None:
            self._waiting.append((topic, when, values))

    def write(self) -> None:
        """Writes what has been taken; where that fails, there is no record any more."""
        waiting = self._waiting
        self._waiting = []
        try:
            for topic, when, values in waiting:
                if self._log is not None:
                    self._log.add(topic, when, **values)
        except OSError as error:
            self.fault = f"the record cannot be written: {error.strerror}"
            if self._log is not None:
                self._log.abandon()
            self._log = None

    def finish(self, throw: Throw, now: float) -> None:
        """Ends the record of a throw, and makes it a flight."""
        self.add("/event", now, **vars(throw.result))
        self.write()
        throw.reason = throw.reason or self.fault
        log = self._log
        self._log = None
        try:
            if log is not None:
                log.close()
                throw.file = self._session.save(log.path)
        except (OSError, InputError) as error:
            throw.reason = throw.reason or f"its record ends early: {error}"

    def close(self) -> None:
        """Removes a record that holds no throw, and lets go of the folder."""
        if self._log is not None:
            with contextlib.suppress(OSError):
                self._log.close()
            self._log.path.unlink(missing_ok=True)
            self._log = None
        self._session.close()
