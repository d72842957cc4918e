"""Measurement noise as a Drake System: for feedback and for motion capture."""

import math

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from glider.errors import expect
from glider.systems.template import float_class


@TemplateSystem.define("SampledNoise_", T_list=[float, AutoDiffXd])
def SampledNoise_(T):
    class Impl(LeafSystem_[T]):
        """Adds one row of a noise tape to each sample of a signal.

        A hold or a periodic log behind it samples at the times k / rate. The noise
        changes halfway between these, so that the order of simultaneous events does
        not matter, and is constant between events, as integrators require. After the
        tape's end its last row stays.

        Input ports:
            signal (n): anything, such as a state or a pose with the elevator.

        Output ports:
            measured (n): signal + tape[k].

        Numeric parameter 0 holds the tape (rows * size,), zero by default; each
        flight sets its own (`set_tape`).

        Args:
            size: of the signal, n.
            rate: of the samples [Hz].
            rows: length of the tape.
        """

        def _construct(self, size=1, rate=1.0, rows=1, converter=None):
            LeafSystem_[T].__init__(self, converter)
            good = math.isfinite(rate) and rate > 0.0
            expect(good, "SampledNoise: 'rate'", rate, "a positive number of Hz")
            expect(rows >= 1, "SampledNoise: 'rows'", rows, "at least 1")
            self.size = size
            self.rate = float(rate)
            self.rows = rows
            self._signal = self.DeclareVectorInputPort("signal", size)
            self.DeclareNumericParameter(BasicVector_[T](np.zeros(rows * size)))
            self.DeclareDiscreteState(1)
            period = 1.0 / self.rate
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.5 * period, self._next)
            self.DeclareVectorOutputPort("measured", size, self._calc_measured)

        def _construct_copy(self, other, converter=None):
            Impl._construct(
                self, other.size, other.rate, other.rows, converter=converter
            )

        def set_tape(self, context, tape):
            """Sets the noise of a flight, (rows or fewer, size); zero beyond."""
            tape = np.asarray(tape, dtype=float)
            good = tape.shape[1:] == (self.size,) and len(tape) <= self.rows
            needed = f"at most ({self.rows}, {self.size})"
            expect(good, f"{self.get_name()}: the noise's shape", tape.shape, needed)
            full = np.zeros((self.rows, self.size))
            full[: len(tape)] = tape
            context.get_mutable_numeric_parameter(0).SetFromVector(full.ravel())

        def _next(self, context, discrete_state):
            now = context.get_discrete_state_vector().CopyToVector()
            discrete_state.set_value(now + 1.0)

        def _calc_measured(self, context, output):
            index = context.get_discrete_state_vector().CopyToVector()[0]
            index = index.value() if T is AutoDiffXd else index
            first = min(round(index), self.rows - 1) * self.size
            tape = context.get_numeric_parameter(0).CopyToVector()
            noise = tape[first : first + self.size]
            output.SetFromVector(self._signal.Eval(context) + noise)

    return Impl


SampledNoise = float_class(SampledNoise_)
