"""A roll that the log does not show, as another explanation of what flights lack.

A flight's bank grows evenly from one angle to another, to either side. It turns the
lift aside; the glider slips, loses angle of attack, and its fin turns it into the slip.
All of that is of second order in the bank, so that flights show its size and not its
side. Given the two angles, and what the fin does, the motion across the plane follows
from the measured one: flights are made ready as if their roll and yaw were logged.

The angles of a flight have a normal prior about zero whose spreads are fitted. Flights
roll if that gains most of what effects do that were found without roll, each flight's
two angles integrated out: all effects, or all but those that act beside the roll.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.logs import Campaign
from glider.physics.parameters import GliderParameters
from glider.sysid.constants import EVIDENCE_THRESHOLD
from glider.sysid.likelihood.filtering import negative_log_likelihood, whiten
from glider.sysid.likelihood.model_fit import error_flights, fit_model
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.replay.record import Noise, Record, prepare
from glider.sysid.search.moves import Search
from glider.sysid.search.tracing import SearchResult

_PROBES = 0.03, 0.1, 0.3  # Banks at the end to begin with [rad].
# Share of the gain of banks that these have (m: bench_roll).
_SHOWN = 0.1
# Mean gain of the likeliest bank of a flight that does not roll [nats] (d): none in
# half of them, as its square is not negative, and ½ χ² with one degree of freedom.
_BY_CHANCE = 0.25
# Share of what effects gain that banks gain in their place (m: bench_roll): at most
# 0.45 where an effect acts and nothing rolls, at least 0.85 where all flights roll.
_ENOUGH = 0.8
_BESIDE = 2  # Effects that may act beside a roll.
_FINS = 3.0, 0.0, 30.0  # Yaw acceleration over airspeed and slip that are tried [1/m].
_MOST = 0.9  # Bank that is no slight one any more [rad].
_LEAST = 0.01  # Spread of banks below which flights show none [rad].
_ROUNDS = 6  # Of banks, spreads and coefficients that depend on each other.
_STEPS = 6  # Of least squares in each.
_ACCURACY = 1e-4  # Share of a flight's squares below which its banks are found.
_DIVERGED = 1e6  # Standard deviations of a flight that diverges.
_TOLERANCE = 0.5  # Gain of a round below which banks are found [nats].
_LEAST_IN_PLANE = 0.05  # Share of the wing's normal, squared.


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Rolls:
    """A model of flights that roll."""

    fin: float  #: See _FINS.
    banks: np.ndarray  #: (F, 2) at the first and last node [rad].
    spreads: np.ndarray  #: (2,) RMS of them over flights [rad].
    model: FitResult
    cost: float  #: Negative log of the marginal posterior [nats].


@dataclasses.dataclass(frozen=True, kw_only=True)
class RollSearch:
    """Flights whose roll is not logged."""

    search: Search  #: For effects of a glider that does not roll, with its fits.
    campaign: Campaign  #: Its flights, which are the search's and others.
    noise: Noise
    masks: Mapping[str, Masks]

    def find(self, traced: SearchResult) -> SearchResult:
        """Returns what was found, and the bank at the end if flights roll.

        Of the effects that a search without roll found there are then only those that
        act beside it. They are tried by their evidence: none of them, the first, the
        first two, and all.
        """
        search = self.search
        model = search.fit(traced.model)
        order = sorted(model.kinds, key=traced.evidence.__getitem__, reverse=True)
        for count in sorted({*range(min(_BESIDE, len(order)) + 1), len(order)}):
            kept = search.fit(model.without(search.task, *order[count:]))
            gained = search.penalized_cost(kept) - search.penalized_cost(model)
            least = _ENOUGH * gained + EVIDENCE_THRESHOLD
            bank, gain = self.fit_beside(kept, least)
            if gain > least:
                return traced.reduced_to(kept, bank)
        return traced

    def fit_beside(self, model: FitResult, least: float) -> tuple[float, float]:
        """Fits banks beside a model's effects; returns that at the end, and the gain.

        The gain is that of the marginal likelihood [nats]; zero where even before the
        fit it is too small for `least`.
        """
        usual, *others = _FINS
        begun = [self._begun(model, usual)]
        by_chance = _BY_CHANCE * len(self.search.task.records)
        if begun[0][1] < _SHOWN * least + by_chance:
            return 0.0, 0.0
        begun += [self._begun(model, fin) for fin in others]
        likeliest, _ = max(begun, key=lambda own: own[1])
        rolls = self._fit(likeliest)
        gain = model.cost + model.freedom - rolls.cost - rolls.model.freedom
        return float(rolls.spreads[1]), gain

    @functools.cached_property
    def _usual(self) -> list[Task]:
        """Those of `_probed` of the usual fin, kept: they depend on no model."""
        return self._probed(_FINS[0])

    def _probed(self, fin: float) -> list[Task]:
        """The task on flights that all roll by one of _PROBES, for each of them."""
        task = self.search.task
        found = []
        for bank in _PROBES:
            banks = np.tile([0.0, bank], (len(task.records), 1))
            found.append(task.on(self._rolled(task.records, banks, fin)))

        return found

    def _begun(self, model: FitResult, fin: float) -> tuple[_Rolls, float]:
        """Flights that roll by the likeliest of some banks, and what that gains."""
        tasks = self._usual if fin == _FINS[0] else self._probed(fin)
        costs = [
            negative_log_likelihood(error_flights(own, model), model.scales)
            for own in (self.search.task, *tasks)
        ]
        last = np.array(_PROBES)[np.argmin(costs[1:], axis=0)]
        spread = np.sqrt(np.mean(last**2))
        rolls = _Rolls(
            fin=fin,
            banks=np.column_stack([0.1 * last, last]),
            spreads=spread * np.array([0.5, 1.0]),
            model=model,
            cost=np.inf,
        )
        return rolls, float(np.sum(costs[0] - np.min(costs, axis=0)))

    def _fit(self, best: _Rolls) -> _Rolls:
        """Fits banks, their spreads, and the model's coefficients and scales."""
        task = self.search.task
        for _ in range(_ROUNDS):
            banks, curvature = self._best_banks(best)
            covariance = np.linalg.inv(curvature + np.diag(best.spreads**-2.0))
            squares = banks**2 + np.diagonal(covariance, axis1=1, axis2=2)
            spreads = np.maximum(np.sqrt(np.mean(squares, axis=0)), _LEAST)
            rolled = task.on(self._rolled(task.records, banks, best.fin))
            model = fit_model(rolled, best.model, with_strength=True)
            # Laplace's approximation of the integral over the banks.
            relative = spreads[:, None] * curvature * spreads + np.eye(2)
            volume = 0.5 * float(np.linalg.slogdet(relative)[1].sum())
            cost = model.cost + volume + 0.5 * float(np.sum((banks / spreads) ** 2))
            if not cost < best.cost - _TOLERANCE:
                break
            best = dataclasses.replace(
                best, banks=banks, spreads=spreads, model=model, cost=cost
            )

        return best

    def _best_banks(self, rolls: _Rolls) -> tuple[np.ndarray, np.ndarray]:
        """Likeliest banks (F, 2), and the curvature of the flights' cost (F, 2, 2).

        Each flight's are found alone, by least squares.
        """
        banks = []
        curvatures = []
        for record, start in zip(self.search.task.records, rolls.banks, strict=True):
            found = least_squares(
                self._errors,
                start,
                args=(rolls, record),
                bounds=(-_MOST, _MOST),
                ftol=_ACCURACY,
                max_nfev=_STEPS,
            )
            by_bank = found.jac[:-2]
            banks.append(found.x)
            curvatures.append(by_bank.T @ by_bank)

        return np.array(banks), np.array(curvatures)

    def _errors(self, banks: np.ndarray, rolls: _Rolls, record: Record) -> np.ndarray:
        """Errors of a flight of such banks (2,), and last these, in deviations."""
        rolled = self._rolled([record], banks[None], rolls.fin)
        [flight] = error_flights(self.search.task.on(rolled), rolls.model)
        errors = whiten(flight, rolls.model.scales).innovations.ravel()
        errors = np.nan_to_num(errors, nan=_DIVERGED)
        errors = np.clip(errors, -_DIVERGED, _DIVERGED)
        return np.append(errors, banks / rolls.spreads)

    def _rolled(
        self, records: Sequence[Record], banks: np.ndarray, fin: float
    ) -> list[Record]:
        """Flights as if their roll and yaw were logged."""
        nominal = vars(GliderParameters()) | self.campaign.vehicle
        attitudes = attitudes_of(records, banks, fin, nominal)
        logged = {flight.name: flight for flight in self.campaign.flights}
        flights = []
        for record, own in zip(records, attitudes, strict=True):
            flight = logged[record.name]
            begin = flight.time[np.argmax(masks_of(flight, self.masks).usable)]
            at = flight.time - begin
            attitude = np.column_stack([np.interp(at, record.time, c) for c in own.T])
            flights.append(dataclasses.replace(flight, attitude=attitude))

        space = self.search.task.space
        turned = prepare(flights, self.campaign, self.noise, space, self.masks)
        pairs = zip(turned, records, strict=True)
        return [dataclasses.replace(new, place=old.place) for new, old in pairs]


