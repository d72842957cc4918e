"""Proposes the next throws: those that distinguish rival explanations, then parameters.

`glider.experiments.throw_search` finds them; here is what to expect of them.
"""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.masks import Masks
from glider.campaign.checks.servo_fit import identify_servo
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from glider.campaign.turning import signs_of
from glider.errors import InputError, expect
from glider.experiments.explanations import Explanation, Findings, explain
from glider.experiments.forecast import Forecast, added
from glider.experiments.throw_limits import ThrowLimits
from glider.experiments.throw_search import end_scatter, search
from glider.experiments.throws import Range, Throw, departures_of, range_of
from glider.physics.model import GliderModel
from glider.progress import Progress, Step, silent
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.replay.log_space import log_space
from glider.sysid.replay.record import Noise, measure_noise, prepare
from glider.sysid.replay.vehicle import make_vehicle

_LIKE_FLOWN = 12
"""Flown flights whose ends represent those of flights to come."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Proposal:
    """Throws to fly next, and what is expected of them."""

    campaign: str  #: Its name.
    #: Compatible with the flights, the most probable first.
    explanations: tuple[Explanation, ...]
    throws: tuple[Throw, ...]  #: Proposed, the most informative first.
    #: Of each throw, (explanations, n, 3) predicted poses.
    paths: tuple[np.ndarray, ...]
    #: Of each throw, how far it is beyond what the model was traced on; or empty.
    beyond: tuple[str, ...]
    flown: tuple[np.ndarray, ...]  #: Poses (n, 3) of the flights so far.
    place: Range  #: Where they are flown.
    #: Probability that the most probable explanation is the right one.
    chance_now: float
    chance_then: float  #: After the throws.
    #: (e, e) expected log-evidence of the throws against each explanation (column),
    #: where another (row) is true [nats].
    distances: np.ndarray
    #: Scatter of the ends of flights like those flown by chance: moving air,
    #: flight-to-flight variation and moments that no formula has [m].
    ending_air: float
    ending_now: float  #: The same by the standard errors of the coefficients [m].
    ending_then: float  #: The same after the throws.
    seconds: float  #: That it took, once the explanations were fitted.

    @property
    def noise(self) -> float:
        """Standard deviation of a measured coordinate [m]."""
        return self.explanations[0].model.scales.position

    @property
    def is_still(self) -> bool:
        """Whether the flights show no moving air."""
        return self.explanations[0].model.scales.is_still

    @property
    def missing(self) -> float:
        """Probability that none of the explanations is the right one."""
        return 1.0 - sum(e.probability for e in self.explanations)


def next_throw(
    campaign: Path | str | Campaign,
    findings: Findings,
    *,
    launches: int = 3,
    limits: ThrowLimits | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> Proposal:
    """Proposes throws after an analysis of a campaign.

    Args:
        campaign: the folder that was analysed, or the campaign in memory.
        findings: of the analysis, see `findings_of` and `load_findings`.
        launches: how many throws to propose.
        limits: of the throws; what they leave open is as flown.
        seed: of the search.
        progress: called with a line of text as the work goes on.

    Raises:
        InputError: there is no servo to command, an argument cannot be used, or no
            throw keeps within the limits.
    """
    expect(launches >= 1, "the number of launches", launches, "at least 1")
    if not isinstance(campaign, Campaign):
        campaign = load_campaign(Path(campaign), flights=findings.flights)
    with threadpool_limits(limits=1, user_api="blas"):  # We thread over flights.
        progress(Step("reading the flights", 0.0))
        found = campaign.elevator
        what = f"{campaign.path}: its elevator"
        expect(found == "servo", what, found, "a servo that can be commanded")
        reading = read_task(campaign, findings)
        progress("fitting the explanations")
        explanations = explain(reading.task, reading.noise, findings)
        return propose(
            reading.campaign,
            reading.task,
            reading.noise,
            explanations,
            traced=findings.models[0],
            launches=launches,
            limits=limits,
            seed=seed,
            progress=progress,
        )


class Reading(NamedTuple):
    """A campaign that was read again after an analysis."""

    campaign: Campaign  #: Its flights that were analysed, and the servo they show.
    masks: Mapping[str, Masks]  #: Of its flights.
    task: Task  #: On these flights.
    noise: Noise


def read_task(campaign: Campaign, findings: Findings) -> Reading:
    """Reads a campaign again after an analysis: its flights, with the servo they show.

    Raises:
        InputError: its flights cannot be predicted.
    """
    if not signs_of(findings.models[0]).are_right:
        raise InputError(
            f"{campaign.path}: an angle is logged with the wrong sign (angle_sign); "
            "expected logs with the right signs before commands are sent."
        )
    what = f"{campaign.path}: the report's campaign"
    known_name = findings.campaign
    expect(known_name in (None, campaign.name), what, known_name, f"'{campaign.name}'")
    names = {flight.name for flight in campaign.flights}
    campaign = campaign.only(names.difference(findings.excluded))
    inspection = inspect(campaign)
    campaign, *_ = identify_servo(inspection.campaign, inspection.masks)
    vehicle = make_vehicle(campaign, log_space(findings.own))
    if not vehicle.knows_forces:
        raise InputError(
            f"{campaign.path}: mass, wing_area or elevator_area is missing; expected "
            "all three to predict a throw."
        )
    noise = measure_noise(campaign, inspection.masks)
    records = prepare(
        campaign.flights, campaign, noise, vehicle.space, inspection.masks
    )
    task = make_task(records, vehicle, vehicle.kinds)
    return Reading(campaign, inspection.masks, task, noise)


def propose(
    campaign: Campaign,
    task: Task,
    noise: Noise,
    explanations: Sequence[Explanation],
    *,
    traced: GliderModel,
    launches: int = 3,
    limits: ThrowLimits | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> Proposal:
    """Proposes throws, given the explanations of a campaign; see `next_throw`.

    `traced` is the corrected model, which has the range that was flown.
    """
    begin = time.perf_counter()
    forecast = Forecast(
        campaign=campaign,
        task=task,
        noise=noise,
        explanations=tuple(explanations),
        place=range_of(campaign, task.records, limits),
    )
    likely = task.thinned(_LIKE_FLOWN)
    scatter = end_scatter(likely, explanations[0])
    rng = np.random.default_rng(seed)
    found = search(forecast, scatter, launches, rng, progress)
    then = added([own.grams for own in found])
    futures = forecast.futures(then)
    return Proposal(
        campaign=campaign.name,
        explanations=forecast.explanations,
        throws=tuple(own.throw for own in found),
        paths=tuple(own.paths for own in found),
        beyond=tuple(departures_of(traced, own.throw, forecast.place) for own in found),
        flown=tuple(record.pose for record in task.records),
        place=forecast.place,
        chance_now=float(forecast.probabilities.max()),
        chance_then=forecast.chance(futures),
        distances=forecast.distances(futures),
        ending_air=scatter.air,
        ending_now=scatter.by_parameters(forecast.covariance()),
        ending_then=scatter.by_parameters(forecast.covariance(then)),
        seconds=time.perf_counter() - begin,
    )
