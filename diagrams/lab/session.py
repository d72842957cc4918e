"""A session: each new throw is checked, flown again and traced, with all before it."""

import contextlib
import dataclasses
import traceback
from pathlib import Path

from diagrams.lab.assistant import MapJob, next_map_job
from diagrams.lab.comparison import Comparison, compare, load_comparison
from diagrams.lab.folder import Watched, joint_digest
from diagrams.lab.launches import Launches
from diagrams.lab.state import (
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
from diagrams.lab.tracing import Job, Worker
from glider.campaign.checks.inspection import inspect
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.files.lock import FolderLock
from glider.files.writing import check_writable
from glider.physics.model import GliderModel
from glider.progress import Progress, silent
from glider.simulation.refly import nominal_model, rollout_models
from glider.sysid.fit.prediction import RolloutModel

RETRIES = 1
"""Times that a trace is tried again in a session whose process died, or failed."""


class LabSession:
    """Keeps the answer for a folder up to date; all it knows is in FOLDER/lab too.

    `step` is called again and again by a loop. A session that was ended goes
    on where it was.

    Args:
        folder: with campaign.yaml or MAP.yaml, into which throws come.
        progress: is given a line for each thing that is done.
        launches: of a simulated glider, if there is one to launch.

    Raises:
        InputError: the folder cannot be used, or another session has it open.
    """

    def __init__(
        self,
        folder: Path,
        progress: Progress = silent,
        launches: Launches | None = None,
    ) -> None:
        self.watched, self._progress = Watched(folder), progress
        check_writable(self.watched.kept)
        self.watched.kept.mkdir(exist_ok=True)
        self._lock = FolderLock(self.watched.kept / ".session", folder, "session")
        self._file = self.watched.kept / "session.json"
        self.state = _without_faults(load_state(self._file))
        self.report = self.watched.kept / "report"
        self.launches = launches
        #: With what they are of.
        self._rollouts: tuple[tuple[str, bytes], dict[str, RolloutModel]] | None = None
        self._worker = Worker()
        self.asked_map: str | None = None  #: A map to be checked; "": to propose.
        self.fault = ""  #: Of this program, in the last step; "" for none.

    @property
    def model_file(self) -> Path | None:
        """The file of the corrected model; None before the first trace."""
        file = self.report / "model.yaml"
        return file if self.state.answer and file.exists() else None

    @property
    def doing(self) -> str:
        """What is done in the background; "" for nothing."""
        if self.launches and self.launches.doing:
            return self.launches.doing
        job = self._worker.job
        return job.words if job else ""

    def comparison(self, name: str) -> Comparison | None:
        """A throw beside its predictions; None where there is none."""
        known = {throw.name for throw in self.state.throws if throw.is_drawn}
        return load_comparison(name, self._place(name)) if name in known else None

    def _place(self, name: str) -> Path:
        return self.watched.kept / "throws" / f"{name.removesuffix('.csv')}.npz"

    def step(self, *, traces: bool = True) -> None:
        """Takes what is new: throws, and answers from the background."""
        rests = self.watched.rests()
        if rests and self.watched.is_new:
            self.update()
        if self.launches:
            flies = self.launches.step(self.model_file, len(self.state.throws))
            self._worker.pause(flies)
            traces = traces and not flies
        if answer := self._worker.wait(0.0):
            self._take(answer)
        if traces and rests and self._worker.job is None and (job := self._next_job()):
            self._worker.start(job)
            self._progress(self.doing)
        self._prepare()

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

    def update(self) -> None:
        """Reads, checks and flies again whatever is new in the folder, now."""
        notes: list[str] = []
        try:
            notes += self.watched.read()
            throws, campaign = self._read(notes)
        except InputError as error:
            self._change(notes=(*notes, str(error)))
            return
        self._change(traces=_without_faults(self.state).traces)
        excluded = self.state.excluded
        if campaign is not None:
            try:
                inspection = inspect(campaign)
                notes += inspection.warnings
                excluded = inspection.excluded
            except InputError as error:
                notes.append(str(error))
        self._change(throws=tuple(throws), excluded=excluded, notes=tuple(notes))
        for k, throw in enumerate(throws):
            if campaign is not None and throw.is_read and not throw.is_drawn:
                throws[k] = self._drawn(throw, campaign)
                self._change(throws=tuple(throws))

    def finish(self) -> None:
        """Reads what is there and waits until it is traced."""
        self.update()
        while True:
            if self._worker.job is None:
                job = self._next_job(proposes=False)
                if job is None:
                    return
                self._worker.start(job)
                self._progress(self.doing)
            if answer := self._worker.wait(60.0):
                self._take(answer)

    def close(self) -> None:
        """Ends what runs in the background, and lets another have the folder."""
        if self.launches:
            self.launches.stop()
        self._worker.close()
        self._lock.close()

    def _read(self, notes: list[str]) -> tuple[list[Throw], Campaign | None]:
        """The throws that there are, and the campaign of those that can be read."""
        throws, folder = self.watched.throws(self.state.throws), self.watched.campaign
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
        answer, models = self.state.answer, self._models(campaign)
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
        """The models with what the flights have in common: once for each trace.

        One throw more changes that too little to make people wait for it.
        """
        if self._rollouts is None or self._rollouts[0] != self._basis:
            varies = CORRECTED in models
            found = rollout_models(campaign, models, varies=varies) if models else {}
            self._rollouts = self._basis, found
        return self._rollouts[1]

    @property
    def _basis(self) -> tuple[str, bytes]:
        """What the models come from: the last answer, and campaign.yaml."""
        answer = self.state.answer
        return answer.sha256 if answer else "", self.watched.settings.read_bytes()

    def _prepare(self) -> None:
        """Does what the next throw needs; flies one throw again by a first answer."""
        if not self.model_file or not self.watched.settings.is_file():
            return
        throws, campaign = list(self.state.throws), None
        late = [
            k
            for k, throw in enumerate(throws)
            if throw.is_drawn and CORRECTED not in throw.errors and not throw.is_fitted
        ]
        is_known = self._rollouts is not None and self._rollouts[0] == self._basis
        if late or not is_known:
            folder = self.watched.campaign
            try:
                campaign = load_campaign(folder, flights=self.state.flights)
            except InputError:  # It has changed since; `update` says how.
                return
            self._rollouts_of(campaign, self._models(campaign))
        if late and campaign:
            throws[late[-1]] = self._drawn(throws[late[-1]], campaign)
            self._change(throws=tuple(throws))

    def _next_job(self, *, proposes: bool = True) -> Job | MapJob | None:
        """What remains: a map to be checked, throws to be traced, then a proposal."""
        state = self.state
        asked, self.asked_map = self.asked_map, None
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
        if last is None or last.sha256 != digest or 0 < faults <= RETRIES:
            return trace
        if last.refusal or not proposes:
            return None
        path, limits, done = self.watched.path, self.watched.limits, state.proposal
        if done and (done.sha256, done.limits) == (digest, limits):
            return None
        return dataclasses.replace(trace, proposes=True, session=path, limits=limits)

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


def _without_faults(state: State) -> State:
    """The state without the traces that a fault ended: they are tried again."""
    traces = tuple(trace for trace in state.traces if not trace.is_fault)
    return dataclasses.replace(state, traces=traces)