def attitudes_of(
    records: Sequence[Record], banks: np.ndarray, fin: float, vehicle: Mapping[str, Any]
) -> list[np.ndarray]:
    """Computes y [m], roll and yaw [rad] at the nodes (n, 3) of flights that roll.

    Args:
        records: the flights, F of them; their motion in the plane is the measured one.
        banks: (F, 2) of the wing to the horizon at the first and last node [rad].
        fin: yaw acceleration over airspeed and slip [1/m].
        vehicle: the glider's parameters by name.
    """
    found = []
    for record, ends in zip(records, banks, strict=True):
        time = record.time
        bank = np.interp(time, time[[0, -1]], ends)
        sin = np.sin(bank)
        cos = np.cos(bank)
        # The pitch in the glider's own plane is another.
        sin_pitch = np.clip(np.sin(record.nodes[:, 2]) / cos, -1.0, 1.0)
        cos_pitch = np.sqrt(1.0 - sin_pitch**2)
        normal = np.column_stack([sin_pitch, -cos_pitch * sin, cos_pitch * cos])
        left = np.column_stack([0.0 * cos, cos, sin])
        aside, yaw = _fly_aside(record, normal, left, fin, vehicle)
        y = cumulative_trapezoid(aside, time, initial=0.0)
        roll = np.arctan2(sin, cos_pitch * cos)
        yaw = yaw + np.arctan2(sin_pitch * sin, cos_pitch)
        found.append(np.column_stack([y, roll, yaw]))

    return found


