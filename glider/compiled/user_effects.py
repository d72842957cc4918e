"""Checks whether user effects can be traced beside those of the library.

A fault in a formula would otherwise show as an error of the compiler, or as a
nominal model that flies wrongly.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from glider.compiled.kernel import check_compiles
from glider.errors import InputError, expect, show
from glider.physics.compose import compose
from glider.physics.effects import KINDS, STAGES, EffectKind
from glider.physics.parameters import GliderParameters

_TRIAL_STATE = (-2.0, 0.3, -0.2, 0.1, 6.0, -1.0, 0.5)
_TRIAL_RATE = 1.0
"""A state of glider.physics.state and an elevator rate in which formulas are tried."""


def check_user_effects(own: Sequence[EffectKind]) -> None:
    """Raises InputError about the first kind that cannot be used."""
    taken = {*KINDS, "parameters", "rbf_residual", "unexplained"}
    for effect in own:
        if not isinstance(effect, EffectKind):
            found = type(effect).__name__
            raise InputError(f"user effects: found a {found}; expected an EffectKind.")
        name = effect.kind
        if name in taken:
            raise InputError(
                f"user effect '{name}': the name is taken; expected a new one."
            )
        taken.add(name)
        _check_shape(effect)
        _check_formulas(effect)


def _check_shape(effect: EffectKind) -> None:
    where = f"user effect '{effect.kind}'"
    stages = [stage for stage in STAGES if stage != "log"]
    needed = f"one of {', '.join(stages)}"
    expect(effect.stage in stages, f"{where}: stage", effect.stage, needed)
    terms, is_actuator = STAGES[effect.stage], effect.stage == "actuator"
    fits = bool(effect.adds_to) != is_actuator and set(effect.adds_to) <= set(terms)
    needed = f"a choice of {', '.join(terms) or '()'} at stage {effect.stage}"
    expect(fits, f"{where}: adds_to", effect.adds_to, needed)
    names = [c.name for c in effect.coefficients]
    has_size = is_actuator or not all(c.is_shape for c in effect.coefficients)
    good = names and len(set(names)) == len(names) and has_size
    needed = "different names, and one without a grid, which is the effect's size"
    expect(good, f"{where}: the list of its coefficients", names, needed)
    functions = (effect.state_rate, effect.steady_state)
    if any((f is not None) != bool(effect.states) for f in functions):
        raise InputError(
            f"{where}: found only some of states, state_rate and steady_state; "
            "expected all or none."
        )
    scales, states = len(effect.state_scales), len(effect.states)
    what = f"{where}: the length of state_scales"
    expect(scales in (0, states), what, scales, f"{states}, one for each state")


def _check_formulas(effect: EffectKind) -> None:
    """Tries the formulas, plain and compiled, with the default coefficients."""
    chain = compose()
    motion = chain.motion_of(0.1, _TRIAL_STATE, _TRIAL_RATE)
    flow = chain.flow_of(motion, 0.0, 0.0, GliderParameters().numbers)
    is_actuator = effect.stage == "actuator"
    given = {"actuator": _TRIAL_RATE, "air": motion}.get(effect.stage, flow)
    along = _TRIAL_RATE if is_actuator else flow
    values = effect().values
    states: tuple[float, ...] = ()
    if effect.steady_state is not None and effect.state_rate is not None:
        count, steady = len(effect.states), effect.steady_state
        states = _tried(effect, "steady_state", steady, count, along, values)
        alphadot = (_TRIAL_RATE,) if effect.rate_by_alphadot else ()
        rate_at = (*alphadot, *states, *values)
        _tried(effect, "state_rate", effect.state_rate, count, along, rate_at)
    if not is_actuator:
        # Off rest, for at rest an effect with a state may do nothing at any size.
        states = tuple(s + 0.1 for s in states)
    count = 1 if is_actuator else len(effect.adds_to)
    added = _tried(effect, "formula", effect.formula, count, given, (*states, *values))
    nothing = _TRIAL_RATE if is_actuator else 0.0
    if any(a != nothing for a in added):
        raise InputError(
            f"user effect '{effect.kind}': with its defaults the formula returns "
            f"{', '.join(f'{a:g}' for a in added)}; expected {nothing:g}, so that the "
            "defaults do nothing."
        )


def _tried(
    effect: EffectKind,
    name: str,
    function: Callable,
    count: int,
    first: tuple | float,
    values: tuple[float, ...],
) -> tuple[float, ...]:
    """Returns a formula's results as a tuple, once they are what they must be."""
    where = f"user effect '{effect.kind}': its {name}"
    for form in (function, lambda *given: check_compiles(function, given)):
        try:
            result = form(first, *values)
        except Exception as error:  # Whatever a user's function may raise.
            text = next(iter(str(error).strip().splitlines()), type(error).__name__)
            what = "fails" if form is function else "does not compile"
            raise InputError(
                f"{where} {what} ({text.rstrip('.')}); expected arithmetic and the "
                "functions sin, cos, sqrt, exp, tanh and arctan of numpy."
            ) from None
    numbers = result if isinstance(result, tuple) else (result,)
    shaped = isinstance(result, tuple) == (count > 1) and len(numbers) == count
    if not shaped or not all(math.isfinite(x) for x in np.ravel(numbers)):
        raise InputError(
            f"{where} returns {show(result)}; expected {count} finite number"
            f"{'s, as a tuple' if count > 1 else ''}."
        )
    return tuple(float(x) for x in numbers)
