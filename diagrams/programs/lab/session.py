"""A session: each new throw is checked, flown again and traced, with all before it."""

import contextlib
import dataclasses
import functools
import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from diagrams.programs.lab.assistant import MapJob, next_map_job
from diagrams.programs.lab.comparison import Comparison, compare
from diagrams.programs.lab.folder import Watched, joint_digest
from diagrams.programs.lab.launches import Launches
from diagrams.programs.lab.link import StationLink
from diagrams.programs.lab.state import (
    CORRECTED,
    NOMINAL,
    Draft,
    Proposal,
    State,
    Throw,
    Trace,
    load_state,
    save_state,
)
from diagrams.programs.lab.tracing import Job, Worker
from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.masks import ExcludedRows
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.files import schema
from glider.files.lock import FolderLock
from glider.files.writing import check_writable
from glider.physics.model import GliderModel
from glider.progress import Progress, silent
from glider.simulation.refly import nominal_model, rollout_models
from glider.sysid.fit.prediction import RolloutModel

_RETRIES = 1
"""Times that a trace is tried again in a session whose process died, or failed."""

_SLOW = 3.0
"""Time after which reading a first throw means that code is compiled for it [s]: where
it is compiled already, a first throw was drawn after 2.4 s."""


class _Checks(NamedTuple):
    """What the checks of a campaign say."""

    campaign: Campaign
    excluded: tuple[ExcludedRows, ...] | None  #: None where they refuse it.
    notes: tuple[str, ...]