def _fly_aside(
    record: Record,
    normal: np.ndarray,
    left: np.ndarray,
    fin: float,
    vehicle: Mapping[str, Any],
) -> tuple[np.ndarray, np.ndarray]:
    """Computes the velocity in y [m/s], and the yaw [rad], at a flight's nodes (n,).

    Args:
        record: the flight, whose motion in x and z is the measured one.
        normal: (n, 3) of the wing in x, y and z, before the yaw.
        left: (n, 3) axis of the wing, before the yaw.
        fin: yaw acceleration over airspeed and slip [1/m].
        vehicle: the glider's parameters by name.
    """
    arm = vehicle["hinge_offset"] + vehicle["elevator_offset"]
    push_per_turn = vehicle["pitch_inertia"] / (arm * vehicle["mass"])
    velocity = np.insert(record.nodes[:, 4:6], 1, 0.0, axis=1)
    force = np.insert(record.acceleration[:, :2], 1, 0.0, axis=1)  # Per mass.
    force[:, 2] += vehicle["gravity"]
    yaw = np.zeros(len(normal))
    rate = np.zeros(len(normal))
    turn = np.eye(3)
    for k, step in enumerate(np.diff(record.time)):
        sin = np.sin(yaw[k])
        cos = np.cos(yaw[k])
        turn[0, :2] = cos, -sin
        turn[1, :2] = sin, cos
        up = turn @ normal[k]
        wing = turn @ left[k]
        # Of the lift this share shows in the plane of x and z.
        share = max(up[0] ** 2 + up[2] ** 2, _LEAST_IN_PLANE)
        lift = force[k] @ up / share
        slip = velocity[k] @ wing
        speed = np.linalg.norm(velocity[k])
        weathervane = fin * speed * (slip - arm * rate[k])
        push = lift * up[1] - push_per_turn * weathervane * wing[1]
        velocity[k + 1, 1] = velocity[k, 1] + step * push
        rate[k + 1] = rate[k] + step * weathervane
        yaw[k + 1] = yaw[k] + step * rate[k + 1]

    return velocity[:, 1], yaw
