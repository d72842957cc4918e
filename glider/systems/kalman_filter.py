"""The extended Kalman filter as a Drake System."""

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from glider.estimation.ekf import Ekf
from glider.estimation.running import Belief, check_belief, predict_mean, run_ekf
from glider.physics.model import GliderModel

_SAME = 1e-6
"""Share of a period within which two times are the same, for rounding of the clock."""


class ExtendedKalmanFilter(LeafSystem):
    """Estimates a glider's state, and slow states, from samples of its sensors.

    At each sample, k periods after time 0, the belief is predicted with the mean of
    the elevator's rate since the last sample, and corrected. When a simulation begins,
    at whatever time, it is the prior. An output that is read at the time of a sample,
    as by a hold of the same clock, is the one before it.

    Input ports:
        measured (M): at the samples, in the order of `ekf.measured_names` [m, rad].
        elevator_rate (1): assumed rate of the servo [rad/s].
        known (K): the filter's further known inputs, if it has any, as they are at the
            samples and at the beginning; left open, they are what the filter's model
            has, which is zero for the wind.

    Output ports:
        state (n): predicted by the model from the last sample until now.
        estimate (N): x̄ at the last sample.
        covariance (N * N): of the estimate.
        innovation (M): measured minus predicted at the last sample.
        innovation_covariance (M * M): S; zero before the first sample.

    Args:
        ekf: the filter.
        prior: belief when a simulation begins.
    """

    def __init__(self, ekf: Ekf, prior: Belief):
        """Raises InputError where the prior is another filter's."""
        LeafSystem.__init__(self)
        self.set_name("estimator")
        rows = len(ekf.noise)
        known = len(ekf.known)
        check_belief(ekf, prior, "ExtendedKalmanFilter")
        self.ekf = ekf
        self._measured = self.DeclareVectorInputPort("measured", rows)
        self._rate = self.DeclareVectorInputPort("elevator_rate", 1)
        if known:
            self._known = self.DeclareVectorInputPort("known", known)
        # The elevator's rate, integrated; its differences are the means.
        self.DeclareContinuousState(1)
        outputs = {
            "estimate": prior.mean,
            "covariance": prior.covariance.ravel(),
            "innovation": np.zeros(rows),
            "innovation_covariance": np.zeros(rows * rows),
        }
        # Time of the last sample, and the integral then; NaN before the beginning.
        memory = {"since": np.array([np.nan, 0.0]), "known": self._model_known()}
        self._parts = {
            name: self.DeclareDiscreteState(value)
            for name, value in (outputs | memory).items()
        }
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(ekf.period, 0.0, self._sample)
        self.DeclareVectorOutputPort(
            "state",
            ekf.num_states,
            self._calc_state,
            {self.time_ticket(), self.xc_ticket(), self.xd_ticket()},
        )
        for name in outputs:
            self.DeclareStateOutputPort(name, self._parts[name])

    @property
    def model(self) -> GliderModel:
        """The glider that the filter predicts with."""
        return self.ekf.model

    @property
    def measured_std(self) -> np.ndarray:
        """Standard deviations (M,) of the samples that it assumes [m, rad]."""
        return np.sqrt(np.diag(self.ekf.noise))

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.get_mutable_vector().SetFromVector(self._rate.Eval(context))

    def _part(self, context, name):
        return context.get_discrete_state(self._parts[name]).CopyToVector()

    def _inputs(self, context, known):
        """Returns the filter's inputs since the last sample, and that time span."""
        time, integral = self._part(context, "since")
        span = context.get_time() - time
        gone = context.get_continuous_state_vector().GetAtIndex(0) - integral
        return np.append(gone / span if span > 0.0 else 0.0, known), span

    def _eval_known(self, context):
        if self.ekf.known and self._known.HasValue(context):
            return self._known.Eval(context)
        return self._model_known()

    def _model_known(self):
        return self.ekf.z[self.ekf.estimated.entry[1:]]

    def _calc_state(self, context, output):
        mean = self._part(context, "estimate")
        inputs, span = self._inputs(context, self._part(context, "known"))
        if span > 0.0:
            start = context.get_time() - span
            mean, _ = predict_mean(self.ekf, mean, inputs, span, start)
        output.SetFromVector(mean[: self.ekf.num_states])

    def _begin(self, context, discrete_state):
        if math.isnan(self._part(context, "since")[0]):  # Else a flight goes on.
            discrete_state.set_value(self._parts["known"], self._eval_known(context))
            self._set_since(context, discrete_state)

    def _set_since(self, context, discrete_state):
        now = context.get_continuous_state_vector().GetAtIndex(0)
        since = [context.get_time(), now]
        discrete_state.set_value(self._parts["since"], since)

    def _sample(self, context, discrete_state):
        known = self._eval_known(context)
        size = len(self.ekf.names)
        discrete_state.set_value(self._parts["known"], known)
        inputs, span = self._inputs(context, known)
        # The clock ticks at the beginning as that of motion capture's log does:
        # starting later, its ticks would differ from the log's by a rounding.
        if span < _SAME * self.ekf.period:
            return
        before = Belief(
            mean=self._part(context, "estimate"),
            covariance=self._part(context, "covariance").reshape(size, size),
        )
        found = run_ekf(
            self.ekf,
            before,
            inputs[None, None],
            self._measured.Eval(context)[None, None],
            context.get_time() - span,
            period=span,
        )
        parts = {
            "estimate": found.means[0, 1],
            "covariance": found.covariances[0, 1].ravel(),
            "innovation": found.innovations[0, 0],
            "innovation_covariance": found.innovation_covariances[0, 0].ravel(),
        }
        for name, value in parts.items():
            discrete_state.set_value(self._parts[name], value)
        self._set_since(context, discrete_state)
