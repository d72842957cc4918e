"""The glider as a Drake System: a shell of ports and context round the dynamics."""

import dataclasses

import numba
import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector_, LeafSystem_, ValueProducer
from pydrake.systems.scalar_conversion import TemplateSystem

from glider.compiled.kernel import compiled
from glider.errors import InputError
from glider.physics.compose import (
    compose,
    initial_extra,
    ordered,
)
from glider.physics.effects import (
    FIELD_VARIABLES,
    Effect,
    EffectKind,
)
from glider.physics.model import (
    GliderModel,
    as_model,
)
from glider.physics.parameters import parameter_vector
from glider.physics.state import (
    NUM_STATES,
    POSE_NAMES,
    STATE_NAMES,
)

FORCE_NAMES = ("wing", "elevator", "force_x", "force_z", "moment")
"""Force of each plate along its normal [N], total force without weight in the
world [N], total moment about +y and the center of mass [N m]."""

_TIME = FIELD_VARIABLES.index("t")


def is_time_varying(model: GliderModel) -> bool:
    """Returns whether the same state flies differently at another time."""
    return bool(np.any(model.residual_field.inverse_widths[:, _TIME] != 0.0))


def _is_absent(effect: Effect) -> bool:
    """Whether the effect is a lag of no duration, which has no state to speak of."""
    return bool(effect.kind.states) and not any(effect.values)


def _without_absent(model: GliderModel) -> GliderModel:
    effects = tuple(e for e in model.effects if not _is_absent(e))
    kinds = [e.kind.kind for e in effects]
    twice = [kind for kind in kinds if kinds.count(kind) > 1]
    if twice:
        raise InputError(f"GliderPlant: effect '{twice[0]}' is given twice.")
    parameters = dataclasses.replace(model.parameters)  # A copy, checked.
    return dataclasses.replace(model, parameters=parameters, effects=effects)


@dataclasses.dataclass(frozen=True)
class _Theta:
    """Parameters and coefficients as numbers; their gradient, None if constant."""

    numbers: np.ndarray
    gradient: np.ndarray | None