class LabSession:
    """Keeps the answer for a folder up to date; all it knows is in FOLDER/lab too.

    `step` is called again and again by a loop. A session that was ended goes
    on where it was.

    Args:
        folder: with campaign.yaml or MAP.yaml, into which throws come.
        progress: is given a line for each thing that is done.
        launches: of a simulated glider, if there is one to launch.
        link: to the station's bus; None: it is not listened to.

    Raises:
        InputError: the folder cannot be used, or another session has it open.
    """

    def __init__(
        self,
        folder: Path,
        progress: Progress = silent,
        launches: Launches | None = None,
        link: StationLink | None = None,
    ) -> None:
        self.watched = Watched(folder)
        self._progress = progress
        check_writable(self.watched.kept)
        self.watched.kept.mkdir(exist_ok=True)
        self._lock = FolderLock(self.watched.kept / ".session", folder, "session")
        self._file = self.watched.kept / "session.json"
        self.state = _without_faults(load_state(self._file))
        self.report = self.watched.kept / "report"
        self.launches = launches
        self.link = link
        self._campaign: Campaign | None = None  # Of the throws, as they were read.
        self._settings = b""  # What its campaign.yaml held.
        self._is_inspected = False
        self._has_drawn = False  # A throw, so that nothing remains to be compiled.
        self._looker = ThreadPoolExecutor(1)
        self._looking_since = 0.0
        self._looking: Future[Throw | _Checks | None] | None = None
        # By name of the model, with what each comes from.
        self._rollouts: dict[str, tuple[tuple[str, bytes], RolloutModel]] = {}
        self._worker = Worker()
        self.asked_map: str | None = None  #: A map to be checked; "": to propose.
        self.asked_proposal = False  #: Whether to look again where there is none.
        self.fault = ""  #: Of this program, in the last step; "" for none.

    @property
    def model_file(self) -> Path | None:
        """The file of the corrected model; None before the first trace."""
        file = self.report / "model.yaml"
        return file if self.state.answer and file.exists() else None

    @property
    def doing(self) -> str:
        """What is done in the background; "" for nothing."""
        flying = self.launches.doing if self.launches else ""
        is_slow = time.monotonic() > self._looking_since + _SLOW
        is_first = self._looking and is_slow and not self._has_drawn
        compiling = "reading the first throw (compiling once, about a minute)"
        job = self._worker.job
        words = flying, compiling if is_first else "", job.words if job else ""
        return "; ".join(filter(None, words))

    def stop(self) -> None:
        """Turns every servo on the bus to neutral, and ends the launches.

        By any thread, whatever the session works on.
        """
        if self.link:
            self.link.stop()
        if self.launches:
            self.launches.stop()

    def comparison(self, name: str) -> Comparison | None:
        """A throw beside its predictions; None where there is none."""
        known = {throw.name for throw in self.state.throws if throw.is_drawn}
        if name not in known:
            return None
        return schema.load_json(Comparison, self._place(name), "a throw flown again")

    def _place(self, name: str) -> Path:
        return self.watched.kept / "throws" / f"{name.removesuffix('.csv')}.json"

    def step(self, *, traces: bool = True) -> None:
        """Takes what is new: throws, and answers from the background."""
        rests = self.watched.rests()
        if rests and self.watched.is_new:
            self._list()
        if self.launches:
            flies = self.launches.step(self.model_file, len(self.state.throws))
            traces = traces and not flies
        if answer := self._worker.wait(0.0):
            self._take(answer)
        self._look()
        is_read = rests and not self.watched.is_new and self._next_look() is None
        is_free = traces and is_read and self._worker.job is None
        if is_free and (job := self._next_job()):
            self._worker.start(job)
            self._progress(job.words)

    def try_step(self) -> bool:
        """As `step`; a fault of this program is shown, and does not end the session."""
        try:
            self.step()
        except Exception as error:
            with contextlib.suppress(OSError):
                traceback.print_exc()
            self.fault = f"Fault of this program, tried again soon: {error!r}."
            self.watched.forget()
        else:
            self.fault = ""
        return not self.fault

    def _list(self) -> None:
        """Lists the throws that there are, before the first new one is flown again."""
        notes: list[str] = []
        try:
            notes += self.watched.read()
            throws, campaign = self._read(notes)
        except InputError as error:
            self._campaign = None
            self._change(notes=(*notes, str(error)))
            return
        self._campaign = campaign
        self._is_inspected = campaign is None
        self._settings = self.watched.settings.read_bytes() if campaign else b""
        traces = _without_faults(self.state).traces
        self._change(traces=traces, throws=tuple(throws), notes=tuple(notes))

    def _look(self) -> None:
        """Has the throws checked and flown again, one after the other, in a thread.

        Whatever this takes, as where code is compiled first, others are listed.
        """
        if self._looking and self._looking.done():
            looking = self._looking
            self._looking = None
            self._add(looking.result())
        look = self._next_look() or self._next_late_look()
        if look and self._looking is None:
            self._looking = self._looker.submit(look)
            self._looking_since = time.monotonic()

    def _next_look(self) -> Callable[[], Throw | _Checks] | None:
        """What remains to be found of the throws, the checks of all of them first."""
        campaign = self._campaign
        if campaign is None:
            return None
        if not self._is_inspected:
            return functools.partial(_check, campaign)
        new = [t for t in self.state.throws if t.is_read and not t.is_drawn]
        return functools.partial(self._drawn, new[0], campaign) if new else None

    def _next_late_look(self) -> Callable[[], Throw | None] | None:
        """The last throw that came before the first answer, to be flown by it too.

        Where there is none, the corrected model is prepared for the next throw.
        """
        campaign = self._campaign
        if campaign is None or not self.model_file:
            return None
        late = [
            throw
            for throw in self.state.throws
            if throw.is_drawn and CORRECTED not in throw.errors and not throw.is_fitted
        ]
        if late:
            return functools.partial(self._drawn, late[-1], campaign)
        is_known = self._basis(CORRECTED) == self._rollouts.get(CORRECTED, (None,))[0]
        return None if is_known else functools.partial(self._prepare, campaign)

    def _add(self, found: Throw | _Checks | None) -> None:
        """Adds what was found of throws, unless they have changed since."""
        if isinstance(found, Throw):
            self._has_drawn = True
            throws = [
                found if (t.name, t.sha256) == (found.name, found.sha256) else t
                for t in self.state.throws
            ]
            self._change(throws=tuple(throws))
        elif found is not None and found.campaign is self._campaign:
            self._is_inspected = True
            excluded = self.state.excluded if found.excluded is None else found.excluded
            notes = self.state.notes + found.notes
            self._change(excluded=excluded, notes=notes)

    def close(self) -> None:
        """Ends what runs in the background, and lets another have the folder."""
        if self.launches:
            self.launches.close()
        self._looker.shutdown()
        self._worker.close()
        self._lock.close()

    def _read(self, notes: list[str]) -> tuple[list[Throw], Campaign | None]:
        """The throws that there are, and the campaign of those that can be read."""
        throws = self.watched.throws(self.state.throws)
        folder = self.watched.campaign
        known = {(t.name, t.sha256) for t in self.state.throws}
        for k, throw in enumerate(throws):
            if (throw.name, throw.sha256) not in known:
                self._progress(f"{throw.name} has come")
                try:
                    load_campaign(folder, flights=[throw.name])
                except InputError as error:
                    throws[k] = dataclasses.replace(
                        throw, fault=str(error), is_read=False
                    )
        names = [throw.name for throw in throws if throw.is_read]
        try:
            return throws, load_campaign(folder, flights=names) if names else None
        except InputError as error:
            notes.append(str(error))
            return throws, None

    def _drawn(self, throw: Throw, campaign: Campaign) -> Throw:
        """Flies a throw again by the models that there are, and saves that."""
        answer = self.state.answer
        models = self._models(campaign)
        [flight] = [f for f in campaign.flights if f.name == throw.name]
        try:
            rollouts = self._rollouts_of(campaign, models)
            comparison = compare(campaign, flight, models, rollouts)
        except InputError as error:
            throw = dataclasses.replace(throw, fault=throw.fault or str(error))
            comparison = compare(campaign, flight, {}, {})
        file = self._place(throw.name)
        file.parent.mkdir(exist_ok=True)
        comparison.save(file)
        return dataclasses.replace(
            throw,
            is_drawn=True,
            errors=comparison.errors,
            is_fitted=answer is not None and throw.name in answer.flights,
        )

    def _models(self, campaign: Campaign) -> dict[str, GliderModel]:
        """The models that there are by now."""
        models = {}
        if nominal := nominal_model(campaign):
            models[NOMINAL] = nominal
        if self.model_file:
            models[CORRECTED] = GliderModel.load(self.model_file)
        return models

    def _rollouts_of(
        self, campaign: Campaign, models: dict[str, GliderModel]
    ) -> dict[str, RolloutModel]:
        """The models with what the flights have in common.

        The corrected model's are found once for each trace, as one throw more changes
        them too little to make people wait, and the nominal model's do not depend on
        traces, so that none changes its errors.
        """
        for name, model in models.items():
            basis = self._basis(name)
            if name not in self._rollouts or self._rollouts[name][0] != basis:
                varies = name == CORRECTED
                found = rollout_models(campaign, {name: model}, varies=varies)
                self._rollouts[name] = basis, found[name]
        return {name: self._rollouts[name][1] for name in models}

    def _basis(self, name: str) -> tuple[str, bytes]:
        """What a model comes from: the last answer, and campaign.yaml."""
        answer = self.state.answer if name == CORRECTED else None
        return answer.sha256 if answer else "", self._settings

    def _prepare(self, campaign: Campaign) -> None:
        """Does what the next throw needs."""
        self._rollouts_of(campaign, self._models(campaign))

    def _next_job(self) -> Job | MapJob | None:
        """What remains: a map to be checked, throws to be traced, then a proposal."""
        state = self.state
        asked = self.asked_map
        self.asked_map = None
        if job := next_map_job(self.watched, state.draft, asked):
            return job
        given = [throw for throw in state.throws if throw.is_read]
        if not given:
            return None
        digest = joint_digest(throw.sha256 for throw in given)
        last = state.traces[-1] if state.traces else None
        trace = Job(
            folder=self.watched.campaign,
            out=self.report,
            flights=state.flights,
            sha256=digest,
        )
        faults = sum(t.is_fault and t.sha256 == digest for t in state.traces)
        if last is None or last.sha256 != digest or 0 < faults <= _RETRIES:
            return trace
        if last.refusal:
            return None
        path = self.watched.path
        done = state.proposal
        again = self.asked_proposal
        self.asked_proposal = False
        if done and done.sha256 == digest and not (again and done.is_refused):
            return None
        return dataclasses.replace(trace, proposes=True, session=path)

    def _take(self, answer: Trace | Proposal | Draft) -> None:
        """Adds an answer to the state."""
        if isinstance(answer, Draft):
            self._change(draft=answer)
        elif isinstance(answer, Trace):
            self._progress(answer.headline or answer.refusal)
            self._change(traces=(*self.state.traces, answer))
        else:
            self._change(proposal=answer)

    def _change(self, **changes: object) -> None:
        """Saves a changed state."""
        state = dataclasses.replace(self.state, **changes)  # type: ignore[arg-type]
        if state != self.state:
            save_state(state, self._file)
            self.state = state


def _check(campaign: Campaign) -> _Checks:
    """Checks all throws together."""
    try:
        inspection = inspect(campaign)
    except InputError as error:
        return _Checks(campaign, None, (str(error),))
    return _Checks(campaign, inspection.excluded, tuple(inspection.warnings))


def _without_faults(state: State) -> State:
    """The state without the traces that a fault ended: they are tried again."""
    traces = tuple(trace for trace in state.traces if not trace.is_fault)
    return dataclasses.replace(state, traces=traces)
