"""A roll that the log does not show, as another explanation of what flights lack.

A flight's bank grows evenly from one angle to another, to either side. It turns the
lift aside; the glider slips, loses angle of attack, and its fin turns it into the slip.
All of that is of second order in the bank, so that flights show its size and not its
side. Given the two angles, and what the fin does, the motion across the plane follows
from the measured one: flights are made ready as if their roll and yaw were logged.

The angles of a flight have a normal prior about zero whose spreads are fitted, and are
integrated out by Laplace's approximation. Flights roll if that gains most of what the
effects do that were found without roll: all of them, or all but those that act beside
the roll.

`RollSearch.find` asks so for each set of effects beside the roll; `fit_beside` begins
with a few banks and fins and fits all flights' banks by the errors of flights that
`attitudes_of` has turned.
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
_FINS = 3.0, 0.0, 30.0  # Yaw acceleration over airspeed and slip that are tried [1/m²].
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
    """A model of flights that roll.

    Attributes:
        fin: yaw acceleration over airspeed and slip [1/m²].
        banks: (F, 2) at the first and last node of each flight [rad].
        spreads: (2,) standard deviations of the banks' prior [rad].
        model: the fit beside the roll.
        cost: negative log of the posterior, banks integrated out [nats].
    """

    fin: float
    banks: np.ndarray
    spreads: np.ndarray
    model: FitResult
    cost: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class RollSearch:
    """Flights whose roll is not logged.

    Attributes:
        search: for effects of a glider that does not roll, with its fits.
        campaign: its flights are those of the search and others.
        noise: of the sensors.
        masks: rows that are excluded, by the flights' names.
    """

    search: Search
    campaign: Campaign
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
        for count in range(len(order) + 1):
            if _BESIDE < count < len(order):
                continue
            kept = search.fit(model.without(search.task, *order[count:]))
            gain_of_others = search.penalized_cost(kept) - search.penalized_cost(model)
            least = _ENOUGH * gain_of_others + EVIDENCE_THRESHOLD
            bank, gain = self.fit_beside(kept, least)
            if gain > least:
                return traced.reduced_to(kept, bank)
        return traced

    def fit_beside(self, model: FitResult, least: float) -> tuple[float, float]:
        """Fits banks beside a model's effects.

        Args:
            model: fitted without roll.
            least: gain below which the result is of no use [nats].

        Returns:
            The spread of the bank at the end [rad], and the gain of the marginal
            likelihood [nats]. Both are zero where even before the fit the likeliest of
            some banks gain too little for `least`.
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
        """The tasks of `_probed` with the usual fin, kept: they depend on no model."""
        return self._probed(_FINS[0])

    def _probed(self, fin: float) -> list[Task]:
        """Returns, for each of _PROBES, the task on flights that all roll by it."""
        task = self.search.task
        found = []
        for bank in _PROBES:
            banks = np.tile([0.0, bank], (len(task.records), 1))
            found.append(task.on(self._rolled(task.records, banks, fin)))

        return found

    def _begun(self, model: FitResult, fin: float) -> tuple[_Rolls, float]:
        """Returns flights that roll by the likeliest of _PROBES, and what that gains.

        The gain is that of the likelihood over level flight [nats].
        """
        tasks = self._usual if fin == _FINS[0] else self._probed(fin)
        costs = [
            negative_log_likelihood(error_flights(task, model), model.scales)
            for task in (self.search.task, *tasks)
        ]
        level, *banked = costs
        gain = level - np.min(costs, axis=0)

        last = np.array(_PROBES)[np.argmin(banked, axis=0)]
        rms = np.sqrt(np.mean(last**2))
        rolls = _Rolls(
            fin=fin,
            banks=np.column_stack([0.1 * last, last]),
            spreads=rms * np.array([0.5, 1.0]),
            model=model,
            cost=np.inf,
        )
        return rolls, float(gain.sum())

    def _fit(self, best: _Rolls) -> _Rolls:
        """Fits banks, their spreads, and the model's coefficients and scales.

        In turn, until a round gains little. With C the curvature of a flight's cost in
        its banks b, and S their spreads, the integral over them adds

            ½ log |S C S + I| + ½ |S⁻¹ b|²

        to its cost (Laplace).
        """
        task = self.search.task
        for _ in range(_ROUNDS):
            banks, curvature = self._best_banks(best)
            # Spreads by the second moments of the banks' posterior.
            covariance = np.linalg.inv(curvature + np.diag(best.spreads**-2.0))
            squares = banks**2 + np.diagonal(covariance, axis1=1, axis2=2)
            spreads = np.maximum(np.sqrt(squares.mean(axis=0)), _LEAST)

            rolled = task.on(self._rolled(task.records, banks, best.fin))
            model = fit_model(rolled, best.model, with_strength=True)

            relative = spreads[:, None] * curvature * spreads + np.eye(2)
            _, log_volumes = np.linalg.slogdet(relative)
            squares = (banks / spreads) ** 2
            cost = model.cost + 0.5 * log_volumes.sum() + 0.5 * squares.sum()
            if not cost < best.cost - _TOLERANCE:
                break
            best = dataclasses.replace(
                best, banks=banks, spreads=spreads, model=model, cost=cost
            )

        return best

    def _best_banks(self, rolls: _Rolls) -> tuple[np.ndarray, np.ndarray]:
        """Returns the likeliest banks (F, 2), and curvatures (F, 2, 2) of the costs.

        Each flight's are found alone, by least squares; the curvatures are without the
        prior.
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
        """Returns the errors of a flight that rolls by banks (2,), and last these.

        Both are over their standard deviations: the errors are whitened innovations.
        """
        rolled = self._rolled([record], banks[None], rolls.fin)
        task = self.search.task.on(rolled)
        [flight] = error_flights(task, rolls.model)
        innovations = whiten(flight, rolls.model.scales).innovations
        errors = np.nan_to_num(innovations.ravel(), nan=_DIVERGED)
        errors = np.clip(errors, -_DIVERGED, _DIVERGED)
        return np.append(errors, banks / rolls.spreads)

    def _rolled(
        self, records: Sequence[Record], banks: np.ndarray, fin: float
    ) -> list[Record]:
        """Returns flights as if their roll and yaw were logged.

        Their logs, with the attitude that follows from banks (F, 2) [rad] and a fin
        [1/m²], are prepared again; in the session they stay where they were.
        """
        nominal = vars(GliderParameters()) | self.campaign.vehicle
        attitudes = attitudes_of(records, banks, fin, nominal)
        logged = {flight.name: flight for flight in self.campaign.flights}
        flights = []
        for record, own in zip(records, attitudes, strict=True):
            flight = logged[record.name]
            # Nodes count time from the first row that counts.
            first = masks_of(flight, self.masks).usable.argmax()
            since = flight.time - flight.time[first]
            columns = [np.interp(since, record.time, column) for column in own.T]
            attitude = np.column_stack(columns)
            flights.append(dataclasses.replace(flight, attitude=attitude))

        space = self.search.task.space
        turned = prepare(flights, self.campaign, self.noise, space, self.masks)
        pairs = zip(turned, records, strict=True)
        return [dataclasses.replace(new, place=old.place) for new, old in pairs]


def attitudes_of(
    records: Sequence[Record], banks: np.ndarray, fin: float, vehicle: Mapping[str, Any]
) -> list[np.ndarray]:
    """Computes the attitudes of flights that roll, from their motion in the plane.

    In the glider's own plane, banked by φ, the pitch is θ' with sin θ' cos φ = sin θ,
    where θ is the measured one. A wing turned by φ and θ' has a yaw too, to which that
    of the motion across the plane is added.

    Args:
        records: the flights, F of them; their motion in the plane is the measured one.
        banks: (F, 2) of the wing to the horizon at the first and last node [rad].
        fin: yaw acceleration over airspeed and slip [1/m²].
        vehicle: the glider's parameters by name.

    Returns:
        Of each flight y [m], roll and yaw [rad] at the nodes, (n, 3).
    """
    found = []
    for record, ends in zip(records, banks, strict=True):
        time = record.time
        bank = np.interp(time, time[[0, -1]], ends)
        sin = np.sin(bank)
        cos = np.cos(bank)
        sin_pitch = np.clip(np.sin(record.nodes[:, 2]) / cos, -1.0, 1.0)
        cos_pitch = np.sqrt(1.0 - sin_pitch**2)

        normal = np.column_stack([sin_pitch, -cos_pitch * sin, cos_pitch * cos])
        left = np.column_stack([0.0 * cos, cos, sin])
        y_rate, yaw = _fly_aside(record, normal, left, fin, vehicle)

        y = cumulative_trapezoid(y_rate, time, initial=0.0)
        roll = np.arctan2(sin, cos_pitch * cos)
        yaw += np.arctan2(sin_pitch * sin, cos_pitch)
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

    The measured force in the plane shows the lift, along the wing's normal, of which a
    part pushes aside. The fin turns the glider into the slip, and pushes it too:

        yaw'' = fin speed (slip - arm yaw'),   y'' = lift n_y - I / (m arm) yaw'' w_y,

    with n the normal and w the axis of the wing, by steps from node to node.

    Args:
        record: the flight, whose motion in x and z is the measured one.
        normal: (n, 3) of the wing in x, y and z, before the yaw.
        left: (n, 3) axis of the wing, before the yaw.
        fin: yaw acceleration over airspeed and slip [1/m²].
        vehicle: the glider's parameters by name.
    """
    arm = vehicle["hinge_offset"] + vehicle["elevator_offset"]
    push_per_turn = vehicle["pitch_inertia"] / (arm * vehicle["mass"])
    velocity = np.insert(record.nodes[:, 4:6], 1, 0.0, axis=1)
    # All but gravity, over the mass [m/s²].
    force = np.insert(record.acceleration[:, :2], 1, 0.0, axis=1)
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