@TemplateSystem.define("GliderPlant_")
def GliderPlant_(T):
    class Impl(LeafSystem_[T]):
        """A planar glider with its effects.

        elevator_rate -> [             ] -> state
        wind ----------> [ GliderPlant ] -> forces
                         [             ] -> pose

        Args:
            model: drawing, effects and residual field, or the path of their
                file; the default is the drawing of GliderParameters. A servo_lag
                or command_delay of zero duration is left out.
            fast: whether the AutoDiffXd twin takes value and Jacobian from
                compiled code (about a quarter of the time; the first call
                compiles, later sessions read it from disk). Where a formula
                does not compile, it goes the plain way.

        Input ports:
            elevator_rate: commanded rate of the elevator [rad/s].
            wind: velocity of the air, world (x, z) [m/s]; may be left open.

        Output ports:
            state: STATE_NAMES, then the effects' own states (`state_names`).
            forces: FORCE_NAMES, directly from state, elevator_rate and wind.
            pose: what the sensors show, POSE_NAMES.

        Numeric parameter 0 holds the drawing in the order of PARAMETER_NAMES
        and numeric parameter 1 the effects' coefficients, one effect after the
        other, so that a caller can change them or differentiate by them.
        """

        def _construct(self, model=None, fast=True, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self.set_name("glider")
            model = GliderModel() if model is None else as_model(model)
            self.model = _without_absent(model)
            self.fast = fast
            self.kinds = tuple(e.kind for e in self.model.effects)
            self.state_names = (*STATE_NAMES, *_extra_names(self.kinds))
            self._field = self.model.residual_field
            self._has_field = self.model.field is not None
            self._functions = compose(self.kinds, self._has_field)

            self._elevator_rate = self.DeclareVectorInputPort("elevator_rate", 1)
            self._wind = self.DeclareVectorInputPort("wind", 2)
            state = self.DeclareContinuousState(len(self.state_names))
            self.DeclareNumericParameter(
                BasicVector_[T](parameter_vector(self.model.parameters))
            )
            self.DeclareNumericParameter(BasicVector_[T](self.model.coefficients))
            self.DeclareStateOutputPort("state", state)
            self.DeclareVectorOutputPort("forces", len(FORCE_NAMES), self._calc_forces)
            self.DeclareVectorOutputPort(
                "pose",
                len(POSE_NAMES),
                self._calc_pose,
                {self.xc_ticket(), self.all_parameters_ticket()},
            )
            self._theta = self.DeclareCacheEntry(
                "parameters and coefficients as numbers",
                ValueProducer(allocate=Value[object], calc=self._calc_theta),
                {self.all_parameters_ticket()},
            )

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, other.model, other.fast, converter=converter)

        def is_time_varying(self):
            return is_time_varying(self.model)

        def DoCalcTimeDerivatives(self, context, derivatives):
            rates = self._fast_rates(context) if self._is_fast(context) else None
            if rates is None:
                rates = self._functions.derivatives(*self._arguments(context))
            derivatives.get_mutable_vector().SetFromVector(np.array(rates))

        def _arguments(self, context):
            """Returns t, x, u, wind_x, wind_z, p, c, field of a context."""
            wind_x, wind_z = self._eval_wind(context)
            return (
                context.get_time(),
                context.get_continuous_state_vector().CopyToVector(),
                self._elevator_rate.Eval(context)[0],
                wind_x,
                wind_z,
                *self._parameters(context),
                self._field,
            )

        def _eval_wind(self, context):
            if self._wind.HasValue(context):
                return self._wind.Eval(context)
            return 0.0, 0.0

        def _parameters(self, context):
            return (
                context.get_numeric_parameter(0).CopyToVector(),
                context.get_numeric_parameter(1).CopyToVector(),
            )

        def _calc_forces(self, context, output):
            t, x, u, wind_x, wind_z, p, c, field = self._arguments(context)
            chain = self._functions
            rate = chain.actuator_terms(u, x, c)
            flow, terms = chain.meet_air(t, x, rate, wind_x, wind_z, p, c, field)
            output.SetFromVector(np.array(chain.wrench(flow, terms, x, c)[:5]))

        def _calc_pose(self, context, output):
            x = context.get_continuous_state_vector().CopyToVector()
            pose = self._functions.measure(x, *self._parameters(context))
            output.SetFromVector(np.array(pose))

        def _is_fast(self, context):
            if T is not AutoDiffXd or not self.fast:
                return False
            # Nobody differentiates by time; if so, the plain way knows how.
            return not (self._has_field and context.get_time().derivatives().size)

        def _calc_theta(self, context, value):
            both = np.concatenate(self._parameters(context))
            gradient = ExtractGradient(both)
            value.set_value(
                _Theta(
                    ExtractValue(both)[:, 0].copy(),
                    gradient if gradient.any() else None,
                )
            )

        def _fast_rates(self, context):
            """Returns the derivatives by one chain rule, None if that cannot be."""
            x = context.get_continuous_state_vector().CopyToVector()
            u = self._elevator_rate.Eval(context)
            inputs = np.concatenate([x, u, *self._wind_if_any(context)])
            theta = self._theta.Eval(context)
            n = len(x)
            z = np.zeros(n + 3 + len(theta.numbers))
            z[: len(inputs)] = [scalar.value() for scalar in inputs]
            z[n + 3 :] = theta.numbers
            gradient = ExtractGradient(inputs)
            if theta.gradient is not None:
                gradient = _joined(gradient, n + 3, theta.gradient)

            value, slopes = np.empty(n), np.empty((n, gradient.shape[1]))
            try:
                compiled(self.kinds, self._has_field).directional(
                    context.get_time().value(),
                    z,
                    gradient,
                    n,
                    self._field,
                    value,
                    slopes,
                )
            except numba.core.errors.NumbaError:
                self.fast = False
                return None
            # Faster than InitializeAutoDiff.
            return np.fromiter(map(AutoDiffXd, value.tolist(), slopes), object, n)

        def _wind_if_any(self, context):
            return (self._wind.Eval(context),) if self._wind.HasValue(context) else ()

    return Impl


GliderPlant = GliderPlant_[None]  # The float instantiation.


def _extra_names(kinds: tuple[EffectKind, ...]) -> tuple[str, ...]:
    return tuple(f"{e.kind}.{name}" for e in ordered(kinds) for name in e.states)


def _joined(gradient, rows, below):
    """Returns gradient, filled up to so many rows, with another below it."""
    columns = max(gradient.shape[1], below.shape[1])
    joined = np.zeros((rows + len(below), columns), order="F")
    joined[: len(gradient), : gradient.shape[1]] = gradient
    joined[rows:, : below.shape[1]] = below
    return joined


def initial_state(plant, state):
    """Returns the full state in still air with the effects' own states at rest.

    Args:
        plant: a GliderPlant.
        state: (7,) of STATE_NAMES, or already the full one (n,); or many of them,
            the columns of (7, B) or (n, B).

    Raises:
        InputError: where the length is neither.
    """
    x, n = np.asarray(state, dtype=float), plant.num_continuous_states()
    if len(x) == n:
        return x
    if len(x) != NUM_STATES:
        raise InputError(
            f"initial_state: the state has {len(x)} numbers; {NUM_STATES} or {n} "
            "are needed."
        )
    model = plant.model
    p, c = parameter_vector(model.parameters), model.coefficients
    # The drawing meets the air before any effect has a state to look at.
    full = np.concatenate([x, np.zeros((n - NUM_STATES, *x.shape[1:]))])
    chain = compose(plant.kinds, model.field is not None)
    flow, _ = chain.meet_air(0.0, full, 0.0, 0.0, 0.0, p, c, model.residual_field)
    for k, value in enumerate(initial_extra(plant.kinds, flow, 0.0, c)):
        full[NUM_STATES + k] = value
    return full
