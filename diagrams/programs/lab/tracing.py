"""Traces and proposes in a process of its own, which stays warm between throws."""

import dataclasses
import multiprocessing
import os
import traceback
from collections.abc import Iterable
from multiprocessing.connection import Connection
from pathlib import Path

from diagrams.programs.lab.assistant import MapJob
from diagrams.programs.lab.folder import joint_digest, limits_of, throw_digests
from diagrams.programs.lab.state import Draft, Proposal, Trace, trace_of
from diagrams.programs.station.processes import end_with
from glider.errors import InputError
from glider.report.wording import counted

_NICENESS = 10
"""Of the process: what flies, and the page, go first."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Job:
    """A trace of the flights of a campaign, or the throw that comes after it."""

    folder: Path  #: Of the campaign.
    out: Path  #: Folder of the report.
    flights: tuple[str, ...]
    sha256: str  #: Of their contents.
    proposes: bool = False  #: Whether the report is there, and a throw is wanted.
    session: Path | None = None  #: Folder with the station's records.

    @property
    def words(self) -> str:
        """What is done."""
        what = "looking for the next throw" if self.proposes else "tracing"
        return f"{what} ({counted(self.flights, 'throw')})"

    def run(self) -> Trace | Proposal:
        """Does it; what the input does not permit is in the answer."""
        try:
            return self._propose() if self.proposes else self._trace()
        except InputError as error:
            why = str(error).removeprefix(f"{self.folder}: ")
            why = f"{self.failure}: {why}" if self.proposes else why
            return self.refused(why, is_fault=not self._is_there)

    @property
    def failure(self) -> str:
        """The beginning of a sentence about why it was not done."""
        if self.proposes:
            return "The next throw could not be found"
        return "The throws could not be traced"

    @property
    def _is_there(self) -> bool:
        """Whether the folder still holds the flights that were asked for."""
        try:
            found = throw_digests(self.folder, self.flights).values()
        except OSError:
            return False
        return joint_digest(found) == self.sha256

    def refused(self, why: str, *, is_fault: bool = False) -> Trace | Proposal:
        """The answer where there is none."""
        if self.proposes:
            return dataclasses.replace(self._proposal((why,)), is_refused=True)
        return Trace(
            flights=self.flights, sha256=self.sha256, refusal=why, is_fault=is_fault
        )

    def _trace(self) -> Trace:
        from glider.campaign.reader import load_campaign
        from glider.report.folder import write_report
        from glider.report.wording import headline
        from glider.sysid.pipeline import close_the_loop

        campaign = load_campaign(self.folder, flights=self.flights)
        if not self._is_there:
            raise InputError("The throws changed while they were read.")
        result = close_the_loop(campaign, flights=self.flights)
        write_report(result, self.out)
        return trace_of(result.report, headline(result), self.sha256)

    def _propose(self) -> Proposal:
        from glider.experiments.explanations import load_findings
        from glider.experiments.proposal import next_throw
        from glider.report.next_throw import (
            is_done,
            sentences,
            throw_words,
            write_proposal,
        )

        limits = limits_of(self.session) if self.session else None
        findings = load_findings(self.out)
        found = next_throw(self.folder, findings, launches=1, limits=limits)
        write_proposal(found, self.out / "next_throw")
        words = [throw_words(found, k + 1) for k in range(len(found.throws))]
        advice = (
            "Another throw would teach nothing more: plan again with the corrected "
            "model."
            if is_done(found)
            else "Another throw would teach more. The most informative one:"
        )
        return self._proposal((advice, *sentences(found)), words)

    def _proposal(self, why: Iterable[str], throws: Iterable[str] = ()) -> Proposal:
        return Proposal(
            flights=len(self.flights),
            sentences=tuple(why),
            throws=tuple(throws),
            sha256=self.sha256,
        )


_AnyJob = Job | MapJob


class Worker:
    """The process. It has one job at a time, and dies with us."""

    def __init__(self) -> None:
        self.job: _AnyJob | None = None  #: That it works on.
        self._process: multiprocessing.process.BaseProcess | None = None
        self._pipe: Connection | None = None

    def start(self, job: _AnyJob) -> None:
        """Begins a job."""
        if self._process is None or not self._process.is_alive():
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs, os.getpid()))
            self._process.start()
            theirs.close()
        assert self._pipe is not None
        self._pipe.send(job)
        self.job = job

    def wait(self, seconds: float) -> Trace | Proposal | Draft | None:
        """Waits for the answer of the job [s]; None where there is none yet."""
        job = self.job
        if self._pipe is None or job is None:
            return None
        if self._pipe.poll(seconds):
            try:
                answer = self._pipe.recv()
            except (EOFError, OSError):  # Reset where it was killed.
                self.close()
                why = "the process that works on it died"
                return job.refused(f"{job.failure}: {why}.", is_fault=True)
            self.job = None
            return answer
        return None

    def close(self) -> None:
        """Ends the process, in the midst of its job."""
        if self._process is not None:
            self._process.terminate()
            self._process.join()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = self.job = None


def _serve(pipe: Connection, parent: int) -> None:
    """Does job after job until the pipe is closed, or the session's process ends."""
    end_with(parent)
    os.nice(_NICENESS)
    while True:
        try:
            job = pipe.recv()
        except (EOFError, KeyboardInterrupt):
            return
        try:
            pipe.send(job.run())
        except KeyboardInterrupt:
            return
        except Exception as error:  # A fault of ours must not end a session.
            traceback.print_exc()
            why = f"this program has a fault ({type(error).__name__}: {error})"
            pipe.send(job.refused(f"{job.failure}: {why}.", is_fault=True))
