"""The glider as a Drake System: a shell of ports and context round the dynamics."""

from functools import partial

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector_, LeafSystem_, ValueProducer
from pydrake.systems.scalar_conversion import TemplateSystem

from glider.compiled.jacobian import differentiate
from glider.compiled.kernel import UncompilableError
from glider.physics.chain import NUM_INPUTS, theta_of
from glider.physics.model import GliderModel, as_model
from glider.physics.state import POSE_NAMES
from glider.systems.template import float_class

_FORCE_NAMES = ("wing", "elevator", "force_x", "force_z", "moment")
"""Force of each plate along its normal [N], total force without weight in the
world [N], total moment about +y and the center of mass [N m]."""


@TemplateSystem.define("GliderPlant_")
def GliderPlant_(T):
    class Impl(LeafSystem_[T]):
        """A planar glider with its effects, for float, AutoDiffXd and Expression.

        It turns its elevator at any rate, past any stop: the limits of rate and travel
        are those of an `ElevatorServo`, a separate system in front of it.

        Input ports:
            elevator_rate (1): rate of the elevator [rad/s].
            wind (2): velocity of the air, world (x, z) [m/s]; may be left open.

        Output ports:
            state (n): x, z [m], pitch, elevator [rad] and their rates, without the
                elevator's [m/s, rad/s]; then the effects' own states (`state_names`).
            forces (5): force of wing and elevator along their normals, total force
                without weight in the world (x, z) [N], total moment about +y and the
                center of mass [N m].
            pose (3): x, z [m] and pitch [rad] as the sensors show them.

        Numeric parameter 0 holds all numbers of the glider in the order of the names
        of `model.space`, so that a caller can change them or differentiate by them.

        Args:
            model: the glider, or the path of its file; the default is that of
                GliderParameters.
            fast: whether the AutoDiffXd twin takes value and Jacobian from compiled
                code, in about a quarter of the time; the first call compiles. Where a
                formula does not compile, it takes the plain way.
        """

        def _construct(self, model=None, fast=True, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self.set_name("glider")
            self.model = GliderModel() if model is None else as_model(model)
            self.fast = fast
            self.state_names = self.model.state_names
            self._gaussians = self.model.gaussians
            self._chain = self.model.chain

            _declare(self, BasicVector_[T])

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, other.model, other.fast, converter=converter)

        def DoCalcTimeDerivatives(self, context, derivatives):
            rates = _fast_rates(self, context) if self._is_fast(context) else None
            if rates is None:
                rates = self._chain.derivatives(*self._arguments(context))
            vector = derivatives.get_mutable_vector()
            for i, rate in enumerate(rates):  # Faster than an array of scalars.
                vector.SetAtIndex(i, rate)

        def _arguments(self, context):
            """Returns t, x, u, wind_x, wind_z, theta of a context."""
            wind_x, wind_z = self._eval_wind(context)
            return (
                context.get_time(),
                context.get_continuous_state_vector().CopyToVector(),
                self._elevator_rate.Eval(context)[0],
                wind_x,
                wind_z,
                self._theta(context),
            )

        def _eval_wind(self, context):
            has_wind = self._wind.HasValue(context)
            return self._wind.Eval(context) if has_wind else (0.0, 0.0)

        def _theta(self, context):
            numbers = context.get_numeric_parameter(0).CopyToVector()
            return theta_of(numbers, self._gaussians)

        def _calc_forces(self, context, output):
            t, x, u, wind_x, wind_z, theta = self._arguments(context)
            chain = self._chain
            c = theta.c
            rate = chain.actuator_terms(u, x, c)
            flow, terms = chain.meet_air(t, x, rate, wind_x, wind_z, theta)
            output.SetFromVector(np.array(chain.wrench(flow, terms, x, c)[:5]))

        def _calc_pose(self, context, output):
            x = context.get_continuous_state_vector().CopyToVector()
            pose = self._chain.measure(x, self._theta(context))
            output.SetFromVector(np.array(pose))

        def _is_fast(self, context):
            if T is not AutoDiffXd or not self.fast:
                return False
            # Derivatives by time are rare; the plain way has them.
            return not (
                self.model.free_functions and context.get_time().derivatives().size
            )

    return Impl


GliderPlant = float_class(GliderPlant_)


def _joined(gradient, rows, below):
    """Returns gradient, filled up to so many rows, with another below it."""
    columns = max(gradient.shape[1], below.shape[1])
    joined = np.zeros((rows + len(below), columns), order="F")
    joined[: len(gradient), : gradient.shape[1]] = gradient
    joined[rows:, : below.shape[1]] = below
    return joined


def _declare(plant, vector):
    """Declares ports, state, parameters and cache entry of a plant."""
    plant._elevator_rate = plant.DeclareVectorInputPort("elevator_rate", 1)
    plant._wind = plant.DeclareVectorInputPort("wind", 2)
    state = plant.DeclareContinuousState(len(plant.state_names))
    plant.DeclareNumericParameter(vector(plant.model.vector))
    plant.DeclareStateOutputPort("state", state)
    plant.DeclareVectorOutputPort("forces", len(_FORCE_NAMES), plant._calc_forces)
    plant.DeclareVectorOutputPort(
        "pose",
        len(POSE_NAMES),
        plant._calc_pose,
        {plant.xc_ticket(), plant.all_parameters_ticket()},
    )
    plant._numbers = plant.DeclareCacheEntry(
        "numbers of the glider as floats",
        ValueProducer(allocate=Value[object], calc=partial(_calc_numbers, plant)),
        {plant.all_parameters_ticket()},
    )


def _calc_numbers(plant, context, value):
    """Writes z and the gradient of the glider's numbers into a cache value.

    z has all numbers as in `derivatives_of`, states and inputs zero. The gradient is
    None where they are constant.
    """
    numbers = context.get_numeric_parameter(0).CopyToVector()
    z = np.append(np.zeros(len(plant.state_names) + NUM_INPUTS), ExtractValue(numbers))
    gradient = ExtractGradient(numbers)
    value.set_value((z, gradient if gradient.any() else None))


def _fast_rates(plant, context):
    """Returns the derivatives by one chain rule, None if that cannot be."""
    inputs = _scalars(plant, context)
    n = len(plant.state_names)
    z, numbers_gradient = plant._numbers.Eval(context)
    z = z.copy()
    z[: len(inputs)] = [scalar.value() for scalar in inputs]
    gradient = ExtractGradient(np.array(inputs, dtype=object))
    if numbers_gradient is not None:
        gradient = _joined(gradient, n + NUM_INPUTS, numbers_gradient)
    time = context.get_time().value()
    try:
        value, slopes = differentiate(plant.model, time, z, gradient)
    except UncompilableError:
        plant.fast = False
        return None
    return map(AutoDiffXd, value.tolist(), slopes)


def _scalars(plant, context):
    """Returns state, rate and, if given, wind; arrays of them take longer."""
    state = context.get_continuous_state_vector()
    scalars = [state.GetAtIndex(i) for i in range(len(plant.state_names))]
    rate = plant.EvalVectorInput(context, plant._elevator_rate.get_index())
    if rate is None:
        plant._elevator_rate.Eval(context)  # Raises, and says which port.
    scalars.append(rate.GetAtIndex(0))
    wind = plant.EvalVectorInput(context, plant._wind.get_index())
    if wind is not None:
        scalars += [wind.GetAtIndex(0), wind.GetAtIndex(1)]
    return scalars
